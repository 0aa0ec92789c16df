"""Convert the fit of a boresight calibration to parameters, numbers and lines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.boresight_fit import BoresightFit, ground_errors, rmse_m
from tirgeo_ros.core.calibration.boresight_model import PARAMETERS
from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.core.frames.rotations import rotation_z
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io.parameters.parameter_file import Value
from tirgeo_ros.tools.calibrate.boresight_flight import ReadFlight
from tirgeo_ros.tools.calibrate.estimates import estimate, table
from tirgeo_ros.tools.replay.node_configs import NodeConfigs

#: Residuals larger than expected by this factor cause a note.
_MUCH = 2.0
_UNITS = {"latency": "ms", "ground_height": "m"}  # all others: deg
_SECOND = "aircraft.second_antenna_m"


class BoresightResult(NamedTuple):
    """Hold the result of a calibration."""

    numbers: dict[str, Any]  # for JSON: residuals in px, lengths on the ground in m
    nodes: dict[str, dict[str, Value]]
    notes: list[str]


def key_of(name: str, by_encoders: bool) -> str:
    """Return node and name of the parameter that holds one of PARAMETERS."""
    return {
        "latency": "overlay_node video_latency_s",
        "gimbal_north": f"gimbal_node {'yaw_zero_deg' if by_encoders else 'north.bias_deg'}",
        "heading_offset": _SECOND,
        "ground_height": "overlay_node ground_height_m",
    }.get(name, "gimbal_node boresight_rpy_deg")


def summary(read: ReadFlight, configs: NodeConfigs, found: BoresightFit) -> BoresightResult:
    """Return the result of a fit. Raise ConfigError if a parameter would be out of its range."""
    used = [one for one, is_used in zip(read.sightings, found.used, strict=True) if is_used]
    present = _present(read, configs)
    estimates = {}
    for name, sigma in found.sigma.items():
        before, change = (vector[PARAMETERS.index(name)] for vector in (present, found.correction))
        numbers = before, before + change, sigma
        key = key_of(name, read.by_encoders)
        estimates[name] = estimate(key, _UNITS.get(name, "deg"), *numbers)
    sigmas = np.sqrt(np.diag(found.covariance))
    corrections = {
        "before": dict.fromkeys(found.by_point, np.zeros(len(PARAMETERS))),
        "after": dict.fromkeys(found.by_point, found.correction),
        "leave_one_point_out": found.by_point,
    }
    result = {
        "composition": "encoders" if read.by_encoders else "paper",
        "parameters": estimates,
        "correlation": found.covariance / np.outer(sigmas, sigmas),
        "points": len({one.id for one in used}),
        "pictures": len({one.stamp_ns for one in used}),
        "observations": len(used),
        "outliers": _outliers(read, found),
        "noise_factor": found.noise_factor,
        "residual_rms_px": {
            when: float(np.sqrt(np.nanmean((residuals[found.used] ** 2).sum(1))))
            for when, residuals in (("before", found.before), ("after", found.after))
        },
        "ground_rmse_m": {
            name: rmse_m(ground_errors(read.flight, read.plane, used, way))
            for name, way in corrections.items()
        },
    }
    nodes = _nodes(present, found, configs, {one["key"] for one in estimates.values()})
    return BoresightResult(result, nodes, _notes(result, nodes))


def _present(read: ReadFlight, configs: NodeConfigs) -> Array:
    """Return the values (7,) of PARAMETERS in this flight, rad, s, m; nan if not configured."""
    gimbal, direction_deg = configs.gimbal, configs.ekf.aircraft.baseline_deg
    north_deg = gimbal.yaw_zero_deg if read.by_encoders else gimbal.north.bias_deg
    offset_deg = math.nan if direction_deg is None else direction_deg
    # The ground's correction is relative to the survey's heights.
    angles = *read.flight.boresight_rpy_rad, read.flight.latency_s
    return np.array([*angles, *np.radians([north_deg, offset_deg]), read.ground_m])


def _nodes(
    present: Array, found: BoresightFit, configs: NodeConfigs, keys: set[str]
) -> dict[str, dict[str, Value]]:
    """Return the parameters in ``keys`` by node. Raise ConfigError for one out of range."""
    roll, pitch, yaw, latency_s, north, offset, height_m = (present + found.correction).tolist()
    values: dict[str, Value] = {
        "gimbal_node boresight_rpy_deg": np.degrees([roll, pitch, yaw]).tolist(),
        "overlay_node video_latency_s": latency_s,
        "gimbal_node yaw_zero_deg": math.degrees(north),
        "gimbal_node north.bias_deg": math.degrees(north),
        "overlay_node ground_height_m": height_m,
    }
    if _SECOND in keys:
        # The second antenna is turned about the first, clockwise from above.
        aircraft = configs.ekf.aircraft
        first, second = np.array(aircraft.rtk_antenna_m), np.array(aircraft.second_antenna_m)
        turn_rad = offset - float(present[PARAMETERS.index("heading_offset")])
        values[_SECOND] = (first + rotation_z(-turn_rad) @ (second - first)).tolist()
    nodes: dict[str, dict[str, Value]] = {}
    for key in [key for key in values if key in keys]:
        node, _, name = key.rpartition(" ")
        nodes.setdefault(node, {})[name] = values[key]
    given: dict[str, EkfConfig | GimbalConfig | OverlayConfig] = {
        "": configs.ekf,
        "gimbal_node": configs.gimbal,
        "overlay_node": configs.overlay,
    }
    for node, own in nodes.items():
        config = given[node]
        config_from(type(config), {**values_of(config), **own}, "what was found")
    return nodes


def _outliers(read: ReadFlight, found: BoresightFit) -> list[dict[str, Any]]:
    """Return the observations that disagree; ``off_px`` is None for a point not in view."""
    return [
        {
            "id": one.id,
            "stamp_ns": one.stamp_ns,
            "off_px": length if math.isfinite(length) else None,
        }
        for one, length, used in zip(
            read.sightings, np.hypot(*found.after.T).tolist(), found.used, strict=True
        )
        if not used
    ]


def _notes(numbers: Mapping[str, Any], nodes: Mapping[str, Mapping[str, Value]]) -> list[str]:
    found = [
        f"left out {one['id']} at {one['stamp_ns']}: "
        + ("not in view" if one["off_px"] is None else f"{one['off_px']:.0f} px off")
        for one in numbers["outliers"]
    ]
    if numbers["noise_factor"] > _MUCH:
        found.append(
            f"residuals are {numbers['noise_factor']:.1f} times as large as clicks and poses are "
            "expected to be off, and the sigmas that much larger: check lens, survey, lever arms"
        )
    if "north.bias_deg" in nodes.get("gimbal_node", {}):
        found.append(
            "set gimbal_node north.sigma_deg to what the bias may change by the next flight"
        )
    if _SECOND in nodes.get("", {}):
        found.append(
            f"{_SECOND} corrects headings where the aircraft's messages are read (dji_node, "
            "tirgeo import); those in this bag stay as they are: import it again"
        )
    return found


def boresight_lines(result: Mapping[str, Any]) -> list[str]:
    """Return the estimates as a table, and how well they fit."""
    pixels, ground = result["residual_rms_px"], result["ground_rmse_m"]
    return [
        *table(result["parameters"]),
        f"residuals: {pixels['before']:.2f} px before, {pixels['after']:.2f} px after (rms)",
        (
            f"on the ground: {ground['before']:.3f} m before, {ground['after']:.3f} m after, "
            f"{ground['leave_one_point_out']:.3f} m for each point by the others alone (rmse)"
        ),
        (
            f"{result['observations']} observations of {result['points']} points in "
            f"{result['pictures']} pictures, composition {result['composition']}"
        ),
    ]
