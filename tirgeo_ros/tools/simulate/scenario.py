"""A scenario: everything that a simulated flight is made from, read strictly from YAML.

The defaults are the flight of Ren et al. 2022 (sections 4.2 to 4.6); its scenario file is
``config/scenarios/paper_flight.yaml``. Lever arms are in ROS's axes (forward, left, up), as in
the parameters of the nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import yaml

from tirgeo_ros.core.config import ImuConfig
from tirgeo_ros.core.errors import ConfigError, ScenarioError
from tirgeo_ros.core.frames import flu_from_frd
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.parameter import config_from, group, param
from tirgeo_ros.core.samples import Array

SHAPES = ("lawnmower", "hover", "figure_eight")


@dataclass(frozen=True, slots=True)
class SiteScenario:
    """Where the flight is: the origin of the plane in which the truth is given."""

    latitude_deg: float = param(39.85, "latitude", unit="deg", low=-89, high=89)
    longitude_deg: float = param(116.70, "longitude", unit="deg", low=-180, high=180)
    ground_height_m: float = param(
        11.5, "ellipsoidal height of the ground", unit="m", low=-500, high=9000
    )

    @property
    def plane(self) -> TangentPlane:
        """The tangent plane of the site, at the height of the ground."""
        lat, lon = np.radians([self.latitude_deg, self.longitude_deg])
        return TangentPlane(float(lat), float(lon), self.ground_height_m)


@dataclass(frozen=True, slots=True)
class RouteScenario:
    """What is flown; see ``routes.py`` for the shapes."""

    shape: str = param("lawnmower", "lawnmower, hover or figure_eight", choices=SHAPES)
    height_above_ground_m: float = param(20.0, "height of the IMU", unit="m", low=2, high=500)
    speed_m_s: float = param(3.0, "cruise", unit="m/s", low=0.1, high=25)
    acceleration_m_s2: float = param(
        1.5, "largest acceleration, along and across", unit="m/s2", low=0.1, high=10
    )
    turn_radius_m: float = param(4.2, "radius of a turn", unit="m", low=0.5, high=500)
    yaw_rate_deg_s: float = param(
        35.0, "yaw rate of turns on the spot (hover)", unit="deg/s", low=1, high=150
    )
    hover_s: float = param(4.0, "hover before the start", unit="s", low=0, high=600)
    heading_deg: float = param(0.0, "first heading", unit="deg", low=-360, high=360)
    legs: int = param(5, "legs of a lawnmower, or loops of a figure eight", low=1, high=1000)
    leg_length_m: float = param(42.0, "length of a leg", unit="m", low=1, high=5000)
    leg_spacing_m: float = param(15.0, "distance between legs", unit="m", low=1, high=1000)
    hold_error_m: float = param(
        0.1, "the autopilot keeps its route to this, per axis, rms", unit="m", low=0, high=10
    )


@dataclass(frozen=True, slots=True)
class WindScenario:
    """The air: the aircraft leans against its drag."""

    mean_m_s: tuple[float, ...] = param((1.5, -1.0), "north and east", unit="m/s")
    gust_m_s: float = param(
        1.0, "standard deviation of gusts, per axis", unit="m/s", low=0, high=20
    )
    gust_time_s: float = param(2.0, "correlation time of gusts", unit="s", low=0.2, high=100)
    drag_1_s: float = param(0.15, "drag deceleration per airspeed", unit="1/s", low=0, high=5)


@dataclass(frozen=True, slots=True)
class ImuScenario:
    """The autopilot's inertial sensor."""

    rate_hz: float = param(100.0, "samples per second", unit="Hz", low=50, high=400)
    gyro_turn_on_bias_rad_s: float = param(
        3e-4, "standard deviation of the constant part of the bias", unit="rad/s", low=0, high=1
    )
    accel_turn_on_bias_m_s2: float = param(
        1e-2, "standard deviation of the constant part of the bias", unit="m/s2", low=0, high=10
    )
    noise_scale: float = param(
        1.0, "all random errors of the IMU times this; 0 = a perfect IMU", low=0, high=100
    )
    noise: ImuConfig = group(ImuConfig)


@dataclass(frozen=True, slots=True)
class RtkScenario:
    """The RTK receiver with two antennas; status is fixed throughout."""

    rate_hz: float = param(5.0, "fixes per second", unit="Hz", low=0.1, high=50)
    arrival_delay_s: float = param(0.08, "arrival minus measurement", unit="s", low=0, high=2)
    position_sigma_m: tuple[float, ...] = param((0.01, 0.01, 0.02), "north, east, down", unit="m")
    velocity_sigma_m_s: tuple[float, ...] = param(
        (0.02, 0.02, 0.02), "north, east, down", unit="m/s"
    )
    lever_arm_m: tuple[float, ...] = param(
        (-0.10, 0.32, 0.38), "antenna from the IMU (forward, left, up)", unit="m"
    )


@dataclass(frozen=True, slots=True)
class HeadingScenario:
    """The heading of the two antennas."""

    sigma_deg: float = param(0.4, "white noise", unit="deg", low=0, high=90)
    step_deg: float = param(
        1.0, "reported in steps of this; 0 = not rounded", unit="deg", low=0, high=90
    )
    offset_deg: float = param(
        0.0, "direction reported, from the nose, clockwise", unit="deg", low=-360, high=360
    )


