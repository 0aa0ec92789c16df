"""Aid the filter with the ordinary GPS where RTK is missing.

Its position has an error of metres that varies over a minute. While RTK is fixed, that error is
estimated as a state of the filter, from one position a second. Without RTK, positions less the
estimated error continue from where RTK stopped, and the covariance grows as the error wanders.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aid import Aid
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS, AidStatus
from tirgeo_ros.core.navigation.aiding.rtk_position import innovation_n, position_design
from tirgeo_ros.core.navigation.aiding.state_estimate import (
    AidMeasurement,
    Measured,
    StateEstimate,
    added,
    not_fixed,
)
from tirgeo_ros.core.navigation.ins_error_model import GPS_ERROR
from tirgeo_ros.core.navigation.kalman import Measurement
from tirgeo_ros.core.navigation.strapdown import Vector, rotate
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source

#: While RTK is there the error is learned at this interval (a second less the jitter of stamps).
_LEARNING_NS = 950_000_000
#: Variation of a GPS error that still counts as the same error.
_SLACK_M = 2.0


class GpsPositionAid(Aid):
    """Use positions of the ordinary GPS, with their slow error as a state."""

    source = Source.GPS_POSITION
    delay = "gps.delay_s"
    look_at = "aircraft.gps_antenna_m, gps.delay_s"
    resets = GPS_ERROR  # a jump of it leaves the state unchanged

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._gps = config.gps
        self._lever_b: Vector = tuple(config.aircraft.gps_lever_b.tolist())
        noise_m2 = config.gps.position_noise_m**2
        self._noise = np.eye(3) * noise_m2
        self._known_m2 = np.square(config.gps.position_sigma_m) + noise_m2

    def spare(self, sample: PositionSample, control: AidStatus) -> bool:
        """Return whether RTK is fixed and used, and the error was learned within a second."""
        now_ns = sample.stamp_ns
        return (
            control.status is FixStatus.FIXED
            and control.track(Source.RTK_POSITION).recent(now_ns, self._timeout_ns)
            and control.track(self.source).recent(now_ns, _LEARNING_NS)
        )

    def measured(self, sample: PositionSample, belief: StateEstimate, _rate_b: Vector) -> Measured:
        """Return the measurement of a position with its slow error in it, and the belief."""
        if sample.status < FixStatus.SINGLE:
            return not_fixed(self.source, sample.status), belief
        state, error_n = belief.state, belief.control.receivers.gps_error_n
        lever_n = rotate(rotation_of(state.q_nb), self._lever_b)
        innovation = innovation_n(state, sample, added(lever_n, error_n))
        design = position_design(self._states, lever_n, gps=True)
        # Reported variance beyond that of the slow error in the state.
        beyond = np.maximum(np.diagonal(sample.covariance_n) - self._known_m2, 0.0)
        beyond *= self._white_factor(belief.control, sample.stamp_ns)
        noise = self._noise + np.diag(beyond)
        measurement = Measurement(np.array(innovation), design, noise, self._gps.gate_sigma)
        invariant = added(innovation, state.correction_n)
        return AidMeasurement(
            sample.source, sample.stamp_ns, measurement, invariant, state.correction_n, _SLACK_M
        ), belief

    def _white_factor(self, control: AidStatus, now_ns: int) -> float:
        """Return the factor that makes the variance of a lasting error one of white noise.

        Long without RTK no number of fixes averages a lasting error away. White noise with the
        same power at low frequency has 2 tau / step times its variance.
        """
        used_ns, rtk = control.track(self.source).used_ns, control.track(Source.RTK_POSITION)
        time_s = self._gps.position_time_s
        if used_ns == NEVER_NS or rtk.recent(now_ns, round(time_s * 1e9)):
            return 1.0
        step_s = min(max((now_ns - used_ns) * 1e-9, 0.02), 1.0)
        return max(2 * time_s / step_s, 1.0)
