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
"""Estimate antennas, delays and the IMU's level from a flight: ``tirgeo calibrate aircraft``."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.aircraft_fit import (
    LEVEL,
    LEVEL_ADVICE,
    LEVEL_LIMIT_RAD,
    PARTS,
    AircraftFit,
    MountingLevel,
    fit,
    mounting_level,
)
from tirgeo_ros.core.calibration.aircraft_parameters import (
    ANTENNA,
    AZIMUTH,
    PARAMETERS,
    TABLE,
    baseline_b,
)
from tirgeo_ros.core.calibration.aircraft_run import FlightRuns, Recorded, longest_piece
from tirgeo_ros.core.config import AircraftConfig, EkfConfig
from tirgeo_ros.core.frames.rotations import euler_from_matrix, flu_from_frd, matrix_from_rotvec
from tirgeo_ros.core.navigation.aiding.aid import Aiding
from tirgeo_ros.core.navigation.timeline.aid_stamps import DuplicateDetector, Same
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    ImuSample,
    PositionSample,
    VelocitySample,
)
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs
from tirgeo_ros.io.parameters.parameter_file import Files, Value, paths_of
from tirgeo_ros.tools.calibrate.result import Result, estimate, estimates_table, written
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight import Flight
from tirgeo_ros.tools.replay.node_configs import node_configs
from tirgeo_ros.tools.replay.registration import Sample, topics_absent

_NEEDED = ("imu/data", "rtk/fix")
_LEAST_S = 20.0  # a shorter record is refused
#: Names of ``hold`` and the parameters that each holds.
HOLDS = {
    "antenna": PARAMETERS[ANTENNA],
    "baseline": ("baseline_azimuth",),
    **{name: (name,) for name in ("position_delay", "velocity_delay", "heading_delay")},
    "level": LEVEL,
    # The delay of RTK positions is held, and the IMU's delay is estimated instead.
    "rtk": ("rtk",),
}
#: Node and name of the parameter of each value; with ``hold`` rtk, position_delay is imu.delay_s.
KEYS = {name: row.key for name, row in TABLE.items()} | dict.fromkeys(
    LEVEL, "aircraft.imu_rpy_deg"
)
_LENGTH_M = 1.0  # length that is written for a baseline whose length is not configured
_USUAL_RUNS = 18  # runs of the filter that a fit usually needs, for the progress bar


def calibrate_aircraft(
    bag: PathLike,
    output: PathLike | None = None,
    *,
    params: Files = None,
    hold: Collection[str] = (),
    namespace: str = "",
    progress: Report = silent,
) -> dict[str, object]:
    """Estimate the aircraft's parameters from a flight and write them; return a summary.

    ``hold`` lists keys of HOLDS; their parameters keep their values. Raise CalibrationError if no
    parameter is determined, BagError, ConfigError.
    """
    configs = node_configs(params, namespace)
    config = configs.ekf
    check_outputs((bag, *paths_of(params), *configs.files), (output,), CalibrationError)
    held = [name for key in hold for name in HOLDS[key]]
    reader = BagReader(bag)
    recorded, seconds, notes = _read(reader, namespace, config.max_imu_gap_s)
    runs = FlightRuns(recorded, config)
    try:
        fitted = fit(runs, held, lambda done: progress(done, max(_USUAL_RUNS, done + 1)))
        _check_determined(fitted)
    except CalibrationError as error:
        raise CalibrationError(f"{reader.path}: {error}") from None
    level = mounting_level(fitted.after, runs.recorded.imu, PARTS)
    result = _result(config, fitted, level, held, notes)
    numbers = {
        "seconds": seconds,
        "imu_samples": len(recorded.imu),
        "measurements": len(recorded.aids),
        "notes": result.notes,
    }
    lines = aircraft_lines(result.numbers)
    files = [(output, lambda: result.yaml("aircraft", bag, lines))]
    return {"input": os.fspath(bag)} | written(files, result.numbers | numbers, reader)


class _Samples:
    """Collect a flight's usable samples; of measurements with one source and stamp, the first."""

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


