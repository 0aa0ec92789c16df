# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
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
from typing import Any, NamedTuple

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.clocks.aircraft_clock import LONG_TICK_NS, MILLISECOND_NS
from tirgeo_ros.dji.clocks.capture_clock import (
    DOCUMENTED_OFFSET_H,
    CaptureTimeline,
    WholeSeconds,
    guess_utc_offset,
    time_of_words,
)
from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame, parse_key
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import decode_broadcast
from tirgeo_ros.dji.protocol.subscription import PackageTable, decode_push
from tirgeo_ros.dji.sources.readings import Reading
from tirgeo_ros.dji.sources.serial import Clocks, Telemetry
from tirgeo_ros.tools.convert.dump import frames_in, packages_of
from tirgeo_ros.tools.convert.import_sink import ImportSink
from tirgeo_ros.tools.presentation.progress import Report, silent

#: So many changes of the second give the time of the capture to some milliseconds.
_SECONDS = 60
#: Counts of the telemetry that become warnings.
_UNUSED = {
    "unknown_layout": "broadcasts have an unknown layout",
    "unknown_package": "pushes belong to unknown packages: give --packages",
    "untimed": "broadcasts have no time: stamped as the previous message",
}


class CaptureOptions(NamedTuple):
    """Hold options for reading a capture; dji_node's parameters replace empty values."""

    packages: str = ""  # YAML file
    key: str = ""  # 64 hexadecimal digits
    start_ns: int | None = None  # UTC of the first message


class _Pass:
    """Read a capture once, from its first byte."""

    def __init__(
        self, path: Path, options: CaptureOptions, timeline: CaptureTimeline, tick_ns: int
    ) -> None:
        self.table = packages_of(options.packages)
        self.frames = FrameReader(parse_key(options.key))
        sync = timeline.clock(LONG_TICK_NS, resets_alone=True)
        clocks = Clocks(timeline.clock(tick_ns), timeline.clock(), sync)
        self.telemetry = Telemetry(clocks, self.table)
        self.timeline = timeline
        self._path = path

    def readings(self, progress: Report) -> Iterator[tuple[ProtocolFrame, list[Reading]]]:
        """Yield each frame and its readings. Raise DjiError if there is no frame."""
        for frame in frames_in(self._path, self.frames, progress):
            yield frame, self.telemetry.read(frame, self.timeline.now_ns)
        if not self.frames.counts["frames"]:
            raise DjiError(
                f"{self._path}: no frame in {self.frames.counts['bytes']} bytes: neither a ROS 1 "
                "bag nor a recording of an aircraft's serial port at the right baud rate"
            )

    def warnings(self, *, has_key: bool) -> Iterator[str]:
        """Yield a line for each part of the capture that could not be used."""
        frames = self.frames.counts
        if frames["encrypted"] and not has_key:
            yield f"{frames['encrypted']} frames are encrypted: give --key"
        damaged, skipped = frames["bad_crc32"] + frames["truncated"], frames["skipped_bytes"]
        if damaged or skipped:
            yield f"{skipped} bytes are in no frame, {damaged} frames are damaged or cut"
        for name, what in _UNUSED.items():
            if self.telemetry.counts[name]:
                yield f"{self.telemetry.counts[name]} {what}"
        if self.timeline.restarts:
            yield (
                f"the aircraft's clock started again {self.timeline.restarts} times: later stamps "
                "count each pause as one second; split the file there if the pause was longer"
            )


def import_capture(
    path: Path, sink: ImportSink, config: DjiConfig, options: CaptureOptions, progress: Report
) -> dict[str, Any]:
    """Import a capture; return what to report of it. Raise DjiError, ConfigError."""
    options = CaptureOptions(
        options.packages or config.packages, options.key or config.key, options.start_ns
    )
    seconds = _seconds(path, options, MILLISECOND_NS)
    tick_ns = seconds.tick_ns  # of the broadcast's counter
    if tick_ns != MILLISECOND_NS:
        seconds = _seconds(path, options, tick_ns)
    timeline, origin, warnings = _placed(path, options, seconds, round(config.rtk.delay_s * 1e9))
    run = _Pass(path, options, timeline, tick_ns)
    newest_ns = number = 0
    for _, readings in run.readings(progress):
        for reading in readings:
            number += 1
            newest_ns = max(newest_ns, reading.stamp_ns)
            sink.take(newest_ns, reading)
    complaints = list(run.warnings(has_key=bool(options.key)))
    if not number:
        raise DjiError("; ".join((f"{path}: its frames contain no flight data", *complaints)))
    if timeline.newest_ns is None:
        raise DjiError(
            f"{path}: it lacks the aircraft's time: enable the time stamp in "
            "the broadcast or in a subscription package"
        )
    return {
        "kind": "capture",
        "time": origin,
        "frames": run.frames.counts,
        "telemetry": run.telemetry.counts,
        "warnings": [*warnings, *complaints],
    }


def _placed(
    path: Path, options: CaptureOptions, seconds: WholeSeconds, delay_ns: int
) -> tuple[CaptureTimeline, str, list[str]]:
    """Place a capture in time; return its timeline, how it was placed, and warnings.

    The receivers' seconds come ``delay_ns`` late.
    """
    if options.start_ns is not None:
        return CaptureTimeline(options.start_ns), "of --start-time", []
    if seconds.shift_ns is None:
        warning = (
            "the capture has no date: times count from the aircraft's power-up, in 1970; give "
            "--start-time"
        )
        return CaptureTimeline(), "since the aircraft's power-up", [warning]
    hours_by_file = guess_utc_offset(seconds.newest_ns + seconds.shift_ns, path.stat().st_mtime_ns)
    hours = DOCUMENTED_OFFSET_H if hours_by_file is None else hours_by_file
    origin = f"of the aircraft's receivers, taken as GMT+{hours}"
    doubt = [f"the time is {origin}; give --start-time if that is wrong by hours"]
    shift_ns = seconds.shift_ns + delay_ns - hours * 3_600_000_000_000
    return CaptureTimeline(shift_ns=shift_ns), origin, doubt if hours_by_file is None else []


def _seconds(path: Path, options: CaptureOptions, tick_ns: int) -> WholeSeconds:
    """Collect the receivers' seconds against the aircraft's time since power-up."""
    seconds = WholeSeconds()
    run = _Pass(path, options, CaptureTimeline(), tick_ns)
    for frame, readings in run.readings(silent):
        # A restart changes the offset.
        if seconds.number >= _SECONDS or (run.timeline.restarts and seconds.number):
            break
        words = _date_and_time(frame, run.table) if readings else None
        if words is not None:
            seconds.take(readings[-1].stamp_ns, *words)
    return seconds


def _date_and_time(frame: ProtocolFrame, table: PackageTable) -> tuple[int, int] | None:
    """Return a frame's date and time of day: RTK's, else that of the ordinary GPS, else None."""
    candidates: list[tuple[int, int]] = []
    if (frame.cmd_set, frame.cmd_id) == (0x02, 0x00):
        parts = decode_broadcast(frame.value)
        blocks = () if parts is None else (parts.rtk, parts.gps)
        candidates = [(block.date, block.time) for block in blocks if block is not None]
    elif (frame.cmd_set, frame.cmd_id) == (0x02, 0x05):
        push = decode_push(frame.value, table)
        values = {} if push is None else push.values
        if "GPS_DATE" in values and "GPS_TIME" in values:
            candidates = [(int(values["GPS_DATE"]), int(values["GPS_TIME"]))]
    return next((words for words in candidates if time_of_words(*words) is not None), None)
