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
"""Define the parameters of ekf_node and of the filter in ``tirgeo process``, each default once.

Defaults for the IMU are Table 5 of Ren et al. 2022.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tirgeo_ros.core.config.aircraft_parameters import AircraftConfig, TransformsConfig
from tirgeo_ros.core.config.schema import group, param
from tirgeo_ros.core.frames.rotations import flu_from_frd
from tirgeo_ros.core.types.arrays import Array

METHODS = ("raw", "rtk", "ekf", "ekf_heading")
_DELAY, _PATIENCE = ("s", -2, 2), ("s", 0.1, 3600)


def _gate(default: float, what: str) -> Any:
    return param(
        default,
        f"innovation gate: reject {what} further than this many standard deviations from the "
        "prediction",
        ("", 1, 1e6),
    )


def _floor(default: float, of: str, within: tuple[str, float, float]) -> Any:
    text = f"smallest standard deviation accepted for {of}; smaller reported ones are raised to it"
    return param(default, text, within)


@dataclass(frozen=True, slots=True)
class RtkConfig:
    """The RTK receiver's position and velocity."""

    median_window: int = param(1, "number of positions in the median filter; 1 = off", ("", 1, 99))
    delay_s: float = param(
        0.0,
        "delay of the RTK stamps: stamp minus time of measurement; negative where they are early",
        _DELAY,
    )
    velocity_delay_s: float = param(
        0.0, "extra delay of the velocities, for receivers that smooth them", _DELAY
    )
    position_sigma_floor_m: float = _floor(0.01, "a position, per axis", ("m", 1e-4, 100))
    velocity_sigma_floor_m_s: float = _floor(0.02, "a velocity, per axis", ("m/s", 1e-4, 100))
    gate_sigma: float = _gate(5.0, "measurements")
    float_sigma_m: float = _floor(0.3, "a float position", ("m", 0, 100))
    float_time_s: float = param(
        20.0, "correlation time of the error of a float position", ("s", 1e-3, 1e5)
    )
    reset_after_s: float = param(
        2.0,
        "reset the state to the positions or velocities if they were rejected for this long and "
        "agree with each other",
        _PATIENCE,
    )


@dataclass(frozen=True, slots=True)
class HeadingConfig:
    """The heading of the two RTK antennas."""

    delay_s: float = param(
        math.nan, "delay of the stamps, as rtk.delay_s; unset = rtk.delay_s", _DELAY
    )
    sigma_floor_deg: float = param(
        0.6,
        "smallest standard deviation accepted for a heading; 0.6 suits headings in whole degrees, "
        "whose rounding error stays the same along a leg",
        ("deg", 1e-3, 180),
    )
    gate_sigma: float = _gate(4.0, "headings")
    start_after_s: float = param(
        1.0, "time for which rtk/fix must be fixed before headings are used", ("s", 0, 60)
    )
    reset_after_s: float = param(
        5.0,
        "reset the heading to the measured one if headings were rejected for this long and agree "
        "with each other",
        _PATIENCE,
    )
    set_sigma_deg: float = param(
        5.0,
        "standard deviation of a heading on ~/set_heading that comes without a variance",
        ("deg", 0.1, 90),
    )


@dataclass(frozen=True, slots=True)
class GpsConfig:
    """The autopilot's ordinary GPS."""

    position_sigma_m: tuple[float, ...] = param(
        (0.9342, 1.2846, 2.8017),
        "standard deviation north, east, down of a position without covariance",
        ("m", 1e-3, 1e4),
    )
    position_time_s: float = param(45.0, "correlation time of the position error", ("s", 0.1, 1e6))
    position_noise_m: float = param(
        0.05, "sigma of the position's white noise, independent in each fix", ("m", 1e-3, 100)
    )
    velocity_sigma_floor_m_s: float = _floor(0.1, "a velocity, per axis", ("m/s", 1e-3, 100))
    velocity_error_m_s: float = param(
        0.3,
        "sigma of the velocity's slow error, per axis; reported variance beyond it is slow too",
        ("m/s", 1e-4, 100),
    )
    delay_s: float = param(0.0, "delay of the stamps, as rtk.delay_s", _DELAY)
    gate_sigma: float = _gate(5.0, "measurements")


