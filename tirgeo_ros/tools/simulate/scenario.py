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
"""Define a scenario, the input of a simulated flight, read strictly from YAML.

The defaults are the flight of Ren et al. 2022 (sections 4.2 to 5.2); its scenario file is
``config/scenarios/paper_flight.yaml``. Lever arms are in ROS's axes (forward, left, up), as in the
parameters of the nodes.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import partial
from typing import Any

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import AircraftConfig, ImuNoiseConfig
from tirgeo_ros.core.config.schema import config_from, group, param, parameters_of
from tirgeo_ros.core.frames.rotations import flu_from_frd
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CameraError, ConfigError, ScenarioError
from tirgeo_ros.core.types.measurements import JOINT_ORDERS, USUAL_ORDER
from tirgeo_ros.io.parameters.parameter_file import load_yaml

SHAPES = ("lawnmower", "hover", "figure_eight")
STANDS = ("ground", "hand")
_m: Any = partial(param, within=("m", 0, 1e3))
_m_s: Any = partial(param, within=("m/s", 0, 1e3))
_arm: Any = partial(param, within=("m", -100, 100))  # forward, left, up


@dataclass(frozen=True, slots=True)
class RouteScenario:
    """Hold the route; see ``trajectory.py`` for the shapes."""

    shape: str = param("lawnmower", "lawnmower, hover or figure_eight", choices=SHAPES)
    height_above_ground_m: float = param(20.0, "height of the IMU", ("m", 2, 500))
    speed_m_s: float = param(3.0, "cruise speed", ("m/s", 0.1, 25))
    acceleration_m_s2: float = param(1.5, "largest acceleration", ("m/s2", 0.1, 10))
    turn_radius_m: float = param(4.2, "radius of a turn", ("m", 0.5, 500))
    yaw_rate_deg_s: float = param(35.0, "rate of turns on the spot", ("deg/s", 1, 150))
    hover_s: float = param(4.0, "hover before the start", ("s", 0, 600))
    heading_deg: float = param(20.0, "initial heading", ("deg", -360, 360))
    legs: int = param(5, "legs of a lawnmower, or loops of a figure eight", ("", 1, 1000))
    leg_length_m: float = param(42.0, "length of a leg", ("m", 1, 5000))
    leg_spacing_m: float = param(15.0, "distance between legs", ("m", 1, 1000))
    hold_error_m: float = param(0.1, "error off the route, per axis, rms", ("m", 0, 10))
    #: Then the aircraft climbs to its height, and the route begins; 0 = it begins in the air.
    standing_s: float = param(0.0, "time at rest before take-off", ("s", 0, 3600))
    standing_on: str = param("ground", "ground, or hand: held by a person", choices=STANDS)
    hand_turn_deg: float = param(3.0, "turns of a hand, per axis, rms", ("deg", 0, 30))
    hand_shift_m: float = param(0.02, "shifts of a hand, per axis, rms", ("m", 0, 1))
    engine_before_s: float = param(5.0, "engine on before take-off", ("s", 0, 3600))


@dataclass(frozen=True, slots=True)
class WindScenario:
    """Hold the wind; the aircraft leans against its drag."""

    mean_m_s: tuple[float, ...] = param((1.5, -1.0), "mean, north, east", ("m/s", -100, 100))
    gust_m_s: float = _m_s(1.0, "standard deviation of gusts, per axis")
    drag_1_s: float = param(0.15, "drag deceleration per airspeed", ("1/s", 0, 5))


@dataclass(frozen=True, slots=True)
class ImuScenario:
    """Hold the autopilot's inertial sensor."""

    rate_hz: float = param(100.0, "samples per second", ("Hz", 50, 400))
    gyro_turn_on_bias_rad_s: float = param(3e-4, "sigma of the bias", ("rad/s", 0, 1))
    accel_turn_on_bias_m_s2: float = param(1e-2, "sigma of the bias", ("m/s2", 0, 10))
    #: Planted errors, not in params.yaml: a part of the biases, and stamps late by a time.
    gyro_bias_rad_s: tuple[float, ...] = param((0.0,) * 3, "forward, left, up", ("rad/s", -1, 1))
    accel_bias_m_s2: tuple[float, ...] = param((0.0,) * 3, "forward, left, up", ("m/s2", -10, 10))
    #: Vibration while the engine runs: lines of the rotors and white noise.
    gyro_vibration_rad_s: float = param(0.0, "rms, per axis", ("rad/s", 0, 10))
    accel_vibration_m_s2: float = param(0.0, "rms, per axis", ("m/s2", 0, 100))
    stamp_delay_s: float = param(0.0, "stamp minus time of the reading", ("s", -0.2, 0.2))
    noise_scale: float = param(1.0, "factor on all random errors; 0 = perfect IMU", ("", 0, 100))
    noise: ImuNoiseConfig = group(ImuNoiseConfig)