@dataclass(frozen=True, slots=True)
class GpsScenario:
    """The autopilot's ordinary GPS, with slowly varying errors."""

    rate_hz: float = param(10.0, "fixes per second", unit="Hz", low=0.1, high=50)
    arrival_delay_s: float = param(0.0, "arrival minus measurement", unit="s", low=0, high=2)
    position_rms_m: tuple[float, ...] = param(
        (0.9342, 1.2846, 2.8017), "north, east, down error over the flight (Table 1)", unit="m"
    )
    position_time_s: float = param(45.0, "correlation time", unit="s", low=0.5, high=1e5)
    velocity_sigma_m_s: float = param(0.1, "per axis", unit="m/s", low=0, high=10)
    lever_arm_m: tuple[float, ...] = param(
        (0.0, 0.0, 0.28), "antenna from the IMU (forward, left, up)", unit="m"
    )


@dataclass(frozen=True, slots=True)
class AutopilotScenario:
    """The errors of the autopilot's own attitude."""

    heading_rms_deg: float = param(
        1.7972, "heading error over the flight (Table 1)", unit="deg", low=0, high=90
    )
    heading_time_s: float = param(30.0, "its correlation time", unit="s", low=0.5, high=1e5)
    tilt_rms_deg: tuple[float, ...] = param((0.3, 0.3), "roll, pitch error", unit="deg")
    tilt_time_s: float = param(10.0, "their correlation time", unit="s", low=0.5, high=1e5)


@dataclass(frozen=True, slots=True)
class GimbalScenario:
    """The gimbal: it follows the nose, and holds the camera level nearly."""

    rate_hz: float = param(50.0, "samples per second", unit="Hz", low=1, high=400)
    pitch_deg: float = param(-30.0, "commanded camera pitch", unit="deg", low=-90, high=30)
    lag_s: float = param(0.35, "time constant with which it follows the nose", unit="s", low=0.02)
    error_rms_deg: tuple[float, ...] = param(
        (0.2704, 0.4839), "camera roll, pitch from commanded, not reported (Table 8)", unit="deg"
    )
    error_time_s: float = param(2.5, "their correlation time", unit="s", low=0.2, high=1e3)
    encoder_sigma_deg: float = param(0.02, "noise of a joint angle", unit="deg", low=0, high=10)
    lever_arm_m: tuple[float, ...] = param(
        (0.08, 0.0, -0.25), "pivot from the IMU (forward, left, up)", unit="m"
    )
    camera_offset_m: tuple[float, ...] = param(
        (0.05, 0.02, -0.01), "camera from the pivot (camera's forward, left, up)", unit="m"
    )

    @property
    def lever_arm_b(self) -> Array:
        """(3,) pivot from the IMU, FRD, m."""
        return flu_from_frd(np.array(self.lever_arm_m))

    @property
    def camera_offset_g(self) -> Array:
        """(3,) camera from the pivot, camera body FRD, m."""
        return flu_from_frd(np.array(self.camera_offset_m))


@dataclass(frozen=True, slots=True)
class Scenario:
    """A whole flight."""

    name: str = param("paper_flight", "what the flight is called")
    seed: int = param(2205, "of all random numbers", low=0, high=2**31)
    start_utc: str = param("2021-10-20T12:00:00Z", "first instant, ISO 8601")
    duration_s: float = param(107.0, "length of the flight", unit="s", low=1, high=7200)
    site: SiteScenario = group(SiteScenario)
    route: RouteScenario = group(RouteScenario)
    wind: WindScenario = group(WindScenario)
    imu: ImuScenario = group(ImuScenario)
    rtk: RtkScenario = group(RtkScenario)
    heading: HeadingScenario = group(HeadingScenario)
    gps: GpsScenario = group(GpsScenario)
    autopilot: AutopilotScenario = group(AutopilotScenario)
    gimbal: GimbalScenario = group(GimbalScenario)

    @property
    def start_ns(self) -> int:
        """The first instant in nanoseconds of Unix time; raises ScenarioError."""
        text = self.start_utc.replace("Z", "+00:00")
        try:
            start = datetime.fromisoformat(text)
        except ValueError:
            raise ScenarioError(
                f"start_utc: {self.start_utc!r} is not a time such as 2021-10-20T12:00:00Z"
            ) from None
        start = start if start.tzinfo else start.replace(tzinfo=timezone.utc)
        return int(start.timestamp()) * 1_000_000_000


def load_scenario(path: str | Path) -> Scenario:
    """The scenario of a YAML file; ScenarioError names the file and the key."""
    try:
        tree = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None
    except yaml.YAMLError as error:
        line = str(error).replace("\n", " ")
        raise ScenarioError(f"{path}: is not YAML: {line}") from None
    if not isinstance(tree, Mapping):
        raise ScenarioError(f"{path}: holds no scenario (a mapping of keys to values)")
    return scenario_from(dict(_flat(tree, "")), str(path))


def scenario_from(values: Mapping[str, object], where: str = "") -> Scenario:
    """A scenario from dotted values, the rest at the paper's; raises ScenarioError."""
    try:
        scenario = config_from(Scenario, values, where)
    except ConfigError as error:
        raise ScenarioError(str(error)) from None
    try:
        _ = scenario.start_ns
    except ScenarioError as error:
        raise ScenarioError(f"{where}: {error}" if where else str(error)) from None
    return scenario


def _flat(tree: Mapping[object, object], prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _flat(value, name + ".")
        else:
            yield name, value
