"""Read an IMU's record, at rest or in flight, from a bag."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import islice

import numpy as np

from tirgeo_ros.core.calibration.allan.record import ImuRecord, record_of
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages.imu_block import imu_block
from tirgeo_ros.tools.presentation.progress import Report, silent

CHANNELS = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
#: Sensor -> the unit of its samples.
UNITS = {"gyro": "rad/s", "accel": "m/s2"}
_TYPE = "sensor_msgs/msg/Imu"
_BLOCK = 1 << 15  # messages decoded together
_SLACK_S = 60.0  # stop reading at messages logged this long after the last wanted stamp
_LEAST_HZ = 5.0


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
    return ReadImu(where, topic, record, number, unreadable)


def _check_topic(reader: BagReader, name: str) -> None:
    topics = reader.topics()
    if topics.get(name) != _TYPE:
        others = ", ".join(topic for topic, kind in topics.items() if kind == _TYPE) or "none"
        what = f"is of type {topics[name] or 'nothing'}" if name in topics else "is not there"
        raise BagError(
            f"{reader.path}: {name} {what}; topics of {_TYPE}: {others}; "
            "give --topic or --namespace"
        )
