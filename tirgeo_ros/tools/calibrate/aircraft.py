"""Estimate antennas, delays and the IMU's level from a flight: ``tirgeo calibrate aircraft``."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from tirgeo_ros.core.calibration.aircraft_fit import LEVEL, PARTS, AircraftFit, fit, mounting_level
from tirgeo_ros.core.calibration.aircraft_parameters import ANTENNA, PARAMETERS
from tirgeo_ros.core.calibration.aircraft_run import FlightRuns, Recorded, longest_piece
from tirgeo_ros.core.navigation.aiding.state_estimate import Aiding
from tirgeo_ros.core.navigation.timeline.duplicates import DuplicateDetector, Same
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    ImuSample,
    PositionSample,
    VelocitySample,
)
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, write_files
from tirgeo_ros.io.parameters.parameter_file import Files, parameters_yaml, paths_of
from tirgeo_ros.tools.calibrate.aircraft_result import KEYS, aircraft_lines, summary
from tirgeo_ros.tools.calibrate.estimates import head
from tirgeo_ros.tools.calibrate.residual_plots import innovations_png
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight import Flight
from tirgeo_ros.tools.replay.flight_topics import resolved
from tirgeo_ros.tools.replay.node_configs import node_configs
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
    flight, found = Flight(reader, namespace, needs_camera=False), _Samples()
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


#: Names of ``hold`` and the parameters that each holds.
HOLDS = {
    "antenna": PARAMETERS[ANTENNA],
    "baseline": ("baseline_azimuth",),
    **{name: (name,) for name in ("position_delay", "velocity_delay", "heading_delay")},
    "level": LEVEL,
    # Holds the delay of its positions, so that the IMU's delay is estimated instead.
    "rtk": ("rtk",),
}
_USUAL_RUNS = 18


def calibrate_aircraft(
    bag_in: PathLike,
    output: PathLike | None = None,
    *,
    params: Files = None,
    hold: Collection[str] = (),
    namespace: str = "",
    plot: PathLike | None = None,
    progress: Report = silent,
) -> dict[str, object]:
    """Estimate the aircraft's parameters from a flight and write them; return a summary.

    ``hold`` lists keys of HOLDS; their parameters keep their values. ``plot`` is a PNG of the
    innovations. Raise CalibrationError if no parameter is determined, BagError, ConfigError.
    """
    configs = node_configs(params, namespace)
    config = configs.ekf
    check_outputs((bag_in, *paths_of(params), *configs.files), (output, plot), CalibrationError)
    held = [name for key in hold for name in HOLDS[key]]
    reader = BagReader(bag_in)
    read = read_aircraft(reader, namespace, config.max_imu_gap_s)
    runs = FlightRuns(read.recorded, config)
    found = _fitted(reader, runs, held, progress)
    level = mounting_level(found.after, runs.recorded.imu, PARTS)
    result = summary(config, found, level, held)
    numbers = {"parameters": result.estimates, "not_told": result.untold, "nis": result.nis}
    notes = read.notes + result.notes
    contents: dict[PathLike, str | bytes] = {}
    if output is not None:
        lines = head("aircraft", os.fspath(bag_in), aircraft_lines(numbers), notes)
        contents[output] = parameters_yaml(result.nodes, lines)
    if plot is not None:
        contents[plot] = innovations_png(found)
    write_files(contents, CalibrationError)
    return {
        "input": os.fspath(bag_in),
        "output": [os.fspath(path) for path in contents],
        **numbers,
        "seconds": read.seconds,
        "imu_samples": len(read.recorded.imu),
        "measurements": len(read.recorded.aids),
        "notes": notes,
        "error": None if reader.damage is None else f"{reader.path}: {reader.damage}",
    }


def _fitted(
    reader: BagReader, runs: FlightRuns, held: Sequence[str], progress: Report
) -> AircraftFit:
    """Return the fit; raise CalibrationError, with each reason once, if it has no parameter."""
    try:
        found = fit(runs, held, lambda done: progress(done, max(_USUAL_RUNS, done + 1)))
    except CalibrationError as error:
        raise CalibrationError(f"{reader.path}: {error}") from None
    if not found.told:
        names: dict[str, list[str]] = {}
        for name, reason in found.untold.items():
            names.setdefault(reason, []).append(f"{name} ({KEYS[name]})")
        named = "; ".join(f"{', '.join(some)}: {reason}" for reason, some in names.items())
        raise CalibrationError(f"{reader.path}: the flight shows no parameter: {named}")
    return found