@dataclass(frozen=True, slots=True)
class RtkScenario:
    """Hold the RTK receiver with two antennas; its status is always fixed."""

    rate_hz: float = param(5.0, "fixes per second", ("Hz", 0.1, 50))
    arrival_delay_s: float = param(0.08, "arrival minus measurement", ("s", 0, 2))
    position_sigma_m: tuple[float, ...] = _m((0.01, 0.01, 0.02), "north, east, down")
    velocity_sigma_m_s: tuple[float, ...] = _m_s((0.02, 0.02, 0.02), "north, east, down")
    lever_arm_m: tuple[float, ...] = _arm((-0.10, 0.32, 0.38), "first antenna from the IMU")
    second_antenna_m: tuple[float, ...] = _arm((0.90, 0.32, 0.38), "second antenna from the IMU")


@dataclass(frozen=True, slots=True)
class HeadingScenario:
    """Hold the heading of the two antennas."""

    sigma_deg: float = param(0.4, "white noise", ("deg", 0, 90))
    step_deg: float = param(1.0, "step of rounding; 0 = not rounded", ("deg", 0, 90))


@dataclass(frozen=True, slots=True)
class GpsScenario:
    """Hold the autopilot's ordinary GPS, with slowly varying errors."""

    rate_hz: float = param(10.0, "fixes per second", ("Hz", 0.1, 50))
    arrival_delay_s: float = param(0.0, "arrival minus measurement", ("s", 0, 2))
    position_rms_m: tuple[float, ...] = _m((0.9342, 1.2846, 2.8017), "north, east, down (Table 1)")
    position_time_s: float = param(45.0, "correlation time", ("s", 0.5, 1e5))
    velocity_sigma_m_s: float = _m_s(0.1, "per axis")
    lever_arm_m: tuple[float, ...] = _arm((0.0, 0.0, 0.28), "antenna from the IMU")


@dataclass(frozen=True, slots=True)
class BarometerScenario:
    """Hold the barometer: the standard atmosphere, with errors as heights."""

    rate_hz: float = param(0.0, "readings per second; 0 = no barometer", ("Hz", 0, 50))
    noise_m: float = param(0.2, "white noise", ("m", 0, 100))
    drift: float = param(0.05, "random walk of the weather", ("m/sqrt(s)", 0, 10))
    offset_m: float = param(60.0, "error at the start, caused by the weather", ("m", -1000, 1000))


@dataclass(frozen=True, slots=True)
class AutopilotScenario:
    """Hold the errors of the autopilot's own attitude."""

    heading_rms_deg: float = param(1.7972, "over the flight (Table 1)", ("deg", 0, 90))
    tilt_rms_deg: tuple[float, ...] = param((0.3, 0.3), "roll, pitch", ("deg", 0, 30))


