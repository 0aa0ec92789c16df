"""Aid the filter with the position of RTK's antenna (Eq. 4 of Ren et al. 2022).

The solution of a receiver may step, by a wrong fix or from float to fixed. While it has stepped,
only the motion that it reports is used; once the step has lasted, the position follows it.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aid import Aid
from tirgeo_ros.core.navigation.aiding.aid_status import EASE_STEPS, STEPPED_S, AidStatus, AidTrack
from tirgeo_ros.core.navigation.aiding.gnss_antenna import arm_design, innovation_n, white_factor
from tirgeo_ros.core.navigation.aiding.state_estimate import (
    AidMeasurement,
    Fused,
    Modelled,
    StateEstimate,
    added,
    floored,
    not_fixed,
)
from tirgeo_ros.core.navigation.ins.ins_error_model import ANTENNA, POSITION, has_antenna
from tirgeo_ros.core.navigation.ins.kalman import Change, Measurement, Update, cut, update
from tirgeo_ros.core.navigation.ins.strapdown import Vector, matrix, rotate
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: A step that is accepted counts as a reset from this size on. A smaller one, which ordinary GPS
#: cannot confirm, is accepted after this time: a receiver's passing fault lasts for a second.
_COUNTED_STEP_M = 1.0
_SMALL_STEP_S = 1.2


class RtkPositionAid(Aid):
    """Use positions of RTK from float on."""

    source = Source.RTK_POSITION
    delay = "rtk.delay_s"
    look_at = "aircraft.rtk_antenna_m, rtk.delay_s"
    moved = "position moved by"
    steps = True
    eased = True
    resets = POSITION

    def __init__(self, config: EkfConfig) -> None:
        super().__init__(config)
        self._rtk = config.rtk
        self._direct = config.position_update == "rtk_direct"
        self._lever_b: Vector = tuple(config.aircraft.rtk_lever_b.tolist())

    def measured(
        self, sample: PositionSample, estimate: StateEstimate, _rate_b: Vector
    ) -> Modelled:
        """Return the measurement; the estimate has its status, and its offset for the median."""
        state = estimate.state
        aids = estimate.aids.with_status(sample.status, sample.stamp_ns, self._timeout_ns)
        if sample.status < FixStatus.FLOAT:
            return not_fixed(self.source, sample.status), estimate._replace(aids=aids)
        rotation = rotation_of(state.q_nb)
        lever_n = rotate(rotation, added(self._lever_b, aids.receivers.antenna_b))
        innovation = innovation_n(state, sample, lever_n)
        offset = added(innovation, state.correction_n)
        if self._rtk.median_window > 1:
            innovation, aids = self._median(offset, state.correction_n, aids)
        noise, sigma_m = self._noise(sample, aids)
        consistency = aids.rtk.consistency.with_fix(sample, noise)
        aids = aids.changed(rtk=aids.rtk.compared(consistency))
        estimate = StateEstimate(state, estimate.covariance, aids)
        reason = consistency.reason(self.source)
        if reason:
            return Verdict(self.source, Outcome.GATED, reason), estimate
        gate_sigma = self._rtk.gate_sigma
        design = arm_design(self._states, lever_n, POSITION.start)
        if has_antenna(self._states):
            design[:, ANTENNA] = matrix(rotation)
        measurement = Measurement(np.array(innovation), design, noise, gate_sigma)
        slack = 1.5 * gate_sigma * sigma_m
        return AidMeasurement(
            sample.source, sample.stamp_ns, measurement, offset, state.correction_n, slack
        ), estimate

    def _median(
        self, offset: Vector, moved_n: Vector, aids: AidStatus
    ) -> tuple[Vector, AidStatus]:
        """Return the innovation of the median, NED m, and the records with the offset stored.

        A median of positions would lag behind an aircraft in motion. Offsets from the path that
        the IMU alone has taken show a jump as positions do, but not the motion.
        """
        offsets = (*aids.rtk.offsets_n, offset)[-self._rtk.median_window :]
        north, east, down = np.median(offsets, axis=0).tolist()
        innovation = north - moved_n[0], east - moved_n[1], down - moved_n[2]
        return innovation, aids._replace(rtk=aids.rtk._replace(offsets_n=offsets))

    def _noise(self, sample: PositionSample, aids: AidStatus) -> tuple[Array, float]:
        """Return R (3, 3), and the scatter (m) of one position against the next."""
        if sample.status is FixStatus.FIXED:
            noise = floored(sample.covariance_n, self._rtk.position_sigma_floor_m)
            return noise, math.sqrt(noise[0, 0] + noise[1, 1] + noise[2, 2])
        step_ns = sample.stamp_ns - aids.track(sample.source).used_ns
        noise = floored(sample.covariance_n, self._rtk.float_sigma_m)
        return noise * white_factor(self._rtk.float_time_s, step_ns), self._rtk.float_sigma_m

    def correction(
        self, measurement: Measurement, result: Update
    ) -> tuple[Array, tuple[Change, ...]]:
        """Return the error to correct by; with ``rtk_direct`` the position is that of RTK.

        The other states are filtered then: the cycle of Ren et al. 2022 (section 3.3).
        """
        error, changes = super().correction(measurement, result)
        if not self._direct:
            return error, changes
        error, covariance = error.copy(), changes[0].covariance.copy()
        error[POSITION] = measurement.innovation
        covariance[POSITION, :] = 0.0
        covariance[:, POSITION] = 0.0
        covariance[POSITION, POSITION] = measurement.noise
        return error, (*changes, Change(covariance, cut(len(error), POSITION)))

    def after_step(self, aid: AidMeasurement, estimate: StateEstimate, track: AidTrack) -> Fused:
        """Return the estimate after a position that has stepped: only its motion is used.

        The motion that a receiver reports stays right when its solution jumps. After a while
        without a step back the place becomes as uncertain as the step is large, and the next
        position decides; a large step resets the position instead, and is counted.
        """
        plain = aid.measurement
        ratio = update(estimate.covariance, plain).test_ratio
        track = self.refused(aid, track)
        off = aid.verdict(Outcome.GATED, self.off(aid, track), ratio)
        estimate = estimate._replace(aids=estimate.aids.with_track(aid.source, track))
        if (aid.stamp_ns - track.denied_ns) * 1e-9 >= self._step_patience_s(aid, estimate.aids):
            if math.hypot(*track.step) < _COUNTED_STEP_M:
                return Fused(off, self._loosened(estimate, track))
            estimate = self.reset(aid, estimate)
            reason = str(estimate.aids.last_reset)
            return Fused(aid.verdict(Outcome.RESET, reason, ratio), estimate)
        innovation = plain.innovation - np.array(track.step)
        motion = update(estimate.covariance, plain._replace(innovation=innovation))
        if motion.error is not None and motion.covariance is not None:
            change = Change(motion.covariance, correction=motion.correction)
            estimate = estimate.corrected(motion.error, (change,))
        return Fused(off, estimate)

    def _loosened(self, estimate: StateEstimate, track: AidTrack) -> StateEstimate:
        """Return the estimate that the next positions move gently to where they stepped."""
        covariance = estimate.covariance.copy()
        covariance[POSITION, POSITION] += np.outer(track.step, track.step)
        track = AidTrack(track.used_ns, track.agreed_ns, EASE_STEPS)
        aids = estimate.aids.with_track(self.source, track)
        return StateEstimate(estimate.state, covariance, aids, (Change(covariance),))

    def _step_patience_s(self, aid: AidMeasurement, aids: AidStatus) -> float:
        """Return how long a step must last: longer, or for ever, where ordinary GPS denies it."""
        patience_s, track = self._rtk.reset_after_s, aids.track(aid.source)
        gps, last = aids.track(Source.GPS_POSITION), aids.last_reset
        if math.hypot(*track.step) < _COUNTED_STEP_M:
            return min(patience_s, _SMALL_STEP_S)  # too small for GPS to confirm
        if not gps.recent(aid.stamp_ns, self._timeout_ns):
            return patience_s
        if last and last.source is Source.GPS_POSITION and last.stamp_ns > track.denied_ns:
            return patience_s  # it has contradicted the state too
        sigmas = np.array(track.step) / np.array(self._config.gps.position_sigma_m)
        if np.linalg.norm(sigmas) > self._config.gps.gate_sigma:
            return math.inf
        return max(STEPPED_S, patience_s)

    def reset(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate:
        """Set the position; the ordinary GPS stays, so its error against the position changes."""
        after = super().reset(aid, estimate)
        assert after is not None
        moved = (-aid.measurement.innovation).tolist()
        receivers = after.aids.receivers.changed(moved)
        return after._replace(aids=after.aids._replace(receivers=receivers))
