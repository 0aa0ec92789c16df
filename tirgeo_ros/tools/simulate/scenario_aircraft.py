"""Define the flying part of a scenario: route, air, sensors, gimbal, each with its errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from tirgeo_ros.core.config import ImuNoiseConfig
from tirgeo_ros.core.config.schema import group, param
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.joint_orders import JOINT_ORDERS, USUAL_ORDER

SHAPES = ("lawnmower", "hover", "figure_eight")
_m: Any = partial(param, within=("m", 0, 1e3))
_m_s: Any = partial(param, within=("m/s", 0, 1e3))
_arm: Any = partial(param, within=("m", -100, 100))  # forward, left, up


@dataclass(frozen=True, slots=True)
class RouteScenario:
    """Hold the route; see ``trajectory.py`` for the shapes."""

    shape: str = param("lawnmower", "lawnmower, hover or figure_eight", choices=SHAPES)
    height_above_ground_m: float = param(20.0, "height of the IMU", ("m", 2, 500))
    speed_m_s: float = param(3.0, "cruise", ("m/s", 0.1, 25))
    acceleration_m_s2: float = param(1.5, "largest", ("m/s2", 0.1, 10))
    turn_radius_m: float = param(4.2, "radius of a turn", ("m", 0.5, 500))
    yaw_rate_deg_s: float = param(35.0, "of turns on the spot", ("deg/s", 1, 150))
    hover_s: float = param(4.0, "hover before the start", ("s", 0, 600))
    heading_deg: float = param(20.0, "first heading", ("deg", -360, 360))
    legs: int = param(5, "legs of a lawnmower, or loops of a figure eight", ("", 1, 1000))
    leg_length_m: float = param(42.0, "length of a leg", ("m", 1, 5000))
    leg_spacing_m: float = param(15.0, "distance between legs", ("m", 1, 1000))
    hold_error_m: float = param(0.1, "off the route, per axis, rms", ("m", 0, 10))


@dataclass(frozen=True, slots=True)
class WindScenario:
    """Hold the wind; the aircraft leans against its drag."""

    mean_m_s: tuple[float, ...] = param((1.5, -1.0), "north, east", ("m/s", -100, 100))
    gust_m_s: float = _m_s(1.0, "standard deviation of gusts, per axis")
    drag_1_s: float = param(0.15, "drag deceleration per airspeed", ("1/s", 0, 5))


@dataclass(frozen=True, slots=True)
class ImuScenario:
    """Hold the autopilot's inertial sensor."""

    rate_hz: float = param(100.0, "samples per second", ("Hz", 50, 400))
    gyro_turn_on_bias_rad_s: float = param(3e-4, "sigma", ("rad/s", 0, 1))
    accel_turn_on_bias_m_s2: float = param(1e-2, "sigma", ("m/s2", 0, 10))
    noise_scale: float = param(1.0, "of all random errors; 0 = a perfect IMU", ("", 0, 100))
    averages: bool = param(False, "a sample is the mean over the interval before its stamp")
    noise: ImuNoiseConfig = group(ImuNoiseConfig)


@dataclass(frozen=True, slots=True)
class RtkScenario:
    """Hold the RTK receiver with two antennas; its status is always fixed."""

    rate_hz: float = param(5.0, "fixes per second", ("Hz", 0.1, 50))
    arrival_delay_s: float = param(0.08, "arrival minus measurement", ("s", 0, 2))
    position_sigma_m: tuple[float, ...] = _m((0.01, 0.01, 0.02), "north, east, down")
    velocity_sigma_m_s: tuple[float, ...] = _m_s((0.02, 0.02, 0.02), "north, east, down")
    lever_arm_m: tuple[float, ...] = _arm((-0.10, 0.32, 0.38), "first antenna from the IMU")
    second_antenna_m: tuple[float, ...] = _arm((0.90, 0.32, 0.38), "the other from the IMU")


@dataclass(frozen=True, slots=True)
class HeadingScenario:
    """Hold the heading of the two antennas."""

    sigma_deg: float = param(0.4, "white noise", ("deg", 0, 90))
    step_deg: float = param(1.0, "rounded to this; 0 = not rounded", ("deg", 0, 90))


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
    joint_order: str = param(USUAL_ORDER, "aircraft to camera", choices=JOINT_ORDERS)
    pitch_deg: float = param(-30.0, "commanded camera pitch", ("deg", -90, 30))
    pitch_step_deg: float = param(0.0, "change of it, in a second", ("deg", -90, 90))
    pitch_step_s: float = param(0.0, "when that begins", ("s", 0, 7200))
    lag_s: float = param(0.35, "with which it follows the nose", ("s", 0.02, 60))
    #: Camera roll and pitch from the commanded ones, not reported (Table 8).
    error_rms_deg: tuple[float, ...] = param((0.2704, 0.4839), "roll, pitch", ("deg", 0, 30))
    #: Reported camera heading less the true one by the autopilot's north: it drifts and jumps.
    north_bias_deg: float = param(0.0, "at the start", ("deg", -180, 180))
    north_drift_deg_s: float = param(0.0, "rate of that bias", ("deg/s", -1, 1))
    north_step_deg: float = param(0.0, "jump of that bias", ("deg", -180, 180))
    north_step_s: float = param(0.0, "when it jumps", ("s", 0, 7200))
    encoder_sigma_deg: float = param(0.02, "noise of a joint angle", ("deg", 0, 10))
    lever_arm_m: tuple[float, ...] = _arm((0.08, 0.0, -0.25), "pivot from the IMU")
    camera_offset_m: tuple[float, ...] = _arm((0.05, 0.02, -0.01), "camera from pivot, its axes")
    #: True mounting error about the camera's forward, left, up; not in params.yaml.
    boresight_rpy_deg: tuple[float, ...] = param(
        (0.0, 0.0, 0.0), "roll, pitch, yaw", ("deg", -45, 45)
    )

    @property
    def boresight_rpy_rad(self) -> Array:
        """Return roll, pitch, yaw (3,) of the mounting error about camera body FRD axes, rad."""
        return np.radians(flu_from_frd(np.array(self.boresight_rpy_deg)))