@dataclass(frozen=True, slots=True)
class GimbalScenario:
    """Hold the gimbal, which follows the nose and keeps the camera nearly level."""

    rate_hz: float = param(50.0, "samples per second", ("Hz", 1, 400))
    joint_order: str = param(USUAL_ORDER, "joints from aircraft to camera", choices=JOINT_ORDERS)
    pitch_deg: float = param(-30.0, "commanded camera pitch", ("deg", -90, 30))
    pitch_step_deg: float = param(0.0, "change of that pitch, in a second", ("deg", -90, 90))
    pitch_step_s: float = param(0.0, "time at which the change begins", ("s", 0, 7200))
    lag_s: float = param(0.35, "time constant of following the nose", ("s", 0.02, 60))
    #: Errors of the camera's roll and pitch against the commanded ones, not reported (Table 8).
    error_rms_deg: tuple[float, ...] = param((0.2704, 0.4839), "roll, pitch", ("deg", 0, 30))
    #: Bias of the reported camera heading against the autopilot's north, which drifts and jumps.
    north_bias_deg: float = param(0.0, "bias at the start", ("deg", -180, 180))
    north_drift_deg_s: float = param(0.0, "drift rate of the bias", ("deg/s", -1, 1))
    north_step_deg: float = param(0.0, "jump of the bias", ("deg", -180, 180))
    north_step_s: float = param(0.0, "time of the jump", ("s", 0, 7200))
    encoder_sigma_deg: float = param(0.02, "noise of a joint angle", ("deg", 0, 10))
    lever_arm_m: tuple[float, ...] = _arm((0.08, 0.0, -0.25), "pivot from the IMU")
    camera_offset_m: tuple[float, ...] = _arm((0.05, 0.02, -0.01), "from pivot, camera axes")
    #: True mounting error about the camera's forward, left, up; not in params.yaml.
    boresight_rpy_deg: tuple[float, ...] = param(
        (0.0, 0.0, 0.0), "roll, pitch, yaw", ("deg", -45, 45)
    )

    @property
    def boresight_rpy_rad(self) -> Array:
        """Return roll, pitch, yaw (3,) of the mounting error about camera body FRD axes, rad."""
        return np.radians(flu_from_frd(np.array(self.boresight_rpy_deg)))


@dataclass(frozen=True, slots=True)
class SiteScenario:
    """Hold the site: the origin of the plane that the truth refers to."""

    latitude_deg: float = param(39.85, "latitude", ("deg", -89, 89))
    longitude_deg: float = param(116.70, "longitude", ("deg", -180, 180))
    ground_height_m: float = param(11.5, "ellipsoidal", ("m", -500, 9000))
    geoid_undulation_m: float = param(-9.0, "sea level above ellipsoid", ("m", -120, 100))

    @property
    def plane(self) -> TangentPlane:
        """Return the tangent plane of the site, at the height of the ground."""
        lat, lon = np.radians([self.latitude_deg, self.longitude_deg])
        return TangentPlane(float(lat), float(lon), self.ground_height_m)


@dataclass(frozen=True, slots=True)
class VideoScenario:
    """Hold the thermal camera, by default that of Table 9, and its pictures."""

    width: int = param(640, "width of a picture", ("px", 16, 4096))
    height: int = param(512, "height of a picture", ("px", 16, 4096))
    focal_px: tuple[float, ...] = param((XT2.fx, XT2.fy), "fx, fy", ("px", 1, 1e5))
    principal_px: tuple[float, ...] = param((XT2.cx, XT2.cy), "cx, cy", ("px", -1e4, 1e4))
    #: If not 0: square pixels around the middle, in place of focal_px and principal_px.
    fov_deg: float = param(0.0, "horizontal field of view", ("deg", 0, 140))
    distortion: tuple[float, ...] = param(
        XT2.distortion, "k1, k2, p1, p2, k3, ...", ("", -100, 100), sizes=(0, 4, 5, 8)
    )
    #: 8 is thermal/image_raw/compressed (JPEG), 16 is thermal/image_raw (mono16).
    bits: int = param(8, "bits of a pixel: 8 or 16", ("", 8, 16))
    rate_hz: float = param(9.0, "frames per second", ("Hz", 0.1, 60))
    latency_s: float = param(0.05, "stamp minus exposure", ("s", 0, 2))
    jpeg_quality: int = param(65, "quality of the JPEG", ("", 1, 100))
    blur_px: float = param(0.7, "standard deviation of the optics' blur", ("px", 0, 9))
    noise_grey: float = param(1.0, "sigma of a pixel, grey levels", ("", 0, 50))
    vignetting: float = param(0.06, "loss of contrast in the corners", ("", 0, 1))

    @property
    def camera(self) -> Camera:
        """Return the camera; raise CameraError."""
        (fx, fy), (cx, cy) = self.focal_px, self.principal_px
        if self.fov_deg:
            cx, cy = (self.width - 1) / 2, (self.height - 1) / 2
            fx = fy = self.width / 2 / math.tan(math.radians(self.fov_deg) / 2)
        return Camera(self.width, self.height, fx, fy, cx, cy, self.distortion)


