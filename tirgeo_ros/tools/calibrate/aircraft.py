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
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.aircraft_fit import (
    LEVEL,
    LEVEL_ADVICE,
    LEVEL_LIMIT_RAD,
    PARTS,
    AircraftFit,
    expected_biases,
    final_biases,
    fit,
    mounting_level,
)
from tirgeo_ros.core.calibration.aircraft_parameters import (
    ANTENNA,
    AZIMUTH,
    DELAYS,
    PARAMETERS,
    TABLE,
    baseline_b,
)
from tirgeo_ros.core.calibration.aircraft_run import FlightRuns, Recorded, longest_piece
from tirgeo_ros.core.config import AircraftConfig, EkfConfig, ImuConfig
from tirgeo_ros.core.frames.rotations import euler_from_matrix, flu_from_frd, matrix_from_rotvec
from tirgeo_ros.core.navigation.aiding.aid import Aiding
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases
from tirgeo_ros.core.navigation.ins.imu_delay import LONGEST_SIGMAS
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
    # The delay of RTK positions is held, and the IMU's delay is estimated instead.
    "rtk": ("rtk",),
}
#: Node and name of the parameter of each value; with ``hold`` rtk, position_delay is imu.delay_s.
KEYS = {name: row.key for name, row in TABLE.items()} | dict.fromkeys(
    LEVEL, "aircraft.imu_rpy_deg"
)
#: Delays that differ by less than so many sigmas are alike.
_SIGMAS = 3.0
_LONGEST_IMU_S = LONGEST_SIGMAS * ImuConfig().delay_sigma_s
_TURNED = (
    "aircraft.imu_rpy_deg turns base_link, in which the boresight is measured: calibrate the "
    "boresight again with this file"
)
_LENGTH_M = 1.0  # length that is written for a baseline whose length is not configured
_USUAL_RUNS = 18  # runs of the filter that a fit usually needs, for the progress bar


def calibrate_aircraft(
    bag: PathLike,
    output: PathLike | None = None,
    *,
    params: Files = None,
    more: Sequence[PathLike] = (),
    hold: Collection[str] = (),
    level: bool = False,
    namespace: str = "",
    progress: Report = silent,
) -> dict[str, object]:
    """Estimate the aircraft's parameters from a flight and write them; return a summary.

    With ``more`` flights of the aircraft, all flights' biases are what the next one begins with.
    ``hold`` lists keys of HOLDS; their parameters keep their values. ``level`` finds the IMU's
    level against the autopilot's, too. Raise CalibrationError if no parameter is determined,
    BagError, ConfigError.
    """
    configs = node_configs(params, namespace)
    config = configs.ekf
    check_outputs((bag, *more, *paths_of(params), *configs.files), (output,), CalibrationError)
    held = [name for key in hold for name in HOLDS[key]]
    reader = BagReader(bag)
    recorded, seconds, notes = _read(reader, namespace, config.max_imu_gap_s)
    runs = FlightRuns(recorded, config)
    try:
        fitted = fit(runs, held, lambda done: progress(done, max(_USUAL_RUNS, done + 1)))
        if not more:
            _check_determined(fitted)
    except CalibrationError as error:
        raise CalibrationError(f"{reader.path}: {error}") from None
    result = _result(config, fitted, held, notes, runs.recorded.imu if level else ())
    if more:
        others = [_biases(path, config, namespace, fitted.values) for path in more]
        _add_biases(result, config, [fitted.after.biases, *others])
    numbers = {
        "seconds": seconds,
        "imu_samples": len(recorded.imu),
        "measurements": len(recorded.aids),
        "notes": result.notes,
    }
    lines = aircraft_lines(result.numbers)
    files = [(output, lambda: result.yaml("aircraft", bag, lines))]
    return {"input": os.fspath(bag)} | written(files, result.numbers | numbers, reader)


def _biases(path: PathLike, config: EkfConfig, namespace: str, values: Array) -> Biases:
    """Return the biases at the end of another flight. Raise BagError, CalibrationError."""
    recorded, _, _ = _read(BagReader(path), namespace, config.max_imu_gap_s)
    try:
        return final_biases(FlightRuns(recorded, config), values)
    except CalibrationError as error:
        raise CalibrationError(f"{os.fspath(path)}: {error}") from None


