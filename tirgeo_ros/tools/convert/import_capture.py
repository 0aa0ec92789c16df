"""Convert a capture of the aircraft's serial port to the topics of the contract.

The bytes carry no time of arrival. Stamps are the aircraft's own, converted to UTC by the date and
time of day that its receivers send, or by a given start. The receivers' date and time have whole
seconds, are late by ``rtk.delay_s`` as their positions are, and are in GMT+8 by DJI's headers;
they are taken as UTC if the file was last changed at about that time. A sample's log time is the
time at which the aircraft sent its data.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.clocks.capture_clock import CaptureTimeline
from tirgeo_ros.dji.clocks.civil_time import WholeSeconds, guess_utc_offset, utc_from_words
from tirgeo_ros.dji.clocks.tick_clock import LONG_TICK_NS, MILLISECOND_NS, is_long
from tirgeo_ros.dji.link.encryption import parse_key
from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame
from tirgeo_ros.dji.protocol.broadcast import decode_broadcast
from tirgeo_ros.dji.protocol.package_table import package_table
from tirgeo_ros.dji.protocol.subscription import PackageTable, decode_push
from tirgeo_ros.dji.sources.readings import Reading
from tirgeo_ros.dji.sources.serial_readings import Clocks, Telemetry
from tirgeo_ros.io.parameters.parameter_file import load_yaml
from tirgeo_ros.tools.convert.import_sink import ImportSink
from tirgeo_ros.tools.presentation.progress import Report, silent

_CHUNK_BYTES = 1 << 16
_HOUR_NS = 3_600_000_000_000
_PUSHES = 0x02
_BROADCAST, _SUBSCRIPTION = 0x00, 0x05
#: This many new seconds give the time of the capture to some milliseconds.
_SECONDS = 60


#: Counts of the telemetry that are reported.
_UNUSED = {
    "unknown_layout": "broadcasts are of a layout that is not known",
    "unknown_package": "pushes are of packages that are not known: give --packages",
    "untimed": "broadcasts have no time: stamped as the message before",
}


class CaptureOptions(NamedTuple):
    """Hold how to read a capture; for empty values dji_node's parameters are used."""

    packages: str = ""  # YAML file
    key: str = ""  # 64 hexadecimal digits
    start_ns: int | None = None  # UTC of the first message


class _Placed(NamedTuple):
    """Hold the conversion of a capture's time to UTC."""

    timeline: CaptureTimeline
    said: str
    warning: str | None


class _Pass:
    """Read a capture once, from its first byte."""

    def __init__(
        self, path: Path, packages: str, key: str, timeline: CaptureTimeline, tick_ns: int
    ) -> None:
        self.table = package_table(load_yaml(packages), packages) if packages else PackageTable()
        self.frames = FrameReader(parse_key(key))
        sync = timeline.clock(LONG_TICK_NS, resets_alone=True)
        clocks = Clocks(timeline.clock(tick_ns), timeline.clock(), sync)
        self.telemetry = Telemetry(clocks, self.table)
        self.timeline = timeline
        self._path = path

    def readings(self, progress: Report) -> Iterator[tuple[ProtocolFrame, list[Reading]]]:
        """Yield each frame and its readings. Raise DjiError without any frame."""
        total = self._path.stat().st_size
        with self._path.open("rb") as file:
            while chunk := file.read(_CHUNK_BYTES):
                yield from map(self._read, self.frames.feed(chunk))
                progress(file.tell() * 1e-6, total * 1e-6)
        yield from map(self._read, self.frames.rescan())
        if not self.frames.counts["frames"]:
            raise DjiError(
                f"{self._path}: no frame in {total} bytes: neither a ROS 1 bag nor what an "
                "aircraft's serial port sent at the right baud rate"
            )

    def _read(self, frame: ProtocolFrame) -> tuple[ProtocolFrame, list[Reading]]:
        return frame, self.telemetry.read(frame, self.timeline.now_ns)


def import_capture(
    path: Path, sink: ImportSink, config: DjiConfig, options: CaptureOptions, progress: Report
) -> dict[str, object]:
    """Import a capture; return what to report of it. Raise DjiError, ConfigError."""
    packages, key = options.packages or config.packages, options.key or config.key
    seconds, tick_ns = _receiver_seconds(path, packages, key)
    if options.start_ns is None:
        placed = _placed(path, seconds, round(config.rtk.delay_s * 1e9))
    else:
        placed = _Placed(CaptureTimeline(options.start_ns), "of --start-time", None)
    run = _Pass(path, packages, key, placed.timeline, tick_ns)
    newest_ns = number = 0
    for _, readings in run.readings(progress):
        for reading in readings:
            number += 1
            newest_ns = max(newest_ns, reading.stamp_ns)
            sink.take(newest_ns, reading)
    counts = run.frames.counts | ({} if key else {"not decrypted": run.frames.counts["encrypted"]})
    complaints = list(_complaints(counts, run.telemetry.counts, placed.timeline))
    _check_use(path, number, placed.timeline, complaints)
    return {
        "kind": "capture",
        "time": placed.said,
        "frames": run.frames.counts,
        "telemetry": run.telemetry.counts,
        "warnings": [*([placed.warning] if placed.warning else []), *complaints],
    }


