"""Hold the result of an aircraft calibration, as numbers and as a parameter file."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.aircraft_calibration.fit import AircraftFit
from tirgeo_ros.core.aircraft_calibration.mounting_level import (
    LEVEL,
    LEVEL_ADVICE,
    LEVEL_LIMIT_RAD,
    MountingLevel,
)
from tirgeo_ros.core.aircraft_calibration.parameters import (
    ANTENNA,
    DIRECTION,
    PARAMETERS,
    direction_b,
    imu_delay_s,
)
from tirgeo_ros.core.config import AircraftConfig, EkfConfig
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import euler_from_matrix, matrix_from_rotvec
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_output import Value, parameters_yaml
from tirgeo_ros.tools.calibrate.estimates import PER_UNIT, head_lines

_UNITS = ("m",) * 3 + ("deg",) * 2 + ("ms",) * 3
_LENGTH_M = 1.0  # of a baseline whose length is not configured


class AircraftResult(NamedTuple):
    """Hold the result of a calibration."""

    estimates: dict[str, dict[str, Any]]
    untold: dict[str, str]
    nis: dict[str, dict[str, float]]
    nodes: dict[str, dict[str, Value]]
    notes: list[str]


def summary(
    config: EkfConfig, found: AircraftFit, level: MountingLevel | None, hold: Collection[str]
) -> AircraftResult:
    """Return the result of a fit; ``level`` is None if the bag has no attitude."""
    estimates = {name: _estimate(found, PARAMETERS.index(name)) for name in found.told}
    untold = dict(found.untold)
    turn = np.zeros(3)
    if not set(LEVEL) <= set(hold):
        turn[:2] = _add_level(level, estimates, untold)
    parts = {
        "": _places(config.aircraft, found.values, set(estimates), turn),
        "ekf_node": _delays(config, found, set(estimates), rtk_held="rtk" in hold),
    }
    nodes = {node: values for node, values in parts.items() if values}
    nis = {
        source.value: {"before": value, "after": found.after.nis()[source]}
        for source, value in found.before.nis().items()
    }
    return AircraftResult(estimates, untold, nis, nodes, _notes(config, found))


def _estimate(found: AircraftFit, k: int) -> dict[str, Any]:
    values = (found.first[k], found.values[k], found.sigma[k], found.left_out[k])
    return _in_unit(_UNITS[k], values)


def _in_unit(unit: str, values: Iterable[float]) -> dict[str, Any]:
    numbers = [float(x) * PER_UNIT[unit] for x in values]
    names = ("before", "found", "sigma", "left_out")
    return {"unit": unit, **dict(zip(names, numbers, strict=True))}


def _add_level(
    level: MountingLevel | None, estimates: dict[str, dict[str, Any]], untold: dict[str, str]
) -> Array:
    """Add the level to ``estimates`` or ``untold``; return the IMU's turn about x, y, FRD, rad.

    Zero where the flight does not determine it.
    """
    turn = np.zeros(2)
    if level is None:
        untold |= dict.fromkeys(LEVEL, "no orientation in imu/data to compare with")
        return turn
    for k, (name, sign) in enumerate(zip(LEVEL, (1.0, -1.0), strict=True)):
        sigma = float(level.sigma_rad[k])
        if sigma > LEVEL_LIMIT_RAD:
            untold[name] = f"known to {math.degrees(sigma):.2g} deg only; fly {LEVEL_ADVICE}"
            continue
        turn[k] = level.angles_rad[k]
        estimates[name] = _in_unit("deg", (0.0, sign * turn[k], sigma, level.left_out_rad[k]))
    return turn


def _places(
    aircraft: AircraftConfig, values: Array, determined: Collection[str], turn: Array
) -> dict[str, Value]:
    """Return the aircraft's parameters; ``turn`` (3,) takes vectors onto the body axes, FRD."""
    found: dict[str, Value] = {}
    rotation, is_turned = matrix_from_rotvec(turn), bool(turn.any())
    antenna_m = np.array(aircraft.imu_m) + flu_from_frd(rotation @ flu_from_frd(values[ANTENNA]))
    moved = is_turned or not set(PARAMETERS[ANTENNA]).isdisjoint(determined)
    if moved:
        found["aircraft.rtk_antenna_m"] = _rounded(antenna_m)
    is_directed = not set(PARAMETERS[DIRECTION]).isdisjoint(determined)
    if is_directed or (moved and aircraft.second_antenna_m):
        given_m = aircraft.baseline_b
        length_m = _LENGTH_M if given_m is None else float(np.linalg.norm(given_m))
        direction = np.array(direction_b(*values[DIRECTION].tolist()))
        second_m = antenna_m + length_m * flu_from_frd(rotation @ direction)
        found["aircraft.second_antenna_m"] = _rounded(second_m)
    if is_turned:
        given_bi = aircraft.rotation_bi
        whole = rotation @ (np.eye(3) if given_bi is None else given_bi)
        angles = flu_from_frd(euler_from_matrix(whole))
        found["aircraft.imu_rpy_deg"] = _rounded(np.degrees(angles))
    return found


