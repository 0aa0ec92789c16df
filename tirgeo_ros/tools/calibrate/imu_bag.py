"""Read an IMU's record from a bag; say and show its noise by axis, at rest or in flight.

The axes x, y, z are those of the messages (forward, left, up). The filter's axes (forward, right,
down) differ only in sign, which does not change noise parameters.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.calibration.imu_record import ImuRecord, record_of
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.presentation.plots import figure
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.presentation.results import table

_ORDERS = {b"\0\1": "<", b"\0\0": ">"}
#: Of a message's numbers: orientation, rate and acceleration, each with its covariance (9).
_NUMBERS, _RATE, _FORCE = 37, slice(13, 16), slice(25, 28)
CHANNELS = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
#: Units of the samples and of their noise density.
UNITS = {"gyro": "rad/s", "accel": "m/s2"}
DENSITIES = {"gyro": "rad/sqrt(s)", "accel": "m/s/sqrt(s)"}
#: What results say of an axis, by name.
Axis = Mapping[str, Any]
_TYPE = "sensor_msgs/msg/Imu"
_BLOCK = 1 << 15  # messages decoded together
_SLACK_S = 60.0  # stop reading at messages logged this long after the last wanted stamp
_LEAST_HZ = 5.0
_MUCH = 0.01  # share of lost, disordered or equal samples that causes a warning


class ImuBlock(NamedTuple):
    """Hold samples in the order of their messages, FLU as in the message."""

    stamps_ns: npt.NDArray[np.int64]  # (n,)
    values: Array  # (n, 6) angular rate (rad/s), specific force (m/s2); NaN where absent
    unreadable: int  # messages that are no Imu


def imu_block(messages: Sequence[bytes]) -> ImuBlock:
    """Decode these CDR messages, as far as they are readable; those of one layout together."""
    number = len(messages)
    stamps_ns, values = np.zeros(number, np.int64), np.zeros((number, 6))
    readable = np.zeros(number, bool)
    layouts: dict[tuple[bytes, bytes, int], list[int]] = defaultdict(list)
    for place, data in enumerate(messages):
        layouts[data[:2], data[12:16], len(data)].append(place)  # byte order, length of the frame
    for (mark, length, size), places in layouts.items():
        order = _ORDERS.get(mark, "")
        frame = int.from_bytes(length, "little" if order == "<" else "big")
        begin = 4 + (12 + frame + 7) // 8 * 8  # numbers are aligned to 8 behind the encapsulation
        end = begin + 8 * _NUMBERS
        if not order or len(length) < 4 or end > size:
            continue
        rows = np.frombuffer(b"".join(messages[k] for k in places), np.uint8).reshape(-1, size)
        times = rows[:, 4:12].copy().view(f"{order}i4").astype(np.int64)
        numbers = rows[:, begin:end].copy().view(f"{order}f8").astype(float)
        stamps_ns[places], readable[places] = times @ [1_000_000_000, 1], True
        for first, part in ((0, _RATE), (3, _FORCE)):
            absent = numbers[:, part.stop : part.stop + 1] == -1.0  # of the covariance
            values[places, first : first + 3] = np.where(absent, np.nan, numbers[:, part])
    return ImuBlock(stamps_ns[readable], values[readable], int((~readable).sum()))


@dataclass(frozen=True)
class ReadImu:
    """Hold the record of a topic."""

    where: str  # bag and topic
    topic: str
    record: ImuRecord
    messages: int
    unreadable: int

    def numbers(self) -> dict[str, object]:
        """Return what results of every kind say of the record."""
        return {
            "topic": self.topic,
            "messages": self.messages,
            "samples": self.record.samples,
            "rate_hz": 1 / self.record.step_s,
            "jitter_ms": self.record.jitter_s * 1e3,
            "irregular": {"unreadable": self.unreadable, **self.record.irregular},
        }

    def warnings(self) -> list[str]:
        """Return what is wrong with the samples, at rest or in flight."""
        faults, samples = self.record.irregular, max(self.record.samples, 1)
        lost = faults["missing"] + faults["not_finite"] + self.unreadable
        texts = {
            f"{lost} samples beside {samples} are missing, unreadable or not finite": lost,
            "stamps repeat the previous one or go back: left out": faults["repeated_stamps"]
            + faults["late_stamps"],
            "samples equal the one before: the topic is faster than the sensor, or the sensor is "
            "coarse": faults["same_as_before"],
        }
        return [text for text, number in texts.items() if number > _MUCH * samples]


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


def axes_table(
    axes: Sequence[Axis], head: str, columns: Mapping[str, Callable[[Axis], str]]
) -> str:
    """Return the axes in columns, title -> text of an axis; a sensor's below its head.

    ``head`` names in braces the unit of its samples and that of its noise density.
    """
    parts = []
    for sensor, unit in UNITS.items():
        own = [axis for axis in axes if axis["axis"].startswith(sensor)]
        rows = [[axis["axis"][-1], *(text(axis) for text in columns.values())] for axis in own]
        parts.append(f"{sensor}: {head.format(unit=unit, density=DENSITIES[sensor])}")
        parts.append(table([["axis", *columns], *rows]))
    return "\n".join(parts)


def axis_panels(what: str, units: Mapping[str, str], below: str) -> tuple[Any, Any]:
    """Return a figure and (2, 3) panels, one for each axis."""
    made, panels = figure(12.0, 7.2, 2, 3, sharex=True, sharey="row")
    for panel, name in zip(panels.flat, CHANNELS, strict=True):
        panel.set_title(name)
    for row, unit in zip(panels, units.values(), strict=True):
        row[0].set_ylabel(f"{what} [{unit}]")
    for panel in panels[1]:
        panel.set_xlabel(below)
    return made, panels
