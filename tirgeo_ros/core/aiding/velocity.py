"""Satellite velocity of an antenna."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.attitude import skew
from tirgeo_ros.core.error_state import ATTITUDE, GYRO_BIAS, STATES, VELOCITY
from tirgeo_ros.core.kalman import Measurement
from tirgeo_ros.core.samples import Array
from tirgeo_ros.core.strapdown import NavState, matrix, rotation_of


def velocity_measurement(
    state: NavState,
    measured_n: Array,
    covariance_n: Array,
    angular_rate_b: Array,
    lever_arm_b: Array,
    gate_sigma: float,
) -> Measurement:
    """The measurement that an antenna velocity is: the lever arm swings with the body's rate.

    The rate is the reading less its bias, so ``d(w x l) = -db x l = [l x] db``.
    """
    rotation = matrix(rotation_of(state.q_nb))
    swing_n = rotation @ np.cross(angular_rate_b, lever_arm_b)
    design = np.zeros((3, STATES))
    design[:, VELOCITY] = np.eye(3)
    design[:, ATTITUDE] = -skew(swing_n)
    design[:, GYRO_BIAS] = rotation @ skew(lever_arm_b)
    innovation = measured_n - np.array(state.velocity_n) - swing_n
    return Measurement(innovation, design, covariance_n, gate_sigma)
