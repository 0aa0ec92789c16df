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
"""Aid the filter with a heading of the nose: the autopilot's, or one that a person sets.

In a long hover or on a straight leg, gyroscopes and velocities alone lose the heading. The error
of the autopilot's heading lasts, so it is used only once the state's heading is much worse.

A heading that a person sets completes an alignment that lacks one, and corrects a filter whose
heading is worse. It is weighted by its standard deviation, and never replaces a better heading.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import azimuth, heading_of, rotation_of, wrapped
from tirgeo_ros.core.navigation.aiding.aid import (
    Aid,
    AidMeasurement,
    Modelled,
    StateEstimate,
    lost_heading_rad,
)
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS, AidTrack
from tirgeo_ros.core.navigation.ins.kalman import Measurement
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import AutopilotHeading, ImuSample, SetHeading, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: The autopilot's heading is used if the state's heading sigma exceeds its own by this factor.
_SIGMAS = 3.0
_GATE_SIGMA = 5.0
_AGAIN_NS = 1_000_000_000  # between two of the autopilot's headings
#: Least ratio of the filter's variance to that of the heading, for the heading to be of use.
_LEAST_RATIO = 1.01


def vertical_turn(
    sample: AutopilotHeading | SetHeading, variance_rad2: float, estimate: StateEstimate
) -> AidMeasurement:
    """Return the measurement of a heading of the nose: a turn about the vertical only."""
    off = wrapped(sample.heading_rad - azimuth(rotation_of(estimate.state.q_nb)[0::3]))
    design = np.zeros((1, len(estimate.covariance)))
    design[0, 2] = 1.0
    noise = np.array(((variance_rad2,),))
    measurement = Measurement(np.array((off,)), design, noise, _GATE_SIGMA)
    return AidMeasurement(sample.source, sample.stamp_ns, measurement, (off,), (0.0,), 0.0)


class AutopilotHeadingAid(Aid):
    """Use the autopilot's heading; it never causes a reset."""

    source = Source.AUTOPILOT_HEADING
    unit = "rad"
    in_imu = True

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._newest_ns = NEVER_NS
        self._variance_rad2 = math.radians(config.autopilot.attitude_sigma_deg[2]) ** 2
        self._needed_rad2 = _SIGMAS**2 * self._variance_rad2

    def _is_needed(self, covariance: Array) -> bool:
        """Return whether the state's heading is uncertain enough for the autopilot's to help."""
        return bool(covariance[2, 2] > self._needed_rad2)

    def of_imu(self, imu: ImuSample, covariance: Array) -> AutopilotHeading | None:
        """Return an IMU message's heading, at most one a second; None if it is not needed."""
        q_nb = imu.autopilot_q_nb
        if not self._is_needed(covariance) or not usable_attitude(q_nb) or q_nb is None:
            return None
        if 0 <= imu.stamp_ns - self._newest_ns < _AGAIN_NS:
            return None
        self._newest_ns = imu.stamp_ns
        return AutopilotHeading(imu.stamp_ns, heading_of(q_nb), self._variance_rad2)

    def measured(
        self, sample: AutopilotHeading, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement; STANDBY if the filter's own heading is better."""
        if not self._is_needed(estimate.covariance):
            reason = "the filter's heading is more precise"
            return Verdict(self.source, Outcome.STANDBY, reason), estimate
        return vertical_turn(sample, sample.variance_rad2, estimate), estimate


def set_variance_rad2(sample: SetHeading, config: EkfConfig) -> float:
    """Return the variance of a heading that was set; from the parameter if it has none."""
    if sample.variance_rad2 > 0:
        return sample.variance_rad2
    return math.radians(config.heading.set_sigma_deg) ** 2


class SetHeadingAid(Aid):
    """Use a heading of the nose that a person sets."""

    source = Source.SET_HEADING

    @classmethod
    def useless(cls, sample: SetHeading, config: EkfConfig) -> Verdict | None:
        """Return the verdict on a heading so uncertain that a state with it is lost, else None."""
        sigma_rad = math.sqrt(set_variance_rad2(sample, config))
        limit_rad = lost_heading_rad(config)
        if sigma_rad < limit_rad:
            return None
        reason = (
            f"a sigma of {math.degrees(sigma_rad):.1f} deg is too large: give a variance below "
            f"{limit_rad**2:.3g} rad2, the {math.degrees(limit_rad):.0f} deg at which a state is "
            "lost"
        )
        return Verdict(cls.source, Outcome.INVALID, reason)

    def measured(self, sample: SetHeading, estimate: StateEstimate, _rate_b: Vector) -> Modelled:
        """Return the measurement; STANDBY if the filter's own heading is better."""
        useless = self.useless(sample, self._config)
        if useless is not None:
            return useless, estimate
        variance = set_variance_rad2(sample, self._config)
        own = max(float(estimate.covariance[2, 2]), 0.0)
        if own <= _LEAST_RATIO * variance:
            reason = (
                f"the filter's own heading is better, {math.degrees(math.sqrt(own)):.1f} deg: "
                "call ~/reset first if it is wrong"
            )
            return Verdict(self.source, Outcome.STANDBY, reason), estimate
        # With this noise the state's heading becomes as certain as the one that was set, and no
        # more certain if the same heading is set again.
        noise = 1 / (1 / variance - 1 / own)
        return vertical_turn(sample, noise, estimate), estimate

    def off(self, aid: AidMeasurement, _track: AidTrack) -> str:
        """Describe how far a heading is off."""
        return f"{math.degrees(abs(float(aid.measurement.innovation[0]))):.0f} deg off"