@dataclass(frozen=True, slots=True)
class BarometerConfig:
    """The barometer (baro/pressure), which holds the height while satellites are missing."""

    delay_s: float = param(0.0, "delay of the stamps, as rtk.delay_s", _DELAY)
    noise_m: float = param(
        1.0,
        "smallest standard deviation accepted for the white noise of one reading, as a height",
        ("m", 1e-3, 100),
    )
    sigma_m: float = param(
        0.5, "sigma of the slow error from airspeed, rotor wash and gusts", ("m", 1e-2, 100)
    )
    time_s: float = param(20.0, "correlation time of the slow error", ("s", 0.1, 1e5))
    drift: float = param(
        0.05, "random walk of the air pressure, as a height", ("m/sqrt(s)", 0, 10)
    )
    scale_sigma: float = param(
        0.05,
        "sigma of the relative error of a change of height; 0.035 per 10 K from the standard "
        "atmosphere",
        ("", 0, 1),
    )
    gate_sigma: float = _gate(5.0, "heights")
    reset_after_s: float = param(
        2.0,
        "take a new offset if heights were rejected for this long and agree with each other",
        _PATIENCE,
    )

    @property
    def density(self) -> float:
        """Return the density of the offset's random walk, m/sqrt(s): drift and slow error."""
        return math.sqrt(self.drift**2 + 2 * self.sigma_m**2 / self.time_s)


@dataclass(frozen=True, slots=True)
class ImuNoiseConfig:
    """Noise of the IMU: white noise and a first-order Gauss-Markov bias on each axis (x, y, z)."""

    angle_random_walk: tuple[float, ...] = param(
        (1.6828e-4, 1.9601e-4, 1.6542e-4), "gyroscope white noise", ("rad/sqrt(s)", 0, 1)
    )
    velocity_random_walk: tuple[float, ...] = param(
        (1.2917e-2, 1.2996e-2, 1.2921e-2), "accelerometer white noise", ("m/s/sqrt(s)", 0, 10)
    )
    gyro_bias_instability: tuple[float, ...] = param(
        (1.5289e-6, 3.7010e-5, 2.2793e-6), "sigma of the gyroscope bias", ("rad/s", 0, 1)
    )
    gyro_bias_time_s: tuple[float, ...] = param(
        (7000.0, 100.0, 9000.0), "correlation time of that bias", ("s", 1e-3, 1e9)
    )
    accel_bias_instability: tuple[float, ...] = param(
        (6.0546e-3, 2.8561e-3, 7.9284e-3), "sigma of the accelerometer bias", ("m/s2", 0, 10)
    )
    accel_bias_time_s: tuple[float, ...] = param(
        (20.0, 600.0, 10000.0), "correlation time of that bias", ("s", 1e-3, 1e9)
    )
    gyro_turn_on_bias: float = param(
        7e-3, "sigma of the gyroscope bias at start, per axis", ("rad/s", 0, 1)
    )
    accel_turn_on_bias: float = param(
        2e-2, "sigma of the accelerometer bias at start, per axis", ("m/s2", 0, 10)
    )


@dataclass(frozen=True, slots=True)
class ImuConfig(ImuNoiseConfig):
    """The IMU: its biases, its noise on each axis, what vibration adds to it, and its delay."""

    gyro_bias: tuple[float, ...] = param(
        (0.0, 0.0, 0.0), "expected bias at start, forward, left, up", ("rad/s", -1, 1)
    )
    accel_bias: tuple[float, ...] = param(
        (0.0, 0.0, 0.0), "expected bias at start, forward, left, up", ("m/s2", -10, 10)
    )
    gyro_vibration_share: float = param(
        0.3,
        "share of the vibration measured in flight that counts as white noise of the gyroscope; "
        "0 = the configured noise alone",
        ("", 0, 10),
    )
    accel_vibration_share: float = param(
        0.9,
        "the same share for the accelerometer",
        ("", 0, 10),
    )
    delay_s: float = param(
        0.0,
        "delay of the IMU stamps: stamp minus time of measurement; half the sample interval for "
        "an IMU that averages over it. Poses carry the corrected time",
        ("s", -0.5, 0.5),
    )
    delay_sigma_s: float = param(
        0.005,
        "sigma of the part of that delay that is not known; the filter estimates it in turns, and "
        "corrects poses for it. 0 = delay_s is exact",
        ("s", 0, 0.05),
        live=False,
    )

    @property
    def bias_b(self) -> Array:
        """Return the expected biases (6,), FRD: gyroscope rad/s, accelerometer m/s2."""
        return flu_from_frd(np.array([self.gyro_bias, self.accel_bias])).ravel()

    @property
    def bias_variances(self) -> Array:
        """Return the variances (6,) of the biases at start: turn-on, and variation in the run."""
        turn_on = np.repeat([self.gyro_turn_on_bias, self.accel_turn_on_bias], 3)
        in_run = (*self.gyro_bias_instability, *self.accel_bias_instability)
        return np.asarray(np.square(turn_on) + np.square(in_run))