@dataclass(frozen=True, slots=True)
class ParkScenario:
    """Hold the places of flower beds, from the site's origin, and how the ground is painted."""

    north_m: tuple[float, ...] = param((-76.0, 106.0), "edges of the beds", ("m", -1e4, 1e4))
    east_m: tuple[float, ...] = param((-36.0, 104.0), "edges of the beds", ("m", -1e4, 1e4))
    cell_m: float = param(14.0, "each bed lies in a square of this side", ("m", 6, 100))
    margin_m: float = param(50.0, "grass painted around the beds", ("m", 0, 2000))
    resolution_m: float = param(0.05, "cell of the painted ground", ("m", 0.01, 1))
    slope_deg: float = param(0.0, "slope of the ground", ("deg", 0, 30))
    uphill_deg: float = param(0.0, "direction uphill, from north", ("deg", -360, 360))


#: Targets at given places, as rows of north, east (m), warmer than grass by (K), size (m).
_targets: Any = partial(
    param, description="rows of four", within=("", -1e4, 1e4), sizes=tuple(range(0, 401, 4))
)


@dataclass(frozen=True, slots=True)
class SceneScenario:
    """Hold the targets of a search, which are warmer than the ground."""

    people: int = param(0, "number at random places, in addition to people_at", ("", 0, 100))
    people_at: tuple[float, ...] = _targets((31.0, 41.0, 12.0, 0.5))
    fires: int = param(0, "number at random places", ("", 0, 100))
    fires_at: tuple[float, ...] = _targets(())
    vehicles: int = param(0, "number at random places", ("", 0, 100))
    vehicles_at: tuple[float, ...] = _targets(())


@dataclass(frozen=True, slots=True)
class SurveyScenario:
    """Hold control points on corners of beds, and an operator's clicks on them."""

    points: int = param(20, "control points", ("", 1, 1000))
    views: int = param(3, "clicks on each, in as many frames", ("", 1, 100))
    #: There are no earlier clicks: a filter needs some time.
    after_s: float = param(20.0, "time of the first click", ("s", 0, 7200))
    sigma_m: tuple[float, ...] = param((0.01, 0.01, 0.02), "north, east, down", ("m", 0, 100))
    click_sigma_px: float = param(0.5, "error of a click, per axis", ("px", 0, 50))
    #: An operator clicks between these rows, and at least this far from the left and right edge.
    rows_px: tuple[float, ...] = param((180.0, 490.0), "rows", ("px", 0, 1e4))
    side_px: float = param(40.0, "columns from the edge", ("px", 0, 1e4))
    apart_s: float = param(1.0, "shortest time between clicks on a point", ("s", 0, 100))