def _delays(
    config: EkfConfig, found: AircraftFit, determined: Collection[str], *, rtk_held: bool
) -> dict[str, Value]:
    """Return the filter's delays; with ``rtk_held`` the IMU's in place of the positions'."""
    position_s, velocity_s, heading_s = found.values[5:].tolist()
    imu_s = imu_delay_s(config)
    values: dict[str, float] = {}
    if "position_delay" in determined and rtk_held:
        values["imu.delay_s"] = imu_s = config.rtk.delay_s - position_s
    elif "position_delay" in determined:
        values["rtk.delay_s"] = imu_s + position_s
    has_velocities = "no rtk/vel" not in found.untold.get("velocity_delay", "")
    if "velocity_delay" in determined or ("position_delay" in determined and has_velocities):
        values["rtk.velocity_delay_s"] = velocity_s - position_s
    has_headings = "no rtk/heading" not in found.untold.get("heading_delay", "")
    if "heading_delay" in determined or ("rtk.delay_s" in values and has_headings):
        values["heading.delay_s"] = imu_s + heading_s  # if unset, it would be the delay of rtk
    return {name: round(value, 4) + 0.0 for name, value in values.items()}


def _rounded(vector: Array) -> list[float]:
    """Round to 4 decimals: 0.1 mm or 0.0001 deg."""
    return [round(number, 4) + 0.0 for number in vector.tolist()]


def _notes(config: EkfConfig, found: AircraftFit) -> list[str]:
    notes = []
    if "baseline_azimuth" in found.told:
        if config.aircraft.baseline_b is None:
            notes.append(
                f"headings do not tell how far the antennas are apart: {_LENGTH_M:g} m is written"
            )
        notes.append(
            "aircraft.second_antenna_m mends headings where the aircraft's messages are read "
            "(dji_node, tirgeo import); those in this bag stay as they are"
        )
    worst = max(found.after.nis().items(), key=lambda item: item[1])
    if worst[1] > 2.0:
        notes.append(
            f"the filter's innovations of {worst[0].value} are {math.sqrt(worst[1]):.1f} times "
            "what it foresees: check the IMU's noise (imu.*) and the sigmas of RTK"
        )
    return notes


def parameter_text(bag_in: PathLike, result: AircraftResult) -> str:
    """Return a parameter file of the estimates.

    Its head lists their sigmas, and the parameters that the flight does not determine.
    """
    lines = [
        f"Written by 'tirgeo calibrate aircraft' from {os.fspath(bag_in)}.",
        *head_lines(result.estimates),
        *(f"not told: {name}: {reason}" for name, reason in result.untold.items()),
        *result.notes,
    ]
    return parameters_yaml(result.nodes, "\n".join(lines))
