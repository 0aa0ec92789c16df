"""Satellite position of an antenna (Eq. 4, with the lever arm's partials in attitude)."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.attitude import skew
from tirgeo_ros.core.error_state import ATTITUDE, POSITION, STATES
from tirgeo_ros.core.geodesy import radii_of_curvature
from tirgeo_ros.core.kalman import Measurement
from tirgeo_ros.core.samples import Array, PositionSample
from tirgeo_ros.core.strapdown import NavState, matrix, rotation_of


def separation_n(state: NavState, sample: PositionSample) -> Array:
    """(3,) antenna as measured minus IMU as estimated, NED metres (Eq. 5)."""
    meridian, transverse = radii_of_curvature(state.latitude_rad)
    east = (sample.longitude_rad - state.longitude_rad + math.pi) % (2 * math.pi) - math.pi
    middle = 0.5 * (sample.latitude_rad + state.latitude_rad)
    return np.array(
        [
            (sample.latitude_rad - state.latitude_rad) * (meridian + state.height_m),
            east * (transverse + state.height_m) * math.cos(middle),
            state.height_m - sample.height_m,
        ]
    )


def innovation_n(state: NavState, sample: PositionSample, lever_arm_b: Array) -> Array:
    """(3,) measured minus predicted antenna position, NED metres."""
    return separation_n(state, sample) - matrix(rotation_of(state.q_nb)) @ lever_arm_b


def position_measurement(
    state: NavState, innovation: Array, covariance_n: Array, lever_arm_b: Array, gate_sigma: float
) -> Measurement:
    """The measurement that an antenna position is: ``R_true l = R l - [R l x] phi``."""
    design = np.zeros((3, STATES))
    design[:, POSITION] = np.eye(3)
    design[:, ATTITUDE] = -skew(matrix(rotation_of(state.q_nb)) @ lever_arm_b)
    return Measurement(innovation, design, covariance_n, gate_sigma)
