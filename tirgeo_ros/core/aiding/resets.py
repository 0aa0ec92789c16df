"""A state that measurements contradict for long is set to them, and that is counted.

Only measurements that agree with each other count: one position that jumps is forgotten, a
receiver that is frozen while the aircraft moves never agrees with itself.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.aiding.belief import Aid, Belief
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.error_state import (
    ACCEL_BIAS,
    ATTITUDE,
    GPS_ERROR,
    GYRO_BIAS,
    HEADING_ERROR,
    POSITION,
    VELOCITY,
    feedback,
)
from tirgeo_ros.core.samples import Array, Source

#: A heading that has been agreed with for long is given up after a minute of contradiction.
_LONGEST_S = 60.0
_SMALL_LONGEST_S = 10.0
#: A turn by more comes of a wrong start, which has spoiled what was estimated with it.
_LARGE_TURN_RAD = math.radians(5.0)
_TILT_SIGMA_RAD = math.radians(1.0)


class Resets:
    """Sets the state where the parameters say so."""

    def __init__(self, config: EkfConfig) -> None:
        self._config = config
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)

    def after_refusal(self, aid: Aid, belief: Belief) -> Belief | None:
        """The belief set to the measurement, where its run of refusals is long enough."""
        run = belief.control.track(aid.source).run
        if run is None or not run.lasts(self._patience_s(aid, belief)):
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

    def _patience_s(self, aid: Aid, belief: Belief) -> float:
        """For how long a run must have lasted."""
        if aid.stale:  # a receiver that is frozen over a hover, more likely than not
            return _LONGEST_S
        rtk, heading, control = self._config.rtk, self._config.heading, belief.control
        if aid.source is Source.RTK_HEADING:
            # The longer the two have agreed, the less one contradiction says against the state.
            track = control.track(aid.source)
            agreed_s = track.agreed_ns * 1e-9
            measurement = aid.measurement
            # Off by less than one heading's gate, it may as well be the gyroscopes.
            gate_rad = measurement.gate_sigma * math.sqrt(measurement.noise[0, 0])
            small = abs(measurement.innovation[0]) < gate_rad
            longest_s = _SMALL_LONGEST_S if small else _LONGEST_S
            return max(heading.reset_after_s, min(agreed_s, longest_s))
        position = control.track(Source.RTK_POSITION)
        if aid.source is not Source.RTK_POSITION and position.recent(
            aid.stamp_ns, self._timeout_ns
        ):
            # Positions that fit say that the velocity does too.
            return rtk.reset_after_s if aid.source is Source.GPS_POSITION else math.inf
        return rtk.reset_after_s

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
        if abs(turn) > _LARGE_TURN_RAD:
            covariance = self._spoiled(covariance)
            b, a = state.gyro_bias_b, state.accel_bias_b
            error[GYRO_BIAS], error[ACCEL_BIAS] = np.negative(b), np.negative(a)
        covariance = _untied(covariance, slice(2, 3))
        covariance[2, 2] = aid.measurement.noise[0, 0]
        if len(covariance) > HEADING_ERROR:  # the heading and its error together are as measured
            covariance[2, :] -= covariance[HEADING_ERROR, :]
            covariance[:, 2] -= covariance[:, HEADING_ERROR]
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


def _untied(covariance: Array, block: slice) -> Array:
    """A copy with the block's variances and its covariances with all other states zero."""
    covariance = covariance.copy()
    covariance[block, :] = 0.0
    covariance[:, block] = 0.0
    return covariance