@dataclass(frozen=True, slots=True)
class AutopilotConfig:
    """The autopilot's own attitude, which the methods ``raw`` and ``rtk`` take as it is."""

    attitude_sigma_deg: tuple[float, ...] = param(
        (0.5, 0.5, 1.7972), "sigma of roll, pitch, heading", ("deg", 1e-3, 180)
    )


@dataclass(frozen=True, slots=True)
class AlignmentConfig:
    """The initial attitude of the filter."""

    duration_s: float = param(
        1.0, "time over which accelerometer and velocity are compared", ("s", 0.2, 30)
    )
    wait_s: float = param(
        5.0,
        "longest wait for RTK and its heading before GPS or the autopilot's heading is used",
        ("s", 0, 3600),
    )


@dataclass(frozen=True, slots=True)
class TrustConfig:
    """When an aid counts as missing, and when the state counts as lost."""

    aid_timeout_s: float = param(
        1.5, "time without a used measurement until an aid counts as missing", ("s", 0.1, 60)
    )
    lost_position_sigma_m: float = param(
        10.0,
        "sigma of the position beyond which it counts as lost; at least 1.5 times what the "
        "receivers report",
        ("m", 0.1, 1e4),
    )
    lost_heading_sigma_deg: float = param(
        10.0, "sigma of the heading beyond which it counts as lost", ("deg", 0.1, 180)
    )


@dataclass(frozen=True, slots=True)
class EkfConfig(TransformsConfig):
    """Parameters of ekf_node."""

    method: str = param(
        "ekf_heading",
        "raw (autopilot's GPS and attitude), rtk (RTK position, autopilot's attitude), ekf (the "
        "filter without heading) or ekf_heading (with the heading of two antennas)",
        choices=METHODS,
    )
    position_update: str = param(
        "fused",
        "fused (a full update), or rtk_direct (the position is the RTK's, as in Ren et al. 2022)",
        choices=("fused", "rtk_direct"),
    )
    publish_rate_hz: float = param(
        100.0, "highest rate of tirgeo/odometry", ("Hz", 0.1, 1000), live=True
    )
    fix_rate_hz: float = param(10.0, "highest rate of tirgeo/fix", ("Hz", 0.1, 1000), live=True)
    max_delay_s: float = param(
        0.5,
        "largest delay behind the IMU at which a measurement is still used",
        ("s", 0, 5),
        live=True,
    )
    max_imu_gap_s: float = param(
        0.2, "longest gap between IMU samples that is bridged", ("s", 1e-3, 5), live=True
    )
    origin_lat_lon_h: tuple[float, ...] = param(
        (),
        "origin of map: latitude, longitude (deg), ellipsoidal height (m); empty = first RTK fix",
        sizes=(0, 3),
    )
    imu: ImuConfig = group(ImuConfig, live=True)
    rtk: RtkConfig = group(RtkConfig, live=True)
    heading: HeadingConfig = group(HeadingConfig, live=True)
    gps: GpsConfig = group(GpsConfig, live=True)
    barometer: BarometerConfig = group(BarometerConfig, live=True)
    autopilot: AutopilotConfig = group(AutopilotConfig, live=True)
    alignment: AlignmentConfig = group(AlignmentConfig, live=True)
    trust: TrustConfig = group(TrustConfig, live=True)
    aircraft: AircraftConfig = group(AircraftConfig)
