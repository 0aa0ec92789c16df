"""Convert the fit of an aircraft calibration to parameters, numbers and lines."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.aircraft_fit import (
    LEVEL,
    LEVEL_ADVICE,
    LEVEL_LIMIT_RAD,
    AircraftFit,
    MountingLevel,
)
from tirgeo_ros.core.calibration.aircraft_parameters import (
    ANTENNA,
    AZIMUTH,
    PARAMETERS,
    baseline_b,
)
from tirgeo_ros.core.config import AircraftConfig, EkfConfig
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import euler_from_matrix, matrix_from_rotvec
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io.parameters.parameter_file import Value
from tirgeo_ros.tools.calibrate.estimates import estimate, table

_UNITS = ("m", "m", "m", "deg", "ms", "ms", "ms")
#: Node and name of the parameter that holds each value; positions' with ``hold`` rtk: imu.delay_s.
KEYS = dict(
    zip(
        (*PARAMETERS, *LEVEL),
        (
            *["aircraft.rtk_antenna_m"] * 3,
            "aircraft.second_antenna_m",
            *("ekf_node rtk.delay_s", "ekf_node rtk.velocity_delay_s", "ekf_node heading.delay_s"),
            *["aircraft.imu_rpy_deg"] * 2,
        ),
        strict=True,
    )
)
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
    columns = zip(_UNITS, found.first, found.values, found.sigma, found.left_out, strict=True)
    numbers = dict(zip(PARAMETERS, columns, strict=True))
    estimates = {name: estimate(KEYS[name], *numbers[name]) for name in found.told}
    untold = dict(found.untold)
    turn = np.zeros(3)
    if not set(LEVEL) <= set(hold):
        turn[:2] = _add_level(level, estimates, untold)
    parts = {
        "": _places(config, found.values, set(estimates), turn),
        "ekf_node": _delays(config, found, set(estimates), rtk_held="rtk" in hold),
    }
    nodes = {node: values for node, values in parts.items() if values}
    nis = {
        source.value: {"before": value, "after": found.after.nis()[source]}
        for source, value in found.before.nis().items()
    }
    return AircraftResult(estimates, untold, nis, nodes, _notes(config.aircraft, found))


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
        numbers = 0.0, sign * turn[k], sigma, level.left_out_rad[k]
        estimates[name] = estimate(KEYS[name], "deg", *numbers)
    return turn


def _places(
    config: EkfConfig, values: Array, determined: Collection[str], turn: Array
) -> dict[str, Value]:
    """Return the aircraft's parameters; ``turn`` (3,) takes vectors onto the body axes, FRD."""
    aircraft = config.aircraft
    found: dict[str, Value] = {}
    rotation, is_turned = matrix_from_rotvec(turn), bool(turn.any())
    antenna_m = np.array(aircraft.imu_m) + flu_from_frd(rotation @ flu_from_frd(values[ANTENNA]))
    moved = is_turned or not set(PARAMETERS[ANTENNA]).isdisjoint(determined)
    if moved:
        found["aircraft.rtk_antenna_m"] = _rounded(antenna_m)
    if PARAMETERS[AZIMUTH] in determined or (moved and aircraft.second_antenna_m):
        given_m = aircraft.baseline_b
        length_m = _LENGTH_M if given_m is None else float(np.linalg.norm(given_m))
        direction = baseline_b(config, float(values[AZIMUTH]))
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
    position_s, velocity_s, heading_s = found.values[4:].tolist()
    imu_s = config.imu.delay_s
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


def _notes(aircraft: AircraftConfig, found: AircraftFit) -> list[str]:
    notes = []
    if "baseline_azimuth" in found.told:
        if aircraft.baseline_b is None:
            notes.append(
                f"headings do not determine how far apart the antennas are: {_LENGTH_M:g} m is "
                "written"
            )
        notes.append(
            "aircraft.second_antenna_m corrects headings where the aircraft's messages "
            "are read (dji_node, tirgeo import); those in this bag stay as they are"
        )
    worst, nis = max(found.after.nis().items(), key=lambda item: item[1])
    if nis > 2.0:
        notes.append(
            f"the filter's innovations of {worst.value} are {math.sqrt(nis):.1f} times as large "
            "as predicted: check the IMU's noise (imu.*) and the sigmas of RTK"
        )
    return notes


def aircraft_lines(result: Mapping[str, Any]) -> list[str]:
    """Return the estimates as a table, what was not determined, and the innovations' size."""
    nis = [
        f"{source} {one['before']:.3g} before, {one['after']:.2f} after"
        for source, one in result["nis"].items()
    ]
    return [
        *table(result["parameters"]),
        *(f"not found: {n} ({KEYS[n]}): {why}" for n, why in result["not_told"].items()),
        f"squared innovations over their predicted variance: {'; '.join(nis)}",
    ]
