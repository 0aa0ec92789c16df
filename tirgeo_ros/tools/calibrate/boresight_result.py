"""Summarise a boresight calibration, as numbers and as a parameter file."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.boresight.fit import BoresightFit
from tirgeo_ros.core.calibration.boresight.ground_errors import ground_errors, rmse_m
from tirgeo_ros.core.calibration.boresight.model import PARAMETERS
from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.core.frames.rotations import rotation_z
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_output import Value, parameters_yaml
from tirgeo_ros.tools.calibrate.boresight_flight import ReadFlight
from tirgeo_ros.tools.calibrate.estimates import PER_UNIT, head_lines
from tirgeo_ros.tools.replay.node_configs import NodeConfigs

#: Residuals larger than expected by this factor cause a note.
_MUCH = 2.0
_UNITS = {"latency": "ms", "ground_height": "m"}  # all others: deg
_SECOND = "aircraft.second_antenna_m"
_ALL = ""  # all nodes
_BORESIGHT = ("gimbal_node", "boresight_rpy_deg")
_PLACES = {
    **dict.fromkeys(PARAMETERS[:3], _BORESIGHT),
    "latency": ("overlay_node", "video_latency_s"),
    "heading_offset": (_ALL, _SECOND),
    "ground_height": ("overlay_node", "ground_height_m"),
}


class BoresightResult(NamedTuple):
    """Hold the result of a calibration."""

    numbers: dict[str, Any]  # for JSON: residuals in px, lengths on the ground in m
    nodes: dict[str, dict[str, Value]]
    notes: list[str]


def summary(read: ReadFlight, configs: NodeConfigs, found: BoresightFit) -> BoresightResult:
    """Return the result of a fit. Raise ConfigError if a parameter would be out of its range."""
    used = [one for one, is_used in zip(read.sightings, found.used, strict=True) if is_used]
    estimates = {name: _estimate(name, read, configs, found) for name in found.estimated}
    sigma = np.sqrt(np.diag(found.covariance))
    before, after = (
        float(np.sqrt(np.nanmean((residuals[found.used] ** 2).sum(1))))
        for residuals in (found.before, found.after)
    )
    corrections = {
        "before": dict.fromkeys(found.by_point, np.zeros(len(PARAMETERS))),
        "after": dict.fromkeys(found.by_point, found.correction),
        "leave_one_point_out": found.by_point,
    }
    numbers = {
        "composition": "encoders" if read.by_encoders else "paper",
        "parameters": estimates,
        "correlation": found.covariance / np.outer(sigma, sigma),
        "points": len({one.id for one in used}),
        "pictures": len({one.stamp_ns for one in used}),
        "observations": len(used),
        "outliers": _outliers(read, found),
        "noise_factor": found.noise_factor,
        "residual_rms_px": {"before": before, "after": after},
        "ground_rmse_m": {
            name: rmse_m(ground_errors(read.flight, read.plane, used, way))
            for name, way in corrections.items()
        },
    }
    nodes = _nodes(read, configs, {name: one["found"] for name, one in estimates.items()})
    return BoresightResult(numbers, nodes, _notes(numbers, nodes))


def _configs_of(configs: NodeConfigs) -> dict[str, EkfConfig | GimbalConfig | OverlayConfig]:
    return {_ALL: configs.ekf, "gimbal_node": configs.gimbal, "overlay_node": configs.overlay}


def _place(name: str, read: ReadFlight) -> tuple[str, str]:
    """Return node and key of one of PARAMETERS."""
    if name == "gimbal_north":
        return "gimbal_node", "yaw_zero_deg" if read.by_encoders else "north.bias_deg"
    return _PLACES[name]


def _present(name: str, read: ReadFlight, configs: NodeConfigs) -> float:
    """Return the value of one of PARAMETERS in this flight, in its unit."""
    if name == "ground_height":
        return read.ground_m  # the correction is relative to the survey's heights
    if name == "heading_offset":
        direction_deg = configs.ekf.aircraft.baseline_deg
        assert direction_deg is not None  # checked before the flight was read
        return direction_deg
    node, key = _place(name, read)
    given = values_of(_configs_of(configs)[node])[key]
    if isinstance(given, tuple):
        return float(given[PARAMETERS.index(name)])
    return float(given) * (PER_UNIT["ms"] if name == "latency" else 1.0)


def _estimate(
    name: str, read: ReadFlight, configs: NodeConfigs, found: BoresightFit
) -> dict[str, Any]:
    unit = _UNITS.get(name, "deg")
    before = _present(name, read, configs)
    change = float(found.correction[PARAMETERS.index(name)]) * PER_UNIT[unit]
    return {
        "name": name,
        "unit": unit,
        "before": before,
        "found": before + change,
        "sigma": found.sigma[name] * PER_UNIT[unit],
    }


def _nodes(
    read: ReadFlight, configs: NodeConfigs, found: Mapping[str, float]
) -> dict[str, dict[str, Value]]:
    """Return estimates as node -> key -> value. Raise ConfigError for one out of range."""
    nodes: dict[str, dict[str, Value]] = {}
    for name, value in found.items():
        node, key = _place(name, read)
        values = nodes.setdefault(node, {})
        if (node, key) == _BORESIGHT:
            values[key] = [found.get(a, _present(a, read, configs)) for a in PARAMETERS[:3]]
        elif key == _SECOND:
            # The second antenna is turned about the first, clockwise from above.
            turn_rad = math.radians(value - _present(name, read, configs))
            aircraft = configs.ekf.aircraft
            first, second = np.array(aircraft.rtk_antenna_m), np.array(aircraft.second_antenna_m)
            values[key] = (first + rotation_z(-turn_rad) @ (second - first)).tolist()
        else:
            values[key] = value / (PER_UNIT["ms"] if name == "latency" else 1.0)
    for node, values in nodes.items():
        config = _configs_of(configs)[node]
        config_from(type(config), {**values_of(config), **values}, "what was found")
    return nodes


def _outliers(read: ReadFlight, found: BoresightFit) -> list[dict[str, Any]]:
    """Return the observations that disagree; ``off_px`` is None for a point not in view."""
    lengths = np.hypot(*found.after.T).tolist()
    return [
        {
            "id": one.id,
            "stamp_ns": one.stamp_ns,
            "off_px": length if math.isfinite(length) else None,
        }
        for one, length, used in zip(read.sightings, lengths, found.used, strict=True)
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
    if _SECOND in nodes.get(_ALL, {}):
        found.append(
            f"{_SECOND} corrects headings where the aircraft's messages are read (dji_node, "
            "tirgeo import); those in this bag stay as they are: import it anew"
        )
    return found


def parameter_text(bag_in: PathLike, result: BoresightResult) -> str:
    """Return a parameter file of the estimates; its head lists their sigmas."""
    numbers = result.numbers
    pixels, ground = numbers["residual_rms_px"], numbers["ground_rmse_m"]
    head = (
        f"Written by 'tirgeo calibrate boresight' from {os.fspath(bag_in)}, "
        f"composition {numbers['composition']}.\n"
        f"{numbers['observations']} observations of {numbers['points']} points in "
        f"{numbers['pictures']} pictures; {len(numbers['outliers'])} left out.\n"
        + "".join(f"{line}\n" for line in head_lines(numbers["parameters"]))
        + f"Pixels, rms: before {pixels['before']:.2f}, after {pixels['after']:.2f}.\n"
        f"On the ground, rmse: before {ground['before']:.3f} m, after {ground['after']:.3f} m, "
        f"each point by the others alone {ground['leave_one_point_out']:.3f} m."
    )
    return parameters_yaml(result.nodes, head)
