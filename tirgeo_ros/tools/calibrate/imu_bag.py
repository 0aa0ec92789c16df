"""Read an IMU's record from a bag; say and show its noise by axis, at rest or in flight.

The axes x, y, z are those of the messages (forward, left, up). The filter's axes (forward, right,
down) differ only in sign, which does not change noise parameters.
"""

from __future__ import annotations

import math
import struct
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.calibration.imu_record import (
    ImuRecord,
    record_of,
)
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.presentation.plots import figure
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.presentation.results import table

_MARKS = {b"\0\1": "<", b"\0\0": ">"}
_BEHIND_HEADER = 4 + 9 + 3 + 9 + 3 + 9  # numbers: orientation, rate, acceleration; covariances
_RATE = 4 + 9
_FORCE = _RATE + 3 + 9
_FRAME_AT = 4 + 8  # of the frame's length, after encapsulation and stamp
_ABSENT = -1.0  # first entry of a covariance whose value is absent


class ImuBlock(NamedTuple):
    """Hold samples in the order of their messages, FLU as in the message."""

    stamps_ns: npt.NDArray[np.int64]  # (n,)
    values: Array  # (n, 6) angular rate (rad/s), specific force (m/s2); NaN where absent
    unreadable: int  # messages that are no Imu


def imu_block(messages: Sequence[bytes]) -> ImuBlock:
    """Decode these CDR messages, as far as they are readable."""
    stamps_ns = np.zeros(len(messages), np.int64)
    values = np.zeros((len(messages), 6))
    readable = np.zeros(len(messages), bool)
    for (mark, frame, size), places in _layouts(messages).items():
        layout = _layout(_MARKS[mark], frame, size)
        rows = np.frombuffer(b"".join(messages[k] for k in places), layout)
        numbers = rows["numbers"].astype(float)
        for first, at in ((0, _RATE), (3, _FORCE)):
            values[places, first : first + 3] = numbers[:, at : at + 3]
            absent = numbers[:, at + 3] == _ABSENT
            values[np.array(places)[absent], first : first + 3] = np.nan
        stamps_ns[places] = rows["sec"].astype(np.int64) * 1_000_000_000 + rows["nanosec"]
        readable[places] = True
    return ImuBlock(stamps_ns[readable], values[readable], int((~readable).sum()))


def _layouts(messages: Sequence[bytes]) -> dict[tuple[bytes, int, int], list[int]]:
    """Return the message indices for each byte order, length of the frame, and length."""
    by_layout: dict[tuple[bytes, bytes, int], list[int]] = defaultdict(list)
    for place, data in enumerate(messages):
        by_layout[data[:2], data[_FRAME_AT : _FRAME_AT + 4], len(data)].append(place)
    sound = {}
    for (mark, length, size), places in by_layout.items():
        if mark in _MARKS and len(length) == 4:
            (frame,) = struct.unpack(_MARKS[mark] + "I", length)
            if _numbers_at(frame) + 8 * _BEHIND_HEADER <= size:
                sound[mark, frame, size] = places
    return sound


def _numbers_at(frame: int) -> int:
    """Return the offset of the numbers: aligned to 8 from the end of the encapsulation on."""
    return 4 + (8 + 4 + frame + 7) // 8 * 8


@cache
def _layout(order: str, frame: int, size: int) -> np.dtype[Any]:
    return np.dtype(
        {
            "names": ["sec", "nanosec", "numbers"],
            "formats": [f"{order}i4", f"{order}u4", (f"{order}f8", (_BEHIND_HEADER,))],
            "offsets": [4, 8, _numbers_at(frame)],
            "itemsize": size,
        }
    )


CHANNELS = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
#: Sensor -> its name in a title, the unit of its samples, and that of its noise density.
_TITLES = {"gyro": "Gyroscope", "accel": "Accelerometer"}
UNITS = {"gyro": "rad/s", "accel": "m/s2"}
DENSITIES = {"gyro": "rad/sqrt(s)", "accel": "m/s/sqrt(s)"}
#: What results say of an axis, by name.
Axis = Mapping[str, Any]
_TYPE = "sensor_msgs/msg/Imu"
_BLOCK = 1 << 15  # messages decoded together
_SLACK_S = 60.0  # stop reading at messages logged this long after the last wanted stamp
_LEAST_HZ = 5.0
_MUCH = 0.01  # share of missing, repeated or equal samples that causes a warning


@dataclass(frozen=True)
class ReadImu:
    """Hold the record of a topic."""

    where: str  # bag and topic
    topic: str
    record: ImuRecord
    messages: int
    unreadable: int

    @property
    def rate_hz(self) -> float:
        """Return the number of samples a second where none is missing."""
        return 1 / self.record.step_s

    def numbers(self) -> dict[str, object]:
        """Return what results of every kind say of the record."""
        return {
            "topic": self.topic,
            "messages": self.messages,
            "samples": self.record.samples,
            "rate_hz": self.rate_hz,
            "jitter_ms": self.record.jitter_s * 1e3,
        }


