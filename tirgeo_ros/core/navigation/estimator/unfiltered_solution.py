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
"""Estimate the baselines ``raw`` and ``rtk``: the autopilot's attitude and a satellite position.

Between two positions, the last position is extrapolated with the last velocity, unfiltered. No
IMU is needed: attitudes may come alone, at any interval.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import canonical, matrix_from_quat, wrapped
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.aiding.aid import Aiding
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample, PositionSample, Source, VelocitySample
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

_LARGEST_AGE_S = 1.0
#: Sampling rate assumed to convert the gyroscopes' noise density to a variance of one reading.
_NOMINAL_RATE_HZ = 100.0
#: Rate, and its variance, of a sample that has only an attitude: not known.
_NO_RATE_B, _UNKNOWN_RAD2_S2 = np.zeros(3), (1e6, 1e6, 1e6)


class UnfilteredSolution:
    """Estimate the pose from the autopilot's attitude and ``source`` (RTK or GPS position)."""

    def __init__(self, config: EkfConfig, source: Source) -> None:
        self._source, rtk = source, source is Source.RTK_POSITION
        self._velocity_source = Source.RTK_VELOCITY if rtk else Source.GPS_VELOCITY
        self._lever_b = config.aircraft.antenna_b(source)
        self._imu: ImuSample | None = None
        self._position: PositionSample | None = None
        self._velocity: VelocitySample | None = None
        self.configure(config)

    def configure(self, config: EkfConfig) -> None:
        """Take the parameters, at the start or in flight."""
        rtk = self._source is Source.RTK_POSITION
        gps_m, rtk_m = config.gps.position_sigma_m, config.rtk.position_sigma_floor_m
        self._default_covariance = np.diag(np.square((rtk_m,) * 3 if rtk else gps_m))
        walk, bias = config.imu.angle_random_walk, config.imu.gyro_turn_on_bias
        x, y, z = (w * w * _NOMINAL_RATE_HZ + bias * bias for w in walk)
        self._rate_variance_b = (x, y, z)
        self._attitude_covariance = np.diag(np.radians(config.autopilot.attitude_sigma_deg) ** 2)

    @property
    def reason(self) -> str:
        """Return what is missing for a solution, or an empty string."""
        if self._imu is None or not usable_attitude(self._imu.autopilot_q_nb):
            return "imu/data has no orientation"
        if self._position is None or not self._fresh(self._position):
            return f"no {self._source.topic} within {_LARGEST_AGE_S:g} s"
        return ""

    def add_imu(self, sample: ImuSample) -> tuple[Outcome, str]:
        """Store an IMU sample; the solution uses its attitude and angular rate."""
        self._imu = sample
        if usable_attitude(sample.autopilot_q_nb):
            return Outcome.USED, ""
        return Outcome.INVALID, "no orientation"

    def add_aiding(self, sample: Aiding) -> Verdict:
        """Store a position or a velocity of the chosen receiver; any other sample is UNUSED."""
        if isinstance(sample, PositionSample) and sample.source is self._source:
            self._position = sample
        elif isinstance(sample, VelocitySample) and sample.source is self._velocity_source:
            self._velocity = sample
        else:
            return Verdict(sample.source, Outcome.UNUSED)
        return Verdict(sample.source, Outcome.USED)

    def solution(self) -> NavSolution | None:
        """Return the position extrapolated to the newest IMU sample, or None (see ``reason``)."""
        imu, position, velocity = self._imu, self._position, self._velocity
        if self.reason or imu is None or position is None or imu.autopilot_q_nb is None:
            return None
        covariance = np.zeros((9, 9))
        covariance[:3, :3] = _or_else(position.covariance_n, self._default_covariance)
        covariance[3:6, 3:6] = self._attitude_covariance
        velocity_n, covariance[6:, 6:] = np.zeros(3), np.eye(3)
        if velocity is not None and self._fresh(velocity):
            velocity_n = velocity.velocity_n
            covariance[6:, 6:] = _or_else(velocity.covariance_n, np.eye(3))
        age_s = (imu.stamp_ns - position.stamp_ns) * 1e-9  # negative: measured after the IMU
        shift = velocity_n * age_s - matrix_from_quat(imu.autopilot_q_nb) @ self._lever_b
        meridian, transverse = radii_of_curvature(position.latitude_rad)
        east_m = (transverse + position.height_m) * np.cos(position.latitude_rad)
        latitude = position.latitude_rad + float(shift[0]) / (meridian + position.height_m)
        longitude = wrapped(position.longitude_rad + float(shift[1]) / float(east_m))
        place = latitude, longitude, position.height_m - float(shift[2])
        rate_b, variance_b = imu.angular_rate_b, self._rate_variance_b
        if imu.is_attitude_alone:
            rate_b, variance_b = _NO_RATE_B, _UNKNOWN_RAD2_S2
        motion = velocity_n, canonical(imu.autopilot_q_nb), rate_b
        return NavSolution(imu.stamp_ns, *place, *motion, variance_b, covariance)

    def _fresh(self, sample: PositionSample | VelocitySample) -> bool:
        imu = self._imu
        return imu is not None and abs(imu.stamp_ns - sample.stamp_ns) * 1e-9 <= _LARGEST_AGE_S


def _or_else(covariance: Array, otherwise: Array) -> Array:
    """Return ``covariance``, or ``otherwise`` if one of its variances is unknown (zero)."""
    return covariance if np.all(np.diag(covariance) > 0) else otherwise
