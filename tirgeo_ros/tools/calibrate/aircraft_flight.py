"""Read a recorded flight into memory, for a calibration that filters it many times."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass

from tirgeo_ros.core.aircraft_calibration.filter_run import Recorded, longest_piece
from tirgeo_ros.core.navigation.aiding.state_estimate import Aiding
from tirgeo_ros.core.navigation.duplicates import DuplicateDetector, Same
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    ImuSample,
    PositionSample,
    VelocitySample,
)
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.presentation.progress import silent
from tirgeo_ros.tools.replay.flight_poses import RecordedFlight
from tirgeo_ros.tools.replay.flight_topics import resolved
from tirgeo_ros.tools.replay.registration import Sample

_NEEDED = ("imu/data", "rtk/fix")
_LEAST_S = 20.0


@dataclass(frozen=True)
class ReadAircraft:
    """Hold a flight, its length (s) and notes on what was left out of it."""

    recorded: Recorded
    seconds: float
    notes: list[str]


class _Samples:
    """Take the usable samples of a flight; no two measurements of one source and stamp."""

    topics: Collection[str] = (*_NEEDED, "rtk/vel", "rtk/heading")

    def __init__(self) -> None:
        self.imu: list[ImuSample] = []
        self.aids: dict[object, Aiding] = {}
        self.left_out: Counter[str] = Counter()
        self._repeats = DuplicateDetector()

    def take(self, sample: Sample) -> None:
        """Take a sample of ``topics``, in order of arrival."""
        if not isinstance(sample, ImuSample | PositionSample | VelocitySample | HeadingSample):
            return
        if fault_of(sample):
            self.left_out["invalid samples"] += 1
        elif isinstance(sample, ImuSample):
            if self.imu and sample.stamp_ns <= self.imu[-1].stamp_ns:
                self.left_out["samples of imu/data out of order"] += 1
            else:
                self.imu.append(sample)
        elif self._repeats.compared(sample) is not Same.MEASUREMENT:
            self.aids.setdefault((sample.source, sample.stamp_ns), sample)


def read_aircraft(reader: BagReader, namespace: str, max_gap_s: float) -> ReadAircraft:
    """Read a bag once; return the longest part of its IMU's record without a gap.

    Raise BagError if a needed topic is absent, CalibrationError if the part is too short.
    """
    flight, found = RecordedFlight(reader, namespace, needs_camera=False), _Samples()
    for topic in _NEEDED:
        if not flight.has(topic):
            hint = "" if namespace else "; is there a --namespace?"
            raise BagError(
                f"{reader.path}: needed topic absent: {resolved(topic, namespace)}{hint}"
            )
    flight.add(found.topics, found.take)
    flight.read_all(silent)
    if flight.refused:
        found.left_out["unreadable messages"] = flight.refused
    notes = [f"left out: {number} {what}" for what, number in found.left_out.items()]
    begin, end = longest_piece(found.imu, max_gap_s) if found.imu else (0, 0)
    piece = found.imu[begin:end]
    seconds = (piece[-1].stamp_ns - piece[0].stamp_ns) * 1e-9 if piece else 0.0
    if seconds < _LEAST_S:
        raise CalibrationError(
            f"{reader.path}: only {seconds:.1f} s of imu/data without a gap; record a flight of "
            "three minutes with turns"
        )
    if len(piece) < len(found.imu):
        notes.append(f"imu/data has gaps: the longest part, {seconds:.0f} s, is used")
    return ReadAircraft(Recorded(piece, list(found.aids.values())), seconds, notes)