def _read(
    reader: BagReader, namespace: str, max_gap_s: float
) -> tuple[Recorded, float, list[str]]:
    """Read a bag once; return the longest part of it whose IMU samples have no gap.

    Return also the length of the part (s), and notes on what was left out. Raise BagError if a
    needed topic is absent, CalibrationError if the part is too short.
    """
    flight, samples = Flight(reader, namespace, needs_camera=False), _Samples()
    for topic in _NEEDED:
        if not flight.has(topic):
            raise topics_absent(reader, [(topic,)], namespace)
    flight.add(samples.topics, samples.take)
    flight.read_all(silent)
    if flight.refused:
        samples.left_out["unreadable messages"] = flight.refused
    notes = [f"left out: {number} {what}" for what, number in samples.left_out.items()]
    begin, end = longest_piece(samples.imu, max_gap_s) if samples.imu else (0, 0)
    piece = samples.imu[begin:end]
    seconds = (piece[-1].stamp_ns - piece[0].stamp_ns) * 1e-9 if piece else 0.0
    if seconds < _LEAST_S:
        raise CalibrationError(
            f"{reader.path}: only {seconds:.1f} s of imu/data without a gap; record a flight of "
            "three minutes with turns"
        )
    if len(piece) < len(samples.imu):
        notes.append(f"imu/data has gaps: the longest part, {seconds:.0f} s, is used")
    return Recorded(piece, list(samples.aids.values())), seconds, notes


def _check_determined(fitted: AircraftFit) -> None:
    """Raise CalibrationError, with each reason once, if a fit determined no parameter."""
    if not fitted.determined:
        names: dict[str, list[str]] = {}
        for name, reason in fitted.undetermined.items():
            names.setdefault(reason, []).append(f"{name} ({KEYS[name]})")
        named = "; ".join(f"{', '.join(group)}: {reason}" for reason, group in names.items())
        raise CalibrationError(f"the flight determines no parameter: {named}")


def _result(
    config: EkfConfig,
    fitted: AircraftFit,
    level: MountingLevel | None,
    held: Collection[str],
    notes: list[str],
) -> Result:
    """Return the result of a fit; ``level`` is None if the bag has no attitude."""
    rows = zip(TABLE.items(), fitted.first, fitted.values, fitted.sigma, strict=True)
    estimates = {
        name: estimate(row.key, row.unit, *numbers)
        for (name, row), *numbers in rows
        if name in fitted.determined
    }
    reasons = dict(fitted.undetermined)
    turn = np.zeros(3)
    if not set(LEVEL) <= set(held):
        turn[:2] = _add_level(level, estimates, reasons)
    parts = {
        "": _places(config, fitted.values, set(estimates), turn),
        "ekf_node": _delays(config, fitted, set(estimates), rtk_held="rtk" in held),
    }
    nodes = {node: values for node, values in parts.items() if values}
    nis = {
        source.value: {"before": value, "after": fitted.after.nis()[source]}
        for source, value in fitted.before.nis().items()
    }
    numbers = {"parameters": estimates, "not_told": reasons, "nis": nis}
    return Result(numbers, nodes, notes + _notes(config.aircraft, fitted))


def _add_level(
    level: MountingLevel | None, estimates: dict[str, dict[str, Any]], reasons: dict[str, str]
) -> Array:
    """Add the level to ``estimates`` or ``reasons``; return the IMU's turn about x, y, FRD, rad.

    The turn is zero about an axis for which the flight does not determine it.
    """
    turn = np.zeros(2)
    if level is None:
        reasons |= dict.fromkeys(LEVEL, "no orientation in imu/data to compare with")
        return turn
    for k, (name, sign) in enumerate(zip(LEVEL, (1.0, -1.0), strict=True)):
        sigma = float(level.sigma_rad[k])
        if sigma > LEVEL_LIMIT_RAD:
            reasons[name] = f"sigma is {math.degrees(sigma):.2g} deg; fly {LEVEL_ADVICE}"
            continue
        turn[k] = level.angles_rad[k]
        estimates[name] = estimate(KEYS[name], "deg", 0.0, sign * turn[k], sigma)
    return turn


