"""Aid the filter with the autopilot's heading, where no other measurement holds the heading.

It gave the initial heading where no antennas did. The gyroscopes carry that on, and velocities
correct it while the aircraft accelerates; in a long hover or on a straight leg neither is enough.
The error of the autopilot's heading lasts. So it is used only once the state's own heading is much
worse, to be as good again as at the start.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.heading import azimuth, heading_of, wrapped
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aid import Aid
from tirgeo_ros.core.navigation.aiding.state_estimate import AidMeasurement, StateEstimate
from tirgeo_ros.core.navigation.kalman import Measurement
from tirgeo_ros.core.navigation.strapdown import Vector
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import AutopilotHeading, ImuSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: It is used where the state's heading sigma exceeds this multiple of its own.
_SIGMAS = 3.0
_GATE_SIGMA = 5.0
_AGAIN_NS = 1_000_000_000


class AutopilotHeadingAid(Aid):
    """Make the samples and measurements of the autopilot's heading; it never resets anything."""

    source = Source.AUTOPILOT_HEADING
    recorded = False

    def __init__(self, config: EkfConfig) -> None:
        self._variance_rad2 = math.radians(config.autopilot.attitude_sigma_deg[2]) ** 2
        self._worth_rad2 = _SIGMAS**2 * self._variance_rad2
        self._newest_ns: int | None = None

    def _is_worth(self, covariance: Array) -> bool:
        """Return whether the state's heading is uncertain enough for the autopilot's to help."""
        return bool(covariance[2, 2] > self._worth_rad2)

    def sample(self, imu: ImuSample, covariance: Array) -> AutopilotHeading | None:
        """Return the heading sample of an IMU message, or None where it is not worth using.

        There is one a second at most. ``covariance`` (n, n) is that of the error states.
        """
        newest_ns, q_nb = self._newest_ns, imu.autopilot_q_nb
        if not self._is_worth(covariance) or not usable_attitude(q_nb) or q_nb is None:
            return None
        if newest_ns is not None and 0 <= imu.stamp_ns - newest_ns < _AGAIN_NS:
            return None
        self._newest_ns = imu.stamp_ns
        return AutopilotHeading(imu.stamp_ns, heading_of(q_nb), self._variance_rad2)

    def measured(
        self,
        sample: AutopilotHeading,
        belief: StateEstimate,
        angular_rate_b: Vector,  # noqa: ARG002
    ) -> tuple[AidMeasurement | Verdict, StateEstimate]:
        """Return the measurement: a turn about the vertical alone, for tilt is known better."""
        if not self._is_worth(belief.covariance):
            reason = "the heading is known better"
            return Verdict(self.source, Outcome.STANDBY, reason), belief
        nose_n = rotation_of(belief.state.q_nb)[0::3]
        off = wrapped(sample.heading_rad - azimuth(nose_n))
        design = np.zeros((1, len(belief.covariance)))
        design[0, 2] = 1.0
        noise = np.array(((sample.variance_rad2,),))
        measurement = Measurement(np.array((off,)), design, noise, _GATE_SIGMA)
        return AidMeasurement(
            Source.AUTOPILOT_HEADING, sample.stamp_ns, measurement, (off,), (0.0,), 0.0
        ), belief
