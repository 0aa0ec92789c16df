"""Aid the filter with the autopilot's heading, where no other measurement holds the heading.

In a long hover or on a straight leg, gyroscopes and velocities alone lose the heading. The error
of the autopilot's heading lasts, so it is used only once the state's own is much worse.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import azimuth, heading_of, rotation_of, wrapped
from tirgeo_ros.core.navigation.aiding.aid import Aid
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS
from tirgeo_ros.core.navigation.aiding.state_estimate import (
    AidMeasurement,
    Modelled,
    StateEstimate,
)
from tirgeo_ros.core.navigation.ins.kalman import Measurement
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import AutopilotHeading, ImuSample, SetHeading, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: It is used where the state's heading sigma exceeds this multiple of its own.
_SIGMAS = 3.0
_GATE_SIGMA = 5.0
_AGAIN_NS = 1_000_000_000


def vertical_turn(
    sample: AutopilotHeading | SetHeading, variance_rad2: float, estimate: StateEstimate
) -> AidMeasurement:
    """Return the measurement of the nose's heading: a turn about the vertical alone.

    Tilt is known better than from such a heading.
    """
    off = wrapped(sample.heading_rad - azimuth(rotation_of(estimate.state.q_nb)[0::3]))
    design = np.zeros((1, len(estimate.covariance)))
    design[0, 2] = 1.0
    noise = np.array(((variance_rad2,),))
    measurement = Measurement(np.array((off,)), design, noise, _GATE_SIGMA)
    return AidMeasurement(sample.source, sample.stamp_ns, measurement, (off,), (0.0,), 0.0)


class AutopilotHeadingAid(Aid):
    """Make the samples and measurements of the autopilot's heading; it never resets anything."""

    source = Source.AUTOPILOT_HEADING
    unit = "rad"
    in_imu = True

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._newest_ns = NEVER_NS

    def configure(self, config: EkfConfig) -> None:
        """Take the parameters, also others in flight."""
        super().configure(config)
        self._variance_rad2 = math.radians(config.autopilot.attitude_sigma_deg[2]) ** 2
        self._worth_rad2 = _SIGMAS**2 * self._variance_rad2

    def _is_worth(self, covariance: Array) -> bool:
        """Return whether the state's heading is uncertain enough for the autopilot's to help."""
        return bool(covariance[2, 2] > self._worth_rad2)

    def of_imu(self, imu: ImuSample, covariance: Array) -> AutopilotHeading | None:
        """Return an IMU message's heading, at most one a second; None where it is of no use."""
        q_nb = imu.autopilot_q_nb
        if not self._is_worth(covariance) or not usable_attitude(q_nb) or q_nb is None:
            return None
        if 0 <= imu.stamp_ns - self._newest_ns < _AGAIN_NS:
            return None
        self._newest_ns = imu.stamp_ns
        return AutopilotHeading(imu.stamp_ns, heading_of(q_nb), self._variance_rad2)

    def measured(
        self, sample: AutopilotHeading, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement; STANDBY where the filter's own heading is better."""
        if not self._is_worth(estimate.covariance):
            reason = "the filter's heading is more precise"
            return Verdict(self.source, Outcome.STANDBY, reason), estimate
        return vertical_turn(sample, sample.variance_rad2, estimate), estimate
