"""A state that measurements contradict for long is set to them, and that is counted.

Only measurements that agree with each other count: one position that jumps is forgotten, a
receiver that is frozen while the aircraft moves never agrees with itself.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.navigation.aiding.aid_status import EASE_STEPS, STEPPED_S, Control, Track
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import LARGE_TURN_RAD
from tirgeo_ros.core.navigation.aiding.filter_state import Aid, Belief
from tirgeo_ros.core.navigation.ins_error_model import (
    ACCEL_BIAS,
    ATTITUDE,
    GPS_ERROR,
    GYRO_BIAS,
    POSITION,
    VELOCITY,
    feedback,
    heading_error,
)
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import Source

#: A heading that has been agreed with for long is given up after a minute of contradiction.
_LONGEST_S = 60.0
_SMALL_LONGEST_S = 10.0
#: A step that is believed counts as a reset from here on; a smaller one, of which ordinary GPS
#: cannot tell, is believed after so long: a receiver's passing fault lasts for a second.
_COUNTED_STEP_M = 1.0
_SMALL_STEP_S = 1.2
#: A turn by more comes of a wrong start, which has spoiled what was estimated with it.
_SPOILING_TURN_RAD = math.radians(5.0)
_TILT_SIGMA_RAD = math.radians(1.0)


class Resets:
    """Sets the state where the parameters say so."""

    def __init__(self, config: EkfConfig) -> None:
        self._config = config
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)

    def after_refusal(
        self, aid: Aid, belief: Belief, autopilot_q_nb: Array | None
    ) -> Belief | None:
        """The belief set to the measurement, where its run of refusals is long enough."""
        track = belief.control.track(aid.source)
        run = track.run
        if run is None or not run.lasts(self._patience_s(aid, belief, autopilot_q_nb)):
            return None
        if aid.source is Source.RTK_HEADING:
            return self._turned(aid, belief)
        block = {
            Source.RTK_POSITION: POSITION,
            Source.RTK_VELOCITY: VELOCITY,
            Source.GPS_POSITION: GPS_ERROR,  # the state is not changed by a jump of that
            Source.GPS_VELOCITY: VELOCITY,
        }[aid.source]
        return self._set(aid, belief, block)

    def _patience_s(self, aid: Aid, belief: Belief, autopilot_q_nb: Array | None) -> float:
        """For how long a run must have lasted; infinite where nothing else supports it."""
        control = belief.control
        track = control.track(aid.source)
        if aid.stale:  # a receiver that is frozen over a hover, more likely than not
            return _LONGEST_S
        if aid.source is Source.RTK_HEADING:
            return self._heading_patience_s(aid, belief, autopilot_q_nb)
        reset_after_s = self._config.rtk.reset_after_s
        if aid.source is Source.GPS_POSITION:
            return reset_after_s
        position = control.track(Source.RTK_POSITION)
        if aid.source is not Source.RTK_POSITION and position.recent(
            aid.stamp_ns, self._timeout_ns
        ):
            return math.inf  # positions that fit say that the velocity does too
        return max(STEPPED_S, reset_after_s) if track.step else reset_after_s

    def after_step(self, aid: Aid, belief: Belief) -> Belief | None:
        """The belief where RTK's position has been for long where it stepped to, or None yet.

        After a small step the position is as uncertain as the step is large, and the next ones
        move it gently; after a large one it is set, and counted.
        """
        state, covariance, control = belief
        track = control.track(aid.source)
        if (aid.stamp_ns - track.denied_ns) * 1e-9 < self._step_patience_s(aid, control):
            return None
        if math.hypot(*track.step) >= _COUNTED_STEP_M:
            return self._set(aid, belief, POSITION)
        covariance = covariance.copy()
        covariance[POSITION, POSITION] += np.outer(track.step, track.step)
        track = Track(track.used_ns, track.agreed_ns, EASE_STEPS)
        return Belief(state, covariance, control.with_track(aid.source, track))

    def _step_patience_s(self, aid: Aid, control: Control) -> float:
        """Longer where ordinary GPS goes on as before, endless where it cannot err by the step."""
        patience_s, track = self._config.rtk.reset_after_s, control.track(aid.source)
        gps, last = control.track(Source.GPS_POSITION), control.last_reset
        if math.hypot(*track.step) < _COUNTED_STEP_M:
            return min(patience_s, _SMALL_STEP_S)  # GPS cannot tell
        if not gps.recent(aid.stamp_ns, self._timeout_ns):
            return patience_s
        if (
            last is not None
            and last.source is Source.GPS_POSITION
            and last.stamp_ns > track.denied_ns
        ):
            return patience_s  # it has contradicted the state too
        sigmas = np.array(track.step) / np.array(self._config.gps.position_sigma_m)
        if np.linalg.norm(sigmas) > self._config.gps.gate_sigma:
            return math.inf
        return max(STEPPED_S, patience_s)

    def _heading_patience_s(self, aid: Aid, belief: Belief, autopilot_q_nb: Array | None) -> float:
        """A step is the antennas' unless the autopilot has seen it too."""
        heading, track = self._config.heading, belief.control.track(aid.source)
        measurement, turn = aid.measurement, float(aid.measurement.innovation[0])
        if track.step or (not track.agreed_ns and abs(turn) > LARGE_TURN_RAD):
            supported = _supported(turn, belief.state, autopilot_q_nb)
            return heading.reset_after_s if supported else math.inf
        # The longer the two have agreed, the less one contradiction says against the state. Off by
        # less than one heading's gate, it may as well be the gyroscopes.
        gate_rad = measurement.gate_sigma * math.sqrt(measurement.noise[0, 0])
        longest_s = _SMALL_LONGEST_S if abs(turn) < gate_rad else _LONGEST_S
        return max(heading.reset_after_s, min(track.agreed_ns * 1e-9, longest_s))

    def _set(self, aid: Aid, belief: Belief, block: slice) -> Belief:
        """Three states and their covariance as measured, without ties to the others."""
        state, covariance, control = belief
        innovation, noise = aid.measurement.innovation, aid.measurement.noise
        covariance = _untied(covariance, block)
        error = np.zeros(len(covariance))
        error[block] = innovation
        covariance[block, block] = noise
        if block is GPS_ERROR:
            # Position and error together are as measured: what one is off, the other is, negated.
            covariance[block, :] -= covariance[POSITION, :]
            covariance[:, block] -= covariance[:, POSITION]
            control = control._replace(receivers=control.receivers.changed(innovation.tolist()))
        else:
            state = feedback(state, error)
        if block is POSITION:
            # The ordinary GPS has not moved: its error against the new position has.
            control = control._replace(receivers=control.receivers.changed((-innovation).tolist()))
        size = float(np.linalg.norm(innovation))
        return Belief(state, covariance, control.with_reset(aid.source, aid.stamp_ns, size))

    def _turned(self, aid: Aid, belief: Belief) -> Belief:
        """The attitude turned about the vertical to the heading."""
        state, covariance, control = belief
        turn = float(aid.measurement.innovation[0])
        error = np.zeros(len(covariance))
        error[2] = turn
        if abs(turn) > _SPOILING_TURN_RAD:
            covariance = self._spoiled(covariance)
            b, a = state.gyro_bias_b, state.accel_bias_b
            error[GYRO_BIAS], error[ACCEL_BIAS] = np.negative(b), np.negative(a)
        covariance = _untied(covariance, slice(2, 3))
        covariance[2, 2] = aid.measurement.noise[0, 0]
        at = heading_error(len(covariance))
        if at is not None:  # the heading and its error together are as measured
            covariance[2, :] -= covariance[at, :]
            covariance[:, 2] -= covariance[:, at]
        control = control.with_reset(aid.source, aid.stamp_ns, turn)
        return Belief(feedback(state, error), covariance, control)

    def _spoiled(self, covariance: Array) -> Array:
        """Tilt and biases as uncertain as at the start."""
        imu = self._config.imu
        for block in (ATTITUDE, GYRO_BIAS, ACCEL_BIAS):
            covariance = _untied(covariance, block)
        variances = np.diagonal(covariance).copy()
        variances[ATTITUDE] = _TILT_SIGMA_RAD**2
        variances[GYRO_BIAS] = imu.gyro_turn_on_bias**2 + np.square(imu.gyro_bias_instability)
        variances[ACCEL_BIAS] = imu.accel_turn_on_bias**2 + np.square(imu.accel_bias_instability)
        np.fill_diagonal(covariance, variances)
        return covariance


def _supported(turn_rad: float, state: NavState, autopilot_q_nb: Array | None) -> bool:
    """Whether the autopilot's nose is nearer to that of the headings than to the state's."""
    if abs(turn_rad) < LARGE_TURN_RAD or not usable_attitude(autopilot_q_nb):
        return False
    assert autopilot_q_nb is not None
    yaw = euler_from_quat(np.array([state.q_nb, autopilot_q_nb]))[:, 2]
    apart = math.remainder(float(yaw[1] - yaw[0]), 2 * math.pi)
    return abs(math.remainder(apart - turn_rad, 2 * math.pi)) < 0.5 * abs(turn_rad)


def _untied(covariance: Array, block: slice) -> Array:
    """A copy with the block's variances and its covariances with all other states zero."""
    covariance = covariance.copy()
    covariance[block, :] = 0.0
    covariance[:, block] = 0.0
    return covariance