@dataclass(frozen=True, slots=True)
class Scenario:
    """Hold the parameters of a whole flight."""

    name: str = param("paper_flight", "name of the flight")
    seed: int = param(2205, "seed of all random numbers", ("", 0, 2**31))
    start_utc: str = param("2021-10-20T12:00:00Z", "first instant, ISO 8601")
    duration_s: float = param(107.0, "length of the flight", ("s", 1, 7200))
    site: SiteScenario = group(SiteScenario)
    route: RouteScenario = group(RouteScenario)
    wind: WindScenario = group(WindScenario)
    imu: ImuScenario = group(ImuScenario)
    rtk: RtkScenario = group(RtkScenario)
    heading: HeadingScenario = group(HeadingScenario)
    gps: GpsScenario = group(GpsScenario)
    barometer: BarometerScenario = group(BarometerScenario)
    autopilot: AutopilotScenario = group(AutopilotScenario)
    gimbal: GimbalScenario = group(GimbalScenario)
    video: VideoScenario = group(VideoScenario)
    park: ParkScenario = group(ParkScenario)
    scene: SceneScenario = group(SceneScenario)
    survey: SurveyScenario = group(SurveyScenario)

    @property
    def aircraft(self) -> AircraftConfig:
        """Return the positions of antennas, gimbal and camera as parameters of the nodes."""
        return AircraftConfig(
            rtk_antenna_m=self.rtk.lever_arm_m,
            second_antenna_m=self.rtk.second_antenna_m,
            gps_antenna_m=self.gps.lever_arm_m,
            gimbal_pivot_m=self.gimbal.lever_arm_m,
            camera_from_pivot_m=self.gimbal.camera_offset_m,
        )

    @property
    def start_ns(self) -> int:
        """Return the first instant in ns of Unix time; raise ScenarioError."""
        text = self.start_utc.replace("Z", "+00:00")
        try:
            start = datetime.fromisoformat(text)
        except ValueError:
            raise ScenarioError(
                f"start_utc: {self.start_utc!r} is not a time such as 2021-10-20T12:00:00Z"
            ) from None
        start = start if start.tzinfo else start.replace(tzinfo=timezone.utc)
        second = int(start.timestamp())
        # A ROS stamp has at most 2**31 - 1 s; the ten seconds are for late arrivals.
        if not 0 <= second <= 2**31 - 10 - self.duration_s:
            raise ScenarioError(f"start_utc: {self.start_utc} must be in 1970 to 2038")
        return second * 1_000_000_000


_GROUPS = {p.name.rpartition(".")[0] for p in parameters_of(Scenario)}


def load_scenario(path: str | os.PathLike[str]) -> Scenario:
    """Return the scenario of a YAML file; ScenarioError names the file and the key."""
    try:
        tree = load_yaml(path)
    except ConfigError as error:
        raise ScenarioError(str(error)) from None
    if not isinstance(tree, Mapping):
        raise ScenarioError(f"{path}: is not a scenario (a mapping of keys to values)")
    return scenario_from(dict(_flat(tree, "")), str(path))


def scenario_from(values: Mapping[str, object], where: str = "") -> Scenario:
    """Return a scenario from values by dotted keys; others get defaults; raise ScenarioError."""
    try:
        scenario = config_from(Scenario, values, where)
    except ConfigError as error:
        raise ScenarioError(str(error)) from None
    try:
        _check(scenario)
    except (ConfigError, ScenarioError) as error:
        raise ScenarioError(f"{where}: {error}" if where else str(error)) from None
    return scenario


def _check(scenario: Scenario) -> None:
    """Raise ScenarioError or ConfigError for values that do not fit each other."""
    _ = scenario.start_ns, scenario.aircraft.baseline_b
    try:
        _ = scenario.video.camera
    except CameraError as error:
        raise ScenarioError(f"video: {error}") from None
    if scenario.video.bits not in {8, 16}:
        raise ScenarioError(f"parameter video.bits: {scenario.video.bits} is neither 8 nor 16")
    for name in ("north_m", "east_m"):
        low, high = getattr(scenario.park, name)
        if high - low < scenario.park.cell_m:
            raise ScenarioError(
                f"park.{name}: {low:g} to {high:g} is smaller than one cell of "
                f"{scenario.park.cell_m:g} m; give the lower end first"
            )


def _flat(tree: Mapping[object, object], prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping) and (value or name in _GROUPS):
            yield from _flat(value, name + ".")
        else:
            yield name, value