def _check_use(
    path: Path, readings: int, timeline: CaptureTimeline, complaints: list[str]
) -> None:
    """Raise DjiError if the capture has no readings, or none with a time."""
    if not readings:
        raise DjiError("; ".join((f"{path}: its frames hold nothing for a flight", *complaints)))
    if timeline.newest_ns is None:
        raise DjiError(
            f"{path}: nothing in it tells the aircraft's time: its broadcast needs the time "
            "stamp, or a subscription package does"
        )


def _placed(path: Path, seconds: WholeSeconds, delay_ns: int) -> _Placed:
    """Place a capture in time by the receivers' seconds, which come ``delay_ns`` late."""
    if seconds.shift_ns is None or seconds.newest_ns is None:
        return _Placed(
            CaptureTimeline(),
            "since the aircraft's power-up",
            "the capture has no date: times count from the aircraft's power-up, in 1970; give "
            "--start-time",
        )
    zone = guess_utc_offset(seconds.newest_ns, path.stat().st_mtime_ns)
    said = f"of the aircraft's receivers, taken as GMT+{zone.hours}"
    doubt = None if zone.is_known else f"{said}; give --start-time if that is wrong by hours"
    shift_ns = seconds.shift_ns + delay_ns - zone.hours * _HOUR_NS
    return _Placed(CaptureTimeline(shift_ns=shift_ns), said, doubt and f"the time is {doubt}")


def _receiver_seconds(path: Path, packages: str, key: str) -> tuple[WholeSeconds, int]:
    """Return the receivers' seconds, and the tick of the broadcast's counter (ns) by them.

    The ticks are of 2.5 ms if most of the seconds, at least two, show that.
    """
    seconds = _seconds(path, packages, key, MILLISECOND_NS)
    are_long = [is_long(*pair) for pair in seconds.seconds_ns]
    if len(are_long) < 2 or 2 * sum(are_long) <= len(are_long):
        return seconds, MILLISECOND_NS
    return _seconds(path, packages, key, LONG_TICK_NS), LONG_TICK_NS


def _seconds(path: Path, packages: str, key: str, tick_ns: int) -> WholeSeconds:
    """Collect the receivers' seconds against the aircraft's time since power-up."""
    found, number, known = WholeSeconds(), 0, None
    run = _Pass(path, packages, key, CaptureTimeline(), tick_ns)
    for frame, readings in run.readings(silent):
        if run.timeline.restarts and found.shift_ns is not None:
            break  # after a restart the offset is another
        date_time = _date_and_time(frame, run.table) if readings else None
        if date_time is None:
            continue
        found.take(readings[-1].stamp_ns, *date_time)
        number += date_time != known
        known = date_time
        if number > _SECONDS:
            break
    return found


def _date_and_time(frame: ProtocolFrame, table: PackageTable) -> tuple[int, int] | None:
    """Return a frame's date and time of day: RTK's, else that of the ordinary GPS.

    Return None if it has neither.
    """
    found: list[tuple[int, int]] = []
    if (frame.cmd_set, frame.cmd_id) == (_PUSHES, _BROADCAST):
        parts = decode_broadcast(frame.value)
        blocks = () if parts is None else (parts.rtk, parts.gps)
        found = [(block.date, block.time) for block in blocks if block is not None]
    elif (frame.cmd_set, frame.cmd_id) == (_PUSHES, _SUBSCRIPTION):
        push = decode_push(frame.value, table)
        values = {} if push is None else push.values
        if "GPS_DATE" in values and "GPS_TIME" in values:
            found = [(int(values["GPS_DATE"]), int(values["GPS_TIME"]))]
    return next(
        (date_time for date_time in found if utc_from_words(*date_time, 0) is not None), None
    )


def _complaints(
    frames: dict[str, int], telemetry: dict[str, int], timeline: CaptureTimeline
) -> Iterator[str]:
    """Yield what of a capture could not be used."""
    if frames.get("not decrypted"):
        yield f"{frames['not decrypted']} frames are encrypted: give --key"
    damaged = frames["bad_crc32"] + frames["truncated"]
    if damaged or frames["skipped_bytes"]:
        yield (
            f"{frames['skipped_bytes']} bytes are in no frame, {damaged} frames are damaged or cut"
        )
    for name, what in _UNUSED.items():
        if telemetry.get(name):
            yield f"{telemetry[name]} {what}"
    if timeline.restarts:
        yield (
            f"the aircraft's clock started again {timeline.restarts} times: what follows is "
            "stamped as if it had been off for a second; cut the file there if it was longer"
        )
