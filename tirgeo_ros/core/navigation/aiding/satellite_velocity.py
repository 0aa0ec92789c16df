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
"""Aid the filter with the satellite velocities of an antenna, RTK's and ordinary GPS's."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.filter_parameters import GpsConfig
from tirgeo_ros.core.frames.rotations import rotation_of, skew
from tirgeo_ros.core.navigation.aiding.aid import (
    Aid,
    AidMeasurement,
    Modelled,
    StateEstimate,
    added,
    floored,
    not_fixed,
)
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS, AidStatus
from tirgeo_ros.core.navigation.aiding.satellite_position import arm_design
from tirgeo_ros.core.navigation.ins.error_states import (
    ANTENNA,
    GPS_VELOCITY_ERROR,
    VELOCITY,
    flat_memory,
    has_antenna,
)
from tirgeo_ros.core.navigation.ins.kalman import Measurement
from tirgeo_ros.core.navigation.ins.strapdown import Rotation, Vector, cross, matrix, rotate
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus, Source, VelocitySample
from tirgeo_ros.core.types.verdicts import Outcome, Verdict


def velocity_design(
    states: int, rotation_nb: Rotation, swing: Vector, lever_arm_b: Vector
) -> Array:
    """Return H (3, states) of an antenna velocity: the lever arm swings with the body's rate.

    The rate is the reading less its bias, so ``d(w x l) = -db x l = [l x] db``.
    """
    design = arm_design(states, swing, VELOCITY.start)
    flat = flat_memory(design)
    x, y, z = lever_arm_b
    for row in range(3):
        a, b, c = rotation_nb[3 * row : 3 * row + 3]
        at = row * states + 9
        flat[at], flat[at + 1], flat[at + 2] = b * z - c * y, c * x - a * z, a * y - b * x
    return design


def split_velocity_noise(sample: VelocitySample, gps: GpsConfig) -> tuple[Array, Array]:
    """Return the white noise (3, 3) of a GPS velocity, and the variances (3,) that are not white.

    Those are what a receiver reports beyond ``gps.velocity_error_m_s``: such errors last.
    """
    reported = floored(sample.covariance_n, gps.velocity_sigma_floor_m_s)
    most = max(gps.velocity_error_m_s, gps.velocity_sigma_floor_m_s) ** 2
    variances = np.diagonal(reported)
    if max(variances) <= most:
        return reported, np.zeros(3)
    white = np.minimum(variances, most)
    return np.diag(white), variances - white


class VelocityAid(Aid):
    """Use the velocities of one receiver."""

    unit = "m/s"
    moved = "velocity changed by"
    resets = VELOCITY

    def __init__(self, config: EkfConfig) -> None:
        """Take the parameters of the receiver, and its antenna's lever arm."""
        super().__init__(config)
        rtk = self.source is Source.RTK_VELOCITY
        receiver = config.rtk if rtk else config.gps
        self._lever_b: Vector = tuple(config.aircraft.antenna_b(self.source).tolist())
        self._slow = None if rtk else config.gps
        self._estimates_antenna = rtk and has_antenna(self._states)
        self._floor_m_s = receiver.velocity_sigma_floor_m_s
        self._gate_sigma = receiver.gate_sigma

    def measured(
        self, sample: VelocitySample, estimate: StateEstimate, angular_rate_b: Vector
    ) -> Modelled:
        """Return the measurement and the estimate."""
        state = estimate.state
        rotation = rotation_of(state.q_nb)
        lever_b = self._lever_b
        if self._estimates_antenna:
            lever_b = added(lever_b, estimate.aids.receivers.antenna_b)
        swing = rotate(rotation, cross(angular_rate_b, lever_b))  # against the IMU, m/s
        (north, east, down), (vn, ve, vd) = sample.velocity_n.tolist(), state.velocity_n
        innovation = north - vn - swing[0], east - ve - swing[1], down - vd - swing[2]
        noise = floored(sample.covariance_n, self._floor_m_s)
        design = velocity_design(self._states, rotation, swing, lever_b)
        if self._slow:
            u, v, w = estimate.aids.receivers.gps_velocity_error_n
            innovation = innovation[0] - u, innovation[1] - v, innovation[2] - w
            design[:, GPS_VELOCITY_ERROR] = np.eye(3)
            noise, beyond = split_velocity_noise(sample, self._slow)
            if estimate.aids.track(Source.RTK_POSITION).used_ns == NEVER_NS:
                beyond = beyond + self._slow.velocity_error_m_s**2  # nothing else tells
            time_s = self._slow.position_time_s
            estimate = self.widened(sample, estimate, GPS_VELOCITY_ERROR, beyond, time_s)
        if self._estimates_antenna:
            design[:, ANTENNA] = matrix(rotation) @ skew(np.array(angular_rate_b))
        measurement = Measurement(np.array(innovation), design, noise, self._gate_sigma)
        scatter = math.sqrt(noise[0, 0] + noise[1, 1] + noise[2, 2])
        slack = 1.5 * self._gate_sigma * scatter
        return AidMeasurement(
            sample.source, sample.stamp_ns, measurement, innovation, (0.0,) * 3, slack
        ), estimate

    def patience_s(self, aid: AidMeasurement, estimate: StateEstimate) -> float:
        """Return how long a run must last; infinite while RTK positions confirm the state."""
        if estimate.aids.track(Source.RTK_POSITION).recent(aid.stamp_ns, self._timeout_ns):
            return math.inf
        return super().patience_s(aid, estimate)


class RtkVelocityAid(VelocityAid):
    """Use velocities of a float or fixed RTK, unless the fixes contradict them for long."""

    source = Source.RTK_VELOCITY
    delay = "rtk.delay_s"
    look_at = "rtk.velocity_delay_s, aircraft.rtk_antenna_m"
    steps = True
    eased = True

    @classmethod
    def delay_s(cls, config: EkfConfig) -> float:
        """Return the delay of positions plus that of velocities, s."""
        return config.rtk.delay_s + config.rtk.velocity_delay_s

    def measured(
        self, sample: VelocitySample, estimate: StateEstimate, angular_rate_b: Vector
    ) -> Modelled:
        """Return the measurement, or NOT_FIXED by the newest status of ``rtk/fix``."""
        status = estimate.aids.rtk.at(sample.stamp_ns, self._timeout_ns)
        if status is not None and status < FixStatus.FLOAT:
            return not_fixed(self.source, status), estimate
        aid, estimate = super().measured(sample, estimate, angular_rate_b)
        assert isinstance(aid, AidMeasurement)
        north, east, down = aid.invariant
        against_imu_n = added((north, east, down), estimate.state.push_n)
        rtk, noise = estimate.aids.rtk, aid.measurement.noise
        consistency = rtk.consistency.with_velocity(sample, noise, against_imu_n)
        aids = estimate.aids._replace(rtk=rtk._replace(consistency=consistency))
        estimate = StateEstimate(estimate.state, estimate.covariance, aids)
        reason = consistency.reason(self.source)
        return (Verdict(self.source, Outcome.GATED, reason) if reason else aid), estimate


class GpsVelocityAid(VelocityAid):
    """Use velocities of the ordinary GPS while those of RTK are missing.

    Without RTK from the start, or with a poor accuracy reported, they have a slow error, a state.
    """

    source = Source.GPS_VELOCITY
    delay = look_at = "gps.delay_s"

    def spare(self, sample: VelocitySample, aids: AidStatus) -> bool:
        """Return whether RTK's velocity was used within the time-out."""
        return aids.track(Source.RTK_VELOCITY).recent(sample.stamp_ns, self._timeout_ns)