def _places(
    config: EkfConfig, values: Array, determined: Collection[str], turn: Array
) -> dict[str, Value]:
    """Return the aircraft's parameters; ``turn`` (3,) rotates vectors to the body axes, FRD."""
    aircraft = config.aircraft
    placed: dict[str, Value] = {}
    rotation, is_turned = matrix_from_rotvec(turn), bool(turn.any())
    antenna_m = np.array(aircraft.imu_m) + flu_from_frd(rotation @ flu_from_frd(values[ANTENNA]))
    moved = is_turned or not set(PARAMETERS[ANTENNA]).isdisjoint(determined)
    if moved:
        placed["aircraft.rtk_antenna_m"] = _rounded(antenna_m)
    if PARAMETERS[AZIMUTH] in determined or (moved and aircraft.second_antenna_m):
        given_m = aircraft.baseline_b
        length_m = _LENGTH_M if given_m is None else float(np.linalg.norm(given_m))
        direction = baseline_b(config, float(values[AZIMUTH]))
        second_m = antenna_m + length_m * flu_from_frd(rotation @ direction)
        placed["aircraft.second_antenna_m"] = _rounded(second_m)
    if is_turned:
        given_bi = aircraft.rotation_bi
        whole = rotation @ (np.eye(3) if given_bi is None else given_bi)
        angles = flu_from_frd(euler_from_matrix(whole))
        placed["aircraft.imu_rpy_deg"] = _rounded(np.degrees(angles))
    return placed


def _delays(
    config: EkfConfig, fitted: AircraftFit, determined: Collection[str], *, rtk_held: bool
) -> dict[str, Value]:
    """Return the filter's delays; with ``rtk_held`` the IMU's in place of the positions'."""
    position_s, velocity_s, heading_s = fitted.values[4:].tolist()
    imu_s = config.imu.delay_s
    values: dict[str, float] = {}
    if "position_delay" in determined and rtk_held:
        values["imu.delay_s"] = imu_s = config.rtk.delay_s - position_s
    elif "position_delay" in determined:
        values["rtk.delay_s"] = imu_s + position_s
    has_velocities = "no rtk/vel" not in fitted.undetermined.get("velocity_delay", "")
    if "velocity_delay" in determined or ("position_delay" in determined and has_velocities):
        values["rtk.velocity_delay_s"] = velocity_s - position_s
    has_headings = "no rtk/heading" not in fitted.undetermined.get("heading_delay", "")
    if "heading_delay" in determined or ("rtk.delay_s" in values and has_headings):
        values["heading.delay_s"] = imu_s + heading_s  # if unset, it would be the delay of rtk
    return {name: round(value, 4) + 0.0 for name, value in values.items()}


def _rounded(vector: Array) -> list[float]:
    """Round to 4 decimals: 0.1 mm or 0.0001 deg."""
    return [round(number, 4) + 0.0 for number in vector.tolist()]


def _notes(aircraft: AircraftConfig, fitted: AircraftFit) -> list[str]:
    notes = []
    if "baseline_azimuth" in fitted.determined:
        if aircraft.baseline_b is None:
            notes.append(
                "headings do not determine the distance between the antennas: "
                f"{_LENGTH_M:g} m is written"
            )
        notes.append(
            "aircraft.second_antenna_m corrects headings when the aircraft's messages "
            "are read (dji_node, tirgeo import); the headings in this bag stay as they are"
        )
    worst, nis = max(fitted.after.nis().items(), key=lambda item: item[1])
    if nis > 2.0:
        notes.append(
            f"the filter's innovations of {worst.value} are {math.sqrt(nis):.1f} times as large "
            "as predicted: check the IMU's noise (imu.*) and the sigmas of RTK"
        )
    return notes


def aircraft_lines(result: Mapping[str, Any]) -> list[str]:
    """Return the estimates as a table, what was not determined, and the innovations' size."""
    nis = [
        f"{source} {row['before']:.3g} before, {row['after']:.2f} after"
        for source, row in result["nis"].items()
    ]
    return [
        *estimates_table(result["parameters"]),
        *(f"not found: {n} ({KEYS[n]}): {why}" for n, why in result["not_told"].items()),
        f"squared innovations over their predicted variance: {'; '.join(nis)}",
    ]
