"""Hold the result of a boresight calibration, as numbers and as a parameter file."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.boresight.fit import BoresightFit
from tirgeo_ros.core.calibration.boresight.ground_errors import ground_errors, rmse_m
from tirgeo_ros.core.calibration.boresight.model import PARAMETERS, PointSighting
from tirgeo_ros.core.config import AircraftConfig, EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.core.frames.rotations import rotation_z
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_output import Value, parameters_yaml
from tirgeo_ros.tools.calibrate.boresight_flight import ReadFlight
from tirgeo_ros.tools.replay.node_configs import NodeConfigs

#: Residuals larger than expected by this factor cause a note.
_MUCH = 2.0
_UNITS = {"latency": "ms", "ground_height": "m"}  # all others: deg
_PER_UNIT = {"deg": math.degrees(1.0), "ms": 1e3, "m": 1.0}
_BORESIGHT = "boresight_rpy_deg"
_SECOND = "aircraft.second_antenna_m"
_ALL = ""  # all nodes
_PLACES = {
    "roll": ("gimbal_node", _BORESIGHT),
    "pitch": ("gimbal_node", _BORESIGHT),
    "yaw": ("gimbal_node", _BORESIGHT),
    "latency": ("overlay_node", "video_latency_s"),
    "heading_offset": (_ALL, _SECOND),
    "ground_height": ("overlay_node", "ground_height_m"),
}


class Parameters:
    """Map each of PARAMETERS to a parameter of the nodes, and give its value in this flight."""

    def __init__(self, configs: NodeConfigs, read: ReadFlight) -> None:
        north = "yaw_zero_deg" if read.by_encoders else "north.bias_deg"
        self._places = _PLACES | {"gimbal_north": ("gimbal_node", north)}
        self._ground_m = read.ground_m
        self._aircraft = configs.ekf.aircraft
        self._configs: dict[str, EkfConfig | GimbalConfig | OverlayConfig] = {
            _ALL: configs.ekf,
            "ekf_node": configs.ekf,
            "gimbal_node": configs.gimbal,
            "overlay_node": configs.overlay,
        }

    def value(self, name: str) -> float:
        """Return the value of one of PARAMETERS, in its unit (deg, ms or m)."""
        if name == "ground_height":
            return self._ground_m  # the correction is relative to the survey's heights
        if name == "heading_offset":
            direction_deg = self._aircraft.baseline_deg
            assert direction_deg is not None  # checked before the flight was read
            return direction_deg
        node, key = self._places[name]
        given = values_of(self._configs[node])[key]
        if isinstance(given, tuple):
            return float(given[PARAMETERS.index(name)])
        return float(given) * (_PER_UNIT["ms"] if name == "latency" else 1.0)

    def nodes(self, found: Mapping[str, float]) -> dict[str, dict[str, Value]]:
        """Return estimates as node -> key -> value. Raise ConfigError for one out of range."""
        nodes: dict[str, dict[str, Value]] = {}
        for name, value in found.items():
            node, key = self._places[name]
            values = nodes.setdefault(node, {})
            if key == _BORESIGHT:
                values[key] = [found.get(axis, self.value(axis)) for axis in PARAMETERS[:3]]
            elif key == _SECOND:
                turn_deg = value - self.value(name)
                values[key] = _turned_second_m(self._aircraft, math.radians(turn_deg))
            else:
                values[key] = value / (_PER_UNIT["ms"] if name == "latency" else 1.0)
        for node, values in nodes.items():
            config = self._configs[node]
            config_from(type(config), {**values_of(config), **values}, "what was found")
        return nodes


def _turned_second_m(aircraft: AircraftConfig, turn_rad: float) -> list[float]:
    """Return the second antenna's position (3,) m turned about the first, clockwise from above."""
    first, second = np.array(aircraft.rtk_antenna_m), np.array(aircraft.second_antenna_m)
    turned: list[float] = (first + rotation_z(-turn_rad) @ (second - first)).tolist()
    return turned


class BoresightEstimate(NamedTuple):
    """Hold one parameter, in its unit (deg, ms or m)."""

    name: str
    unit: str
    before: float
    found: float
    sigma: float


class Outlier(NamedTuple):
    """Hold an observation that disagrees with the others."""

    id: str
    stamp_ns: int
    off_px: float | None  # None: the point is not in view


