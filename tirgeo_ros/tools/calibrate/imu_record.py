"""Stream an IMU record, at rest or in flight, from a bag into the estimators of its noise."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import TypeVar

import numpy as np

from tirgeo_ros.core.calibration.allan.deviation import AllanStream
from tirgeo_ros.core.calibration.allan.flight_noise import PieceStream
from tirgeo_ros.core.calibration.allan.sample_grid import Piece, SampleGrid
from tirgeo_ros.core.calibration.allan.sample_runs import SampleRuns
from tirgeo_ros.core.calibration.allan.spectral_lines import SpectrumStream
from tirgeo_ros.core.calibration.allan.stillness import SecondStream
from tirgeo_ros.core.navigation.imu_clipping import Clipping
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages.imu_block import ImuBlock, imu_block
from tirgeo_ros.tools.presentation.progress import Report, silent

CHANNELS = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
_TYPE = "sensor_msgs/msg/Imu"
_BLOCK = 1 << 15  # messages decoded together
_SLACK_S = 60.0  # stop reading at messages logged this long after the last wanted stamp
_LEAST_HZ = 5.0
_MOST_MISSING = 0.2


@dataclass
class ImuRecord:
    """Hold what has been read of a record; the streams are those of the core."""

    topic: str  # resolved
    from_s: float = 0.0  # start of the record after the first message
    grid: SampleGrid = field(default_factory=SampleGrid)
    messages: int = 0
    unreadable: int = 0
    first_ns: int | None = None

    def add(self, block: ImuBlock) -> None:
        """Add messages. Raise CalibrationError if they have no regular rate."""
        self.unreadable += block.unreadable
        for piece in self.grid.add(block.stamps_ns, block.values):
            self.take(piece)

    def take(self, piece: Piece) -> None:
        """Add consecutive grid slots to the streams."""


@dataclass
class RestRecord(ImuRecord):
    """Hold the record of an IMU at rest."""

    allan: AllanStream = field(default_factory=AllanStream)
    seconds: SecondStream | None = None
    spectrum: SpectrumStream | None = None

    def take(self, piece: Piece) -> None:
        """Add consecutive grid slots to the streams."""
        if self.seconds is None or self.spectrum is None:
            self.seconds = SecondStream(self.grid.step_ns)
            self.spectrum = SpectrumStream(self.grid.step_ns)
        self.allan.add(piece)
        self.seconds.add(piece)
        self.spectrum.add(piece)


@dataclass
class FlightRecord(ImuRecord):
    """Hold the record of an IMU in flight."""

    grid: SampleGrid = field(default_factory=SampleRuns)
    stream: PieceStream | None = None
    clipping: Clipping = field(default_factory=Clipping)

    def add(self, block: ImuBlock) -> None:
        """Add messages. Raise CalibrationError if they have no regular rate."""
        super().add(block)
        finite = np.isfinite(block.values).all(axis=1)
        stamps_ns, rows = block.stamps_ns[finite].tolist(), block.values[finite]
        for stamp_ns, values in zip(stamps_ns, rows, strict=True):
            self.clipping.add(ImuSample(stamp_ns, values[3:], values[:3]))

    def take(self, piece: Piece) -> None:
        """Add consecutive grid slots to the stream."""
        if self.stream is None:
            self.stream = PieceStream(self.grid.step_ns)
        self.stream.add(piece)


Record = TypeVar("Record", bound=ImuRecord)


def read_record(
    reader: BagReader,
    record: Record,
    to_s: float = math.inf,
    progress: Report = silent,
) -> Record:
    """Fill a record from its topic, up to a time (s) since the topic's first message.

    Raise BagError for a topic that is absent or no Imu, CalibrationError for an unusable record.
    """
    name = record.topic
    _check(reader, name)
    for block in _blocks(reader, name, to_s, progress):
        record.messages += len(block.stamps_ns) + block.unreadable
        if record.first_ns is None and len(block.stamps_ns):
            record.first_ns = int(block.stamps_ns[0])
        since_s = (block.stamps_ns - (record.first_ns or 0)) * 1e-9
        wanted = (since_s >= record.from_s) & (since_s <= to_s)
        try:
            record.add(ImuBlock(block.stamps_ns[wanted], block.values[wanted], block.unreadable))
        except CalibrationError as error:
            raise CalibrationError(f"{reader.path}: {name}: {error}") from None
    _check_record(reader, name, record)
    return record


def _check(reader: BagReader, name: str) -> None:
    topics = reader.topics()
    if topics.get(name) != _TYPE:
        others = ", ".join(topic for topic, kind in topics.items() if kind == _TYPE) or "none"
        what = f"is of type {topics[name] or 'nothing'}" if name in topics else "is not there"
        raise BagError(
            f"{reader.path}: {name} {what}; topics of {_TYPE}: {others}; "
            "give --topic or --namespace"
        )


def _blocks(reader: BagReader, name: str, to_s: float, progress: Report) -> Iterator[ImuBlock]:
    begin_ns, end_ns = reader.span_ns
    span_s = min((end_ns - begin_ns) * 1e-9, to_s)
    messages = reader.messages([name])
    while chunk := list(islice(messages, _BLOCK)):
        yield imu_block([message.data for message in chunk])
        done_s = (chunk[-1].log_time_ns - begin_ns) * 1e-9
        progress(done_s, span_s)
        if done_s > to_s + _SLACK_S:
            return


def _check_record(reader: BagReader, name: str, record: ImuRecord) -> None:
    where = f"{reader.path}: {name}"
    counts, grid = record.grid.irregularities, record.grid
    if not counts.samples:
        raise CalibrationError(
            f"{where}: none of {record.messages} messages has a sample; look at --from and --to"
        )
    rate_hz = 1e9 / grid.mean_step_ns
    if rate_hz < _LEAST_HZ:
        raise CalibrationError(
            f"{where}: {rate_hz:.3g} samples a second are too few; record at 50 Hz or more"
        )
    missing = counts.missing + counts.not_finite
    if missing > _MOST_MISSING * (counts.samples + missing):
        raise CalibrationError(
            f"{where}: {missing} samples are missing or not finite beside {counts.samples} good "
            "ones; record again without loss, with the sensor's own stamps"
        )
