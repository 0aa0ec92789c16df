"""Aid the filter with the position of the ordinary GPS.

Its error, metres that vary over a minute, is a state of the filter. While RTK is fixed it is
learned from one position a second. Without RTK, positions less the estimated error continue from
where RTK stopped, and the covariance grows as the error wanders.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aid import Aid, uncorrelated
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS, AidStatus
from tirgeo_ros.core.navigation.aiding.gnss_antenna import arm_design, innovation_n, white_factor
from tirgeo_ros.core.navigation.aiding.state_estimate import (
    AidMeasurement,
    Modelled,
    StateEstimate,
    added,
    not_fixed,
)
from tirgeo_ros.core.navigation.ins.ins_error_model import GPS_ERROR, POSITION
from tirgeo_ros.core.navigation.ins.kalman import Change, Measurement, cut
from tirgeo_ros.core.navigation.ins.strapdown import Vector, rotate
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source

#: While RTK is there the GPS error is learned at this interval: a second less stamp jitter.
_LEARNING_NS = 950_000_000
#: Variation of a GPS error that still counts as the same error.
_SLACK_M = 2.0


class GpsPositionAid(Aid):
    """Use positions of the ordinary GPS, with their slow error as a state."""

    source = Source.GPS_POSITION
    delay = "gps.delay_s"
    look_at = "aircraft.gps_antenna_m, gps.delay_s"
    moved = "GPS error changed by"

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._gps = config.gps
        self._lever_b: Vector = tuple(config.aircraft.gps_lever_b.tolist())
        noise_m2 = config.gps.position_noise_m**2
        self._noise = np.eye(3) * noise_m2
        self._modelled_m2 = np.square(config.gps.position_sigma_m) + noise_m2

    def spare(self, sample: PositionSample, aids: AidStatus) -> bool:
        """Return whether RTK is fixed and used, and the error was learned within a second."""
        now_ns = sample.stamp_ns
        return (
            aids.rtk.status is FixStatus.FIXED
            and aids.track(Source.RTK_POSITION).recent(now_ns, self._timeout_ns)
            and aids.track(self.source).recent(now_ns, _LEARNING_NS)
        )

    def measured(
        self, sample: PositionSample, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement of a position with its slow error in it, and the estimate."""
        if sample.status < FixStatus.SINGLE:
            return not_fixed(self.source, sample.status), estimate
        state, error_n = estimate.state, estimate.aids.receivers.gps_error_n
        lever_n = rotate(rotation_of(state.q_nb), self._lever_b)
        innovation = innovation_n(state, sample, added(lever_n, error_n))
        design = arm_design(self._states, lever_n, POSITION.start)
        design[:, GPS_ERROR] = np.eye(3)
        # Reported variance beyond that of the slow error in the state.
        beyond = np.maximum(np.diagonal(sample.covariance_n) - self._modelled_m2, 0.0)
        beyond *= self._beyond_factor(estimate.aids, sample.stamp_ns)
        noise = self._noise + np.diag(beyond)
        measurement = Measurement(np.array(innovation), design, noise, self._gps.gate_sigma)
        invariant = added(innovation, state.correction_n)
        return AidMeasurement(
            sample.source, sample.stamp_ns, measurement, invariant, state.correction_n, _SLACK_M
        ), estimate

    def _beyond_factor(self, aids: AidStatus, now_ns: int) -> float:
        """Return the factor on variances beyond the state's: 1 until RTK is gone for long."""
        used_ns, rtk = aids.track(self.source).used_ns, aids.track(Source.RTK_POSITION)
        time_s = self._gps.position_time_s
        if used_ns == NEVER_NS or rtk.recent(now_ns, round(time_s * 1e9)):
            return 1.0
        return white_factor(time_s, now_ns - used_ns)

    def reset(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate:
        """Set the GPS error as measured; a jump of the GPS leaves the position unchanged."""
        state, aids = estimate.state, estimate.aids
        innovation, noise = aid.measurement.innovation, aid.measurement.noise
        covariance = uncorrelated(estimate.covariance, GPS_ERROR)
        transition = cut(len(covariance), GPS_ERROR)
        covariance[GPS_ERROR, GPS_ERROR] = noise
        # Their sum is measured: the error of the one is that of the other, negated.
        covariance[GPS_ERROR, :] -= covariance[POSITION, :]
        covariance[:, GPS_ERROR] -= covariance[:, POSITION]
        transition[GPS_ERROR, POSITION] = -np.eye(3)
        aids = aids._replace(receivers=aids.receivers.changed(innovation.tolist()))
        aids = self.with_reset(aids, aid.stamp_ns, float(np.linalg.norm(innovation)))
        return StateEstimate(state, covariance, aids, (Change(covariance, transition),))