def read_imu(
    reader: BagReader,
    topic: str,
    from_s: float = 0.0,
    to_s: float = math.inf,
    progress: Report = silent,
) -> ReadImu:
    """Read a topic between two times (s) since its first message.

    Raise BagError for a topic that is absent or no Imu, CalibrationError for an unusable record.
    """
    _check_topic(reader, topic)
    where = f"{reader.path}: {topic}"
    begin_ns, end_ns = reader.span_ns
    blocks: list[tuple[IntArray, Array]] = []  # stamps and values
    number = unreadable = 0
    first_ns: int | None = None
    messages = reader.messages([topic])
    while chunk := list(islice(messages, _BLOCK)):
        block = imu_block([message.data for message in chunk])
        number, unreadable = number + len(chunk), unreadable + block.unreadable
        if first_ns is None and len(block.stamps_ns):
            first_ns = int(block.stamps_ns[0])
        since_s = (block.stamps_ns - (first_ns or 0)) * 1e-9
        wanted = (since_s >= from_s) & (since_s <= to_s)
        blocks.append((block.stamps_ns[wanted], block.values[wanted]))
        done_s = (chunk[-1].log_time_ns - begin_ns) * 1e-9
        progress(done_s, min((end_ns - begin_ns) * 1e-9, to_s))
        if done_s > to_s + _SLACK_S:
            break
    if not any(np.isfinite(values).all(axis=1).any() for _, values in blocks):
        raise CalibrationError(
            f"{where}: none of {number} messages has a sample; check --from and --to"
        )
    stamps_ns = np.concatenate([stamps for stamps, _ in blocks])
    values = np.concatenate([values for _, values in blocks])
    blocks.clear()
    try:
        record = record_of(stamps_ns, values)
    except CalibrationError as error:
        raise CalibrationError(f"{where}: {error}") from None
    if 1 / record.step_s < _LEAST_HZ:
        raise CalibrationError(
            f"{where}: {1 / record.step_s:.3g} samples a second are too few; record at 50 Hz or "
            "more"
        )
    return ReadImu(where=where, topic=topic, record=record, messages=number, unreadable=unreadable)


def _check_topic(reader: BagReader, name: str) -> None:
    topics = reader.topics()
    if topics.get(name) != _TYPE:
        others = ", ".join(topic for topic, kind in topics.items() if kind == _TYPE) or "none"
        what = f"is of type {topics[name] or 'nothing'}" if name in topics else "is not there"
        raise BagError(
            f"{reader.path}: {name} {what}; topics of {_TYPE}: {others}; "
            "give --topic or --namespace"
        )


def channel_names(these: Iterable[object]) -> str:
    """Return the names of the channels (6,) for which something is true."""
    return ", ".join(name for name, it in zip(CHANNELS, these, strict=True) if it)


def check_alive(where: str, sizes: Array) -> None:
    """Raise CalibrationError for axes whose sizes of change (n, 6) are all zero."""
    dead = channel_names((sizes == 0).all(axis=0).tolist())
    if dead:
        raise CalibrationError(f"{where}: {dead}: never changes; record what the IMU measures")


def sample_warnings(read: ReadImu) -> Iterator[str]:
    """Yield what is wrong with the samples of any record, at rest or in flight."""
    faults, samples = read.record.irregular, max(read.record.samples, 1)
    lost = faults["missing"] + faults["not_finite"] + read.unreadable
    if lost > _MUCH * samples:
        yield f"{lost} samples beside {samples} are missing, unreadable or not finite"
    disordered = faults["repeated_stamps"] + faults["late_stamps"]
    if disordered > _MUCH * samples:
        yield f"{disordered} stamps repeat the previous one or go back: left out"
    if faults["same_as_before"] > _MUCH * samples:
        yield (
            f"{100 * faults['same_as_before'] / samples:.0f} % of the samples equal the one "
            "before: the topic is faster than the sensor, or the sensor is coarse"
        )


def axes_table(heads: Mapping[str, str], rows: Sequence[Mapping[str, str]]) -> str:
    """Return rows, title -> text, in columns; a sensor's below its head."""
    parts = []
    for sensor, head in heads.items():
        own = [{**row, "axis": row["axis"][-1]} for row in rows if row["axis"].startswith(sensor)]
        parts += [f"{sensor}: {head}", table([[*own[0]], *([*row.values()] for row in own)])]
    return "\n".join(parts)


def axis_panels(what: str, units: Mapping[str, str], below: str) -> tuple[Any, Any]:
    """Return a figure and (2, 3) panels, one for each axis."""
    made, panels = figure(12.0, 7.2, 2, 3, sharex=True, sharey="row")
    for panel, name in zip(panels.flat, CHANNELS, strict=True):
        sensor, letter = name.split()
        panel.set_title(f"{_TITLES[sensor]} {letter}")
    for row, unit in zip(panels, units.values(), strict=True):
        row[0].set_ylabel(f"{what} [{unit}]")
    for panel in panels[1]:
        panel.set_xlabel(below)
    return made, panels
