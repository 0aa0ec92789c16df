"""The 15 error states, their dynamics and their feedback.

All states are truth minus estimate, vectors in ``n`` (biases in ``b``):

====  =========================  =====
0-2   attitude ``phi_n``         rad
3-5   velocity                   m/s
6-8   position north, east, down m
9-11  gyroscope bias             rad/s
12-14 accelerometer bias         m/s2
====  =========================  =====

With ``R_nb_true = exp([phi x]) R_nb``, differentiating the equations of ``strapdown`` gives the
matrix below; it is Groves, 2nd ed., section 14.2.4, in metres and with the opposite sign of error.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import ImuConfig
from tirgeo_ros.core.geodesy import EARTH_RATE_RAD_S, gravity_down, radii_of_curvature
from tirgeo_ros.core.samples import Array
from tirgeo_ros.core.strapdown import NavState, Rates, matrix, multiply, normalised, quaternion_of

STATES = 15
ATTITUDE = slice(0, 3)
VELOCITY = slice(3, 6)
POSITION = slice(6, 9)
GYRO_BIAS = slice(9, 12)
ACCEL_BIAS = slice(12, 15)


def dynamics(state: NavState, rates: Rates, imu: ImuConfig) -> Array:
    """``F`` (15, 15), 1/s: the time derivative of the error states is ``F`` times them."""
    f = np.zeros((STATES, STATES))
    rotation = matrix(rates.rotation_nb)
    _fill_skew(f, 0, 0, rates.earth_rate_n, rates.transport_rate_n, -1.0)
    f[ATTITUDE, GYRO_BIAS] = -rotation
    _fill_transport(f, state, rates)
    _fill_skew(f, 3, 0, rates.specific_force_n, (0.0, 0.0, 0.0), -1.0)
    _fill_velocity(f, state, rates)
    f[VELOCITY, ACCEL_BIAS] = -rotation
    _fill_position(f, state, rates)
    for axis in range(3):
        f[9 + axis, 9 + axis] = -1 / imu.gyro_bias_time_s[axis]
        f[12 + axis, 12 + axis] = -1 / imu.accel_bias_time_s[axis]
    return f


def _fill_skew(
    f: Array,
    row: int,
    column: int,
    a: tuple[float, float, float],
    b: tuple[float, float, float],
    sign: float,
) -> None:
    x, y, z = sign * (a[0] + b[0]), sign * (a[1] + b[1]), sign * (a[2] + b[2])
    f[row, column + 1], f[row, column + 2] = -z, y
    f[row + 1, column], f[row + 1, column + 2] = z, -x
    f[row + 2, column], f[row + 2, column + 1] = -y, x


def _frame_rate_partials(state: NavState, rates: Rates) -> tuple[Array, Array, Array]:
    """(3, 3) each: transport rate by velocity, transport and earth rate by position (metres)."""
    north, east, _ = state.velocity_n
    meridian, transverse = rates.meridian_m, rates.transverse_m
    tangent, cosine = math.tan(state.latitude_rad), math.cos(state.latitude_rad)
    by_velocity = np.zeros((3, 3))
    by_velocity[0, 1] = 1 / transverse
    by_velocity[1, 0] = -1 / meridian
    by_velocity[2, 1] = -tangent / transverse
    by_position = np.zeros((3, 3))
    by_position[0, 2] = east / transverse**2  # height is minus down
    by_position[1, 2] = -north / meridian**2
    by_position[2, 2] = -east * tangent / transverse**2
    by_position[2, 0] = -east / (transverse * meridian * cosine**2)
    earth = np.zeros((3, 3))
    earth[0, 0] = -EARTH_RATE_RAD_S * math.sin(state.latitude_rad) / meridian
    earth[2, 0] = -EARTH_RATE_RAD_S * cosine / meridian
    return by_velocity, by_position, earth


def _fill_transport(f: Array, state: NavState, rates: Rates) -> None:
    by_velocity, by_position, earth = _frame_rate_partials(state, rates)
    f[ATTITUDE, VELOCITY] = -by_velocity
    f[ATTITUDE, POSITION] = -(by_position + earth)
    north, east, down = state.velocity_n
    v = np.array([[0.0, -down, east], [down, 0.0, -north], [-east, north, 0.0]])
    # -(d omega) x v = [v x] d omega
    f[VELOCITY, VELOCITY] = v @ by_velocity
    f[VELOCITY, POSITION] = v @ (by_position + 2 * earth)


def _fill_velocity(f: Array, state: NavState, rates: Rates) -> None:
    e, t = rates.earth_rate_n, rates.transport_rate_n
    coriolis = np.zeros((3, 3))
    _fill_skew(coriolis, 0, 0, (2 * e[0], 2 * e[1], 2 * e[2]), t, -1.0)
    f[VELOCITY, VELOCITY] += coriolis
    meridian, transverse = radii_of_curvature(state.latitude_rad)
    gravity = gravity_down(state.latitude_rad, state.height_m)
    f[5, 8] += 2 * gravity / math.sqrt(meridian * transverse)


def _fill_position(f: Array, state: NavState, rates: Rates) -> None:
    north, east, down = state.velocity_n
    tangent = math.tan(state.latitude_rad)
    f[6, 3] = f[7, 4] = f[8, 5] = 1.0
    f[6, 6] = -down / rates.meridian_m
    f[6, 8] = north / rates.meridian_m
    f[7, 6] = east * tangent / rates.meridian_m
    f[7, 7] = -down / rates.transverse_m - north * tangent / rates.meridian_m
    f[7, 8] = east / rates.transverse_m


def noise_density(imu: ImuConfig) -> Array:
    """(15,) power densities of the driving noise, per axis in ``b``.

    Attitude and velocity: squared random walks. A Gauss-Markov bias of standard deviation ``s``
    and correlation time ``tau`` is driven by ``s sqrt(2 / tau)``.
    """
    gyro = np.array(imu.gyro_bias_instability) ** 2 * 2 / np.array(imu.gyro_bias_time_s)
    accel = np.array(imu.accel_bias_instability) ** 2 * 2 / np.array(imu.accel_bias_time_s)
    walks = [np.array(imu.angle_random_walk) ** 2, np.array(imu.velocity_random_walk) ** 2]
    return np.concatenate([*walks, np.zeros(3), gyro, accel])


def propagate_covariance(
    covariance: Array, state: NavState, rates: Rates, step_s: float, imu: ImuConfig, density: Array
) -> Array:
    """(15, 15) covariance after a step: second-order transition, noise turned to ``n``."""
    a = dynamics(state, rates, imu) * step_s
    transition = a + 0.5 * (a @ a)
    transition[np.arange(STATES), np.arange(STATES)] += 1.0
    out = transition @ covariance @ transition.T
    rotation = matrix(rates.rotation_nb)
    out[ATTITUDE, ATTITUDE] += (rotation * (density[:3] * step_s)) @ rotation.T
    out[VELOCITY, VELOCITY] += (rotation * (density[3:6] * step_s)) @ rotation.T
    out[np.arange(9, 15), np.arange(9, 15)] += density[9:] * step_s
    return np.asarray(0.5 * (out + out.T))


def feedback(state: NavState, error: Array) -> NavState:
    """The state with an estimated error (15,) put into it; biases accumulate."""
    e = error.tolist()
    meridian, transverse = radii_of_curvature(state.latitude_rad)
    north, east, down = e[6:9]
    latitude = state.latitude_rad + north / (meridian + state.height_m)
    cosine = math.cos(state.latitude_rad)
    v, c = state.velocity_n, state.correction_n
    g, a = state.gyro_bias_b, state.accel_bias_b
    return NavState(
        normalised(multiply(quaternion_of(*e[0:3]), state.q_nb)),
        (v[0] + e[3], v[1] + e[4], v[2] + e[5]),
        latitude,
        state.longitude_rad + east / ((transverse + state.height_m) * cosine),
        state.height_m - down,
        (g[0] + e[9], g[1] + e[10], g[2] + e[11]),
        (a[0] + e[12], a[1] + e[13], a[2] + e[14]),
        (c[0] + north, c[1] + east, c[2] + down),
    )