def _add_biases(result: Result, config: EkfConfig, flights: Sequence[Biases]) -> None:
    """Add what to expect of the IMU's biases by several flights."""
    means, sigmas = expected_biases(flights)
    result.notes.append(f"the IMU's biases are the mean of {len(flights)} flights")
    before = flu_from_frd(config.imu.bias_b.reshape(2, 3))
    written = result.nodes.setdefault("ekf_node", {})
    for k, (name, unit) in enumerate((("gyro", "deg/s"), ("accel", "m/s2"))):
        mean, sigma = flu_from_frd(means[k]), float(sigmas[k])
        for axis, old, new in zip(("forward", "left", "up"), before[k], mean, strict=True):
            row = estimate(f"imu.{name}_bias", unit, old, new, sigma)
            result.numbers["parameters"][f"{name}_bias_{axis}"] = row
        written[f"imu.{name}_bias"] = [round(value, 6) + 0.0 for value in mean.tolist()]
        written[f"imu.{name}_turn_on_bias"] = round(sigma, 6)


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
    held: Collection[str],
    notes: list[str],
    imu: Sequence[ImuSample],
) -> Result:
    """Return the result of a fit; the autopilot's attitudes in ``imu``, if any, level the IMU."""
    rows = zip(TABLE.items(), fitted.first, fitted.values, fitted.sigma, strict=True)
    estimates = {
        name: estimate(row.key, row.unit, *numbers)
        for (name, row), *numbers in rows
        if name in fitted.determined
    }
    reasons = dict(fitted.undetermined)
    turn = np.zeros(3)
    if imu:
        turn[:2] = _add_level(config, fitted, imu, estimates, reasons)
    delays = _shared_delay(config, fitted) or _delays(
        config, fitted, set(estimates), rtk_held="rtk" in held
    )
    parts = {
        "": _places(config, fitted.values, set(estimates), turn),
        "ekf_node": delays,
    }
    nodes = {node: values for node, values in parts.items() if values}
    nis = {
        source.value: {"before": value, "after": fitted.after.nis()[source]}
        for source, value in fitted.before.nis().items()
    }
    numbers = {"parameters": estimates, "not_told": reasons, "nis": nis}
    more = [_TURNED] if turn.any() else []
    return Result(numbers, nodes, notes + _notes(config.aircraft, fitted) + more)


def _add_level(
    config: EkfConfig,
    fitted: AircraftFit,
    imu: Sequence[ImuSample],
    estimates: dict[str, dict[str, Any]],
    reasons: dict[str, str],
) -> Array:
    """Add the level to ``estimates`` or ``reasons``; return the IMU's turn about x, y, FRD, rad.

    The turn is zero about an axis for which the flight does not determine it. The sigma of the
    autopilot's own level is the configured one: its error is constant, so no flight shows it.
    """
    turn = np.zeros(2)
    level = mounting_level(fitted.after, imu, PARTS)
    if level is None:
        reasons |= dict.fromkeys(LEVEL, "no orientation in imu/data to compare with")
        return turn
    for k, (name, sign) in enumerate(zip(LEVEL, (1.0, -1.0), strict=True)):
        sigma = float(level.sigma_rad[k])
        if sigma > LEVEL_LIMIT_RAD:
            reasons[name] = f"sigma is {math.degrees(sigma):.2g} deg; fly {LEVEL_ADVICE}"
            continue
        turn[k] = level.angles_rad[k]
        sigma = math.hypot(sigma, math.radians(config.autopilot.attitude_sigma_deg[k]))
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


def _shared_delay(config: EkfConfig, fitted: AircraftFit) -> dict[str, Value]:
    """Return the IMU's delay if all delays of RTK are off by the same; empty if they are not.

    Then the IMU's stamps are off by as much, the other way. More than IMUs have is not theirs.
    """
    chosen = [k for k in DELAYS.values() if PARAMETERS[k] in fitted.determined]
    if len(chosen) < 2:
        return {}
    off_s, weights = (fitted.values - fitted.first)[chosen], fitted.sigma[chosen] ** -2
    mean_s, sigma_s = np.average(off_s, weights=weights), weights.sum() ** -0.5
    if (np.abs(off_s - mean_s) > _SIGMAS * fitted.sigma[chosen]).any():
        return {}
    if not _SIGMAS * sigma_s < abs(mean_s) < _LONGEST_IMU_S:
        return {}
    delay_s = config.imu.delay_s - float(mean_s)
    return {"imu.delay_s": round(delay_s, 4), "imu.delay_sigma_s": round(float(sigma_s), 4)}


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
