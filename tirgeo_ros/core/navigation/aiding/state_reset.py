"""Reset the state to measurements that have contradicted it for long, and count the resets.

Only measurements that agree with each other count. One position that jumps is forgotten; a
receiver that is frozen while the aircraft moves never agrees with itself.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.navigation.aiding.aid_status import EASE_STEPS, STEPPED_S, AidStatus, AidTrack
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import LARGE_TURN_RAD
from tirgeo_ros.core.navigation.aiding.state_estimate import AidMeasurement, StateEstimate
from tirgeo_ros.core.navigation.ins.ins_error_model import (
    ACCEL_BIAS,
    ATTITUDE,
    GPS_ERROR,
    GYRO_BIAS,
    POSITION,
    feedback,
    heading_error,
)
from tirgeo_ros.core.navigation.ins.strapdown import NavState
from tirgeo_ros.core.navigation.ins.trail import Change, cut
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import Source

#: Longest contradiction that a heading needs, however long it agreed before; the second is for a
#: turn below one heading's gate. The first also applies to values that repeat.
_LONGEST_S = 60.0
_SMALL_LONGEST_S = 10.0
#: A step that is accepted counts as a reset from this size on. A smaller one, which ordinary GPS
#: cannot confirm, is accepted after this time: a receiver's passing fault lasts for a second.
_COUNTED_STEP_M = 1.0
_SMALL_STEP_S = 1.2
#: A larger turn follows a wrong initial heading, which has spoiled tilt and biases as well.
_SPOILING_TURN_RAD = math.radians(5.0)
_TILT_SIGMA_RAD = math.radians(1.0)


class Resets:
    """Reset the state after the times that the parameters give."""

    def __init__(self, config: EkfConfig) -> None:
        self._config = config
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)

    def after_refusal(
        self,
        aid: AidMeasurement,
        estimate: StateEstimate,
        block: slice | None,
        autopilot_q_nb: Array | None,
    ) -> StateEstimate | None:
        """Return the estimate set to it; None if that is too soon."""
        run = estimate.aids.track(aid.source).run
        if run is None or not run.lasts(self._patience_s(aid, estimate, autopilot_q_nb)):
            return None
        if aid.source is Source.RTK_HEADING:
            return self._with_heading(aid, estimate)
        return None if block is None else self._with_block(aid, estimate, block)

    def _patience_s(
        self, aid: AidMeasurement, estimate: StateEstimate, autopilot_q_nb: Array | None
    ) -> float:
        """Return how long a run of refusals must last; infinite if it must not cause a reset."""
        aids = estimate.aids
        track = aids.track(aid.source)
        if aid.stale:  # most likely a receiver that is frozen in a hover
            return _LONGEST_S
        if aid.source is Source.RTK_HEADING:
            return self._heading_patience_s(aid, estimate, autopilot_q_nb)
        reset_after_s = self._config.rtk.reset_after_s
        if aid.source is Source.GPS_POSITION:
            return reset_after_s
        fits = aids.track(Source.RTK_POSITION).recent(aid.stamp_ns, self._timeout_ns)
        if aid.source is not Source.RTK_POSITION and fits:
            return math.inf  # positions that fit confirm the velocity
        return max(STEPPED_S, reset_after_s) if track.step else reset_after_s

    def after_step(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate | None:
        """Return the estimate once RTK's position has stayed long where it stepped to, else None.

        After a small step the position becomes as uncertain as the step is large, and the next
        ones move it gently. After a large one it is reset, and counted.
        """
        state, covariance, aids = estimate[:3]
        track = aids.track(aid.source)
        if (aid.stamp_ns - track.denied_ns) * 1e-9 < self._step_patience_s(aid, aids):
            return None
        if math.hypot(*track.step) >= _COUNTED_STEP_M:
            return self._with_block(aid, estimate, POSITION)
        covariance = covariance.copy()
        covariance[POSITION, POSITION] += np.outer(track.step, track.step)
        track = AidTrack(track.used_ns, track.agreed_ns, EASE_STEPS)
        aids = aids.with_track(aid.source, track)
        return StateEstimate(state, covariance, aids, (Change(covariance),))

    def _step_patience_s(self, aid: AidMeasurement, aids: AidStatus) -> float:
        """Return how long a step must last: longer, or for ever, where ordinary GPS denies it."""
        patience_s, track = self._config.rtk.reset_after_s, aids.track(aid.source)
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

    def _heading_patience_s(
        self, aid: AidMeasurement, estimate: StateEstimate, autopilot_q_nb: Array | None
    ) -> float:
        """Return how long a run must last; infinite for a turn that the autopilot has not seen."""
        heading, track = self._config.heading, estimate.aids.track(aid.source)
        measurement, turn = aid.measurement, float(aid.measurement.innovation[0])
        if track.step or (not track.agreed_ns and abs(turn) > LARGE_TURN_RAD):
            supported = _supported(turn, estimate.state, autopilot_q_nb)
            return heading.reset_after_s if supported else math.inf
        # The longer the two have agreed, the less one contradiction says against the state. Where
        # it is below one heading's gate, the gyroscopes may as well be the cause.
        gate_rad = measurement.gate_sigma * math.sqrt(measurement.noise[0, 0])
        longest_s = _SMALL_LONGEST_S if abs(turn) < gate_rad else _LONGEST_S
        return max(heading.reset_after_s, min(track.agreed_ns * 1e-9, longest_s))

    def _with_block(
        self, aid: AidMeasurement, estimate: StateEstimate, block: slice
    ) -> StateEstimate:
        """Set three states and their covariance as measured, uncorrelated with the others."""
        state, covariance, aids = estimate[:3]
        innovation, noise = aid.measurement.innovation, aid.measurement.noise
        covariance, transition = _uncorrelated(covariance, block), cut(len(covariance), block)
        error = np.zeros(len(covariance))
        error[block] = innovation
        covariance[block, block] = noise
        if block is GPS_ERROR:
            # Their sum is measured: the error of the one is that of the other, negated.
            covariance[block, :] -= covariance[POSITION, :]
            covariance[:, block] -= covariance[:, POSITION]
            transition[block, POSITION] = -np.eye(3)
            aids = aids._replace(receivers=aids.receivers.changed(innovation.tolist()))
        else:
            state = feedback(state, error)
        if block is POSITION:
            # The ordinary GPS has not moved, but its error against the new position has changed.
            aids = aids._replace(receivers=aids.receivers.changed((-innovation).tolist()))
        size = float(np.linalg.norm(innovation))
        aids = aids.with_reset(aid.source, aid.stamp_ns, size)
        return StateEstimate(state, covariance, aids, (Change(covariance, transition),))

    def _with_heading(self, aid: AidMeasurement, estimate: StateEstimate) -> StateEstimate:
        """Turn the attitude about the vertical to the heading."""
        state, covariance, aids = estimate[:3]
        turn = float(aid.measurement.innovation[0])
        error = np.zeros(len(covariance))
        error[2], lost = turn, [slice(2, 3)]
        if abs(turn) > _SPOILING_TURN_RAD:
            covariance = self._as_at_start(covariance)
            b, a = state.gyro_bias_b, state.accel_bias_b
            error[GYRO_BIAS], error[ACCEL_BIAS] = np.negative(b), np.negative(a)
            lost += [ATTITUDE, GYRO_BIAS, ACCEL_BIAS]
        covariance, transition = _uncorrelated(covariance, lost[0]), cut(len(covariance), *lost)
        covariance[2, 2] = aid.measurement.noise[0, 0]
        at = heading_error(len(covariance))
        if at is not None:  # their sum is measured: correlate heading and heading error
            covariance[2, :] -= covariance[at, :]
            covariance[:, 2] -= covariance[:, at]
            transition[2, at] = -1.0
        aids = aids.with_reset(aid.source, aid.stamp_ns, turn)
        changes = (Change(covariance, transition),)
        return StateEstimate(feedback(state, error), covariance, aids, changes)

    def _as_at_start(self, covariance: Array) -> Array:
        """Return a covariance with tilt and biases as uncertain as at the start."""
        imu = self._config.imu
        for block, variances in (
            (ATTITUDE, np.full(3, _TILT_SIGMA_RAD**2)),
            (GYRO_BIAS, imu.gyro_turn_on_bias**2 + np.square(imu.gyro_bias_instability)),
            (ACCEL_BIAS, imu.accel_turn_on_bias**2 + np.square(imu.accel_bias_instability)),
        ):
            covariance = _uncorrelated(covariance, block)
            covariance[block, block] = np.diag(variances)
        return covariance


def _supported(turn_rad: float, state: NavState, autopilot_q_nb: Array | None) -> bool:
    """Return whether the autopilot's heading is nearer to the antennas' than to the state's."""
    if abs(turn_rad) < LARGE_TURN_RAD or not usable_attitude(autopilot_q_nb):
        return False
    assert autopilot_q_nb is not None
    yaw = euler_from_quat(np.array([state.q_nb, autopilot_q_nb]))[:, 2]
    apart = math.remainder(float(yaw[1] - yaw[0]), 2 * math.pi)
    return abs(math.remainder(apart - turn_rad, 2 * math.pi)) < 0.5 * abs(turn_rad)


def _uncorrelated(covariance: Array, block: slice) -> Array:
    """Return a copy with all variances and covariances of the block's states set to zero."""
    covariance = covariance.copy()
    covariance[block, :] = 0.0
    covariance[:, block] = 0.0
    return covariance