@dataclass(frozen=True)
class BoresightResult:
    """Hold the full result of a calibration."""

    composition: str
    estimates: list[BoresightEstimate]
    correlation: Array  # (p, p) of the estimates
    points: int
    pictures: int
    observations: int
    outliers: list[Outlier]
    noise_factor: float
    residual_px: tuple[float, float]  # rms before and after
    # rmse before, after, and of each point from the others only.
    ground_m: tuple[float, float, float]
    nodes: dict[str, dict[str, Value]]

    @property
    def notes(self) -> list[str]:
        """Return notes for the user."""
        found = [
            f"left out {one.id} at {one.stamp_ns}: "
            + ("not in view" if one.off_px is None else f"{one.off_px:.0f} px off")
            for one in self.outliers
        ]
        if self.noise_factor > _MUCH:
            found.append(
                f"residuals are {self.noise_factor:.1f} times what clicks and poses are expected "
                "to be off, and the sigmas that much larger: check lens, survey and lever arms"
            )
        if "north.bias_deg" in self.nodes.get("gimbal_node", {}):
            found.append(
                "set gimbal_node north.sigma_deg to what the bias may change by the next flight"
            )
        if _SECOND in self.nodes.get(_ALL, {}):
            found.append(
                f"{_SECOND} mends headings where the aircraft's messages are read (dji_node, "
                "tirgeo import); those in this bag stay as they are: import it anew"
            )
        return found

    def as_dict(self) -> dict[str, object]:
        """Return the result as plain values for JSON.

        Residuals in px, lengths on the ground in m.
        """
        before, after = self.residual_px
        return {
            "composition": self.composition,
            "parameters": {one.name: one._asdict() for one in self.estimates},
            "correlation": self.correlation,
            "points": self.points,
            "pictures": self.pictures,
            "observations": self.observations,
            "outliers": [one._asdict() for one in self.outliers],
            "noise_factor": self.noise_factor,
            "residual_rms_px": {"before": before, "after": after},
            "ground_rmse_m": dict(
                zip(("before", "after", "leave_one_point_out"), self.ground_m, strict=True)
            ),
        }


def summary(read: ReadFlight, configs: NodeConfigs, found: BoresightFit) -> BoresightResult:
    """Return the result of a fit. Raise ConfigError if a parameter would be out of its range."""
    used = [one for one, is_used in zip(read.sightings, found.used, strict=True) if is_used]
    names = {one.id for one in used}
    parameters = Parameters(configs, read)
    estimates = [_estimate(parameters, found, name) for name in found.estimated]
    sigma = np.sqrt(np.diag(found.covariance))
    return BoresightResult(
        "encoders" if read.by_encoders else "paper",
        estimates,
        found.covariance / np.outer(sigma, sigma),
        len(names),
        len({one.stamp_ns for one in used}),
        len(used),
        _outliers(read.sightings, found),
        found.noise_factor,
        (_rms_px(found.before[found.used]), _rms_px(found.after[found.used])),
        _ground_m(read, used, found),
        parameters.nodes({one.name: one.found for one in estimates}),
    )


def _ground_m(
    read: ReadFlight, used: Sequence[PointSighting], found: BoresightFit
) -> tuple[float, float, float]:
    """Return the rmse on the ground (m): before, after, and of each point from the others only."""
    ways = (
        dict.fromkeys(found.by_point, np.zeros(len(PARAMETERS))),
        dict.fromkeys(found.by_point, found.correction),
        found.by_point,
    )
    before, after, others = (
        rmse_m(ground_errors(read.flight, read.plane, used, way)) for way in ways
    )
    return before, after, others


def _estimate(parameters: Parameters, found: BoresightFit, name: str) -> BoresightEstimate:
    unit = _UNITS.get(name, "deg")
    before = parameters.value(name)
    change = float(found.correction[PARAMETERS.index(name)]) * _PER_UNIT[unit]
    return BoresightEstimate(
        name, unit, before, before + change, found.sigma[name] * _PER_UNIT[unit]
    )


def _rms_px(residuals: Array) -> float:
    return math.sqrt(float(np.nanmean((residuals**2).sum(1))))


def _outliers(sightings: Sequence[PointSighting], found: BoresightFit) -> list[Outlier]:
    lengths = np.hypot(*found.after.T)
    return [
        Outlier(one.id, one.stamp_ns, float(length) if math.isfinite(length) else None)
        for one, length, used in zip(sightings, lengths, found.used, strict=True)
        if not used
    ]


def parameter_text(bag_in: PathLike, result: BoresightResult) -> str:
    """Return a parameter file of the estimates; its head lists their sigmas."""
    pixels_before, pixels_after = result.residual_px
    before, after, others = result.ground_m
    estimates = [
        f"{one.name}: {one.found:.3f} +- {one.sigma:.3f} {one.unit} (before {one.before:.3f})\n"
        for one in result.estimates
    ]
    head = (
        f"Written by 'tirgeo calibrate boresight' from {os.fspath(bag_in)}, "
        f"composition {result.composition}.\n"
        f"{result.observations} observations of {result.points} points in {result.pictures} "
        f"pictures; {len(result.outliers)} left out.\n{''.join(estimates)}"
        f"Pixels, rms: before {pixels_before:.2f}, after {pixels_after:.2f}.\n"
        f"On the ground, rmse: before {before:.3f} m, after {after:.3f} m, each point by the "
        f"others alone {others:.3f} m."
    )
    return parameters_yaml(result.nodes, head)
