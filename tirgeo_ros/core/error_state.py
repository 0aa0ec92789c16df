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
from typing import cast

import numpy as np

from tirgeo_ros.core.config import ImuConfig
from tirgeo_ros.core.geodesy import gravity_down, radii_of_curvature
from tirgeo_ros.core.samples import Array
from tirgeo_ros.core.strapdown import (
    NavState,
    Rates,
    Rotation,
    multiply,
    normalised,
    quaternion_of,
)

STATES = 15
ATTITUDE = slice(0, 3)
VELOCITY = slice(3, 6)
POSITION = slice(6, 9)
GYRO_BIAS = slice(9, 12)
ACCEL_BIAS = slice(12, 15)
_IDENTITY = np.eye(STATES)


def dynamics(state: NavState, rates: Rates, imu: ImuConfig) -> Array:
    """``F`` (15, 15), 1/s: the time derivative of the error states is ``F`` times them."""
    f = np.zeros((STATES, STATES))
    _write_decay(f, imu)
    _write_dynamics(_flat(f), state, rates)
    return f


def _flat(square: Array) -> memoryview[float]:
    """The memory of a matrix, row after row: takes scalars at a tenth of an array block's cost."""
    return cast("memoryview[float]", square.reshape(-1).data)


def _write_decay(f: Array, imu: ImuConfig) -> None:
    """The part of ``F`` that never changes: the biases' decay."""
    times_s = np.array([*imu.gyro_bias_time_s, *imu.accel_bias_time_s])
    f[range(9, STATES), range(9, STATES)] = -1 / times_s


def _write_dynamics(f: memoryview[float], state: NavState, rates: Rates) -> None:
    """The part of ``F`` that changes, row after row into its flat memory.

    Index ``15 i + j`` is row i, column j.
    """
    _write_rotation(f, rates.rotation_nb)
    _write_attitude(f, state, rates)
    _write_velocity(f, state, rates)
    _write_position(f, state, rates)


def _write_rotation(f: memoryview[float], r: Rotation) -> None:
    """-R_nb: gyroscope bias into attitude, accelerometer bias into velocity."""
    f[9], f[10], f[11] = f[57], f[58], f[59] = -r[0], -r[1], -r[2]
    f[24], f[25], f[26] = f[72], f[73], f[74] = -r[3], -r[4], -r[5]
    f[39], f[40], f[41] = f[87], f[88], f[89] = -r[6], -r[7], -r[8]


def _write_attitude(f: memoryview[float], state: NavState, rates: Rates) -> None:
    """-[w_in x] on attitude; minus the frame's rate by velocity and by position."""
    north, east, _ = state.velocity_n
    meridian, transverse = rates.meridian_m, rates.transverse_m
    earth, transport = rates.earth_rate_n, rates.transport_rate_n
    x, y, z = earth[0] + transport[0], transport[1], earth[2] + transport[2]
    f[1], f[2] = z, -y
    f[15], f[17] = -z, x
    f[30], f[31] = y, -x
    tangent, square = _tangent(state)
    f[4], f[18], f[34] = -1 / transverse, 1 / meridian, tangent / transverse
    f[8] = -east / transverse**2
    f[23] = north / meridian**2
    f[38] = east * tangent / transverse**2
    f[6] = -earth[2] / meridian
    f[36] = east * square / (transverse * meridian) + earth[0] / meridian


def _write_velocity(f: memoryview[float], state: NavState, rates: Rates) -> None:
    """-[f x] on attitude, Coriolis and transport terms, gravity's gradient in height."""
    fx, fy, fz = rates.specific_force_n
    f[46], f[47] = fz, -fy
    f[60], f[62] = -fz, fx
    f[75], f[76] = fy, -fx
    north, east, down = state.velocity_n
    meridian, transverse = rates.meridian_m, rates.transverse_m
    earth, transport = rates.earth_rate_n, rates.transport_rate_n
    x, y, z = 2 * earth[0] + transport[0], transport[1], 2 * earth[2] + transport[2]
    tangent, square = _tangent(state)
    f[48], f[49], f[50] = down / meridian, z - east * tangent / transverse, -y
    f[63], f[64], f[65] = -z, (down + north * tangent) / transverse, x
    f[78], f[79] = y - north / meridian, -x - east / transverse
    # [v x] times the frame rates' partials by position
    nx = 2 * earth[2] / meridian
    nz = -(east * square / transverse + 2 * earth[0]) / meridian
    f[51], f[66], f[81] = east * nz, down * nx - north * nz, -east * nx
    dx, dy, dz = east / transverse**2, -north / meridian**2, -east * tangent / transverse**2
    gravity = gravity_down(state.latitude_rad, state.height_m)
    f[53], f[68] = east * dz - down * dy, down * dx - north * dz
    f[83] = north * dy - east * dx + 2 * gravity / math.sqrt(meridian * transverse)


def _write_position(f: memoryview[float], state: NavState, rates: Rates) -> None:
    """Velocity into position, and the turning and shrinking of the metres' axes."""
    north, east, down = state.velocity_n
    tangent = math.tan(state.latitude_rad)
    f[93] = f[109] = f[125] = 1.0
    f[96], f[98] = -down / rates.meridian_m, north / rates.meridian_m
    f[111] = east * tangent / rates.meridian_m
    f[112] = -down / rates.transverse_m - north * tangent / rates.meridian_m
    f[113] = east / rates.transverse_m


def _tangent(state: NavState) -> tuple[float, float]:
    """Tangent of the latitude, and one over its squared cosine."""
    tangent = math.tan(state.latitude_rad)
    return tangent, 1 + tangent * tangent


def noise_density(imu: ImuConfig) -> Array:
    """(15,) power densities of the driving noise, per axis in ``b``.

    Attitude and velocity: squared random walks. A Gauss-Markov bias of standard deviation ``s``
    and correlation time ``tau`` is driven by ``s sqrt(2 / tau)``.
    """
    gyro = np.array(imu.gyro_bias_instability) ** 2 * 2 / np.array(imu.gyro_bias_time_s)
    accel = np.array(imu.accel_bias_instability) ** 2 * 2 / np.array(imu.accel_bias_time_s)
    walks = [np.array(imu.angle_random_walk) ** 2, np.array(imu.velocity_random_walk) ** 2]
    return np.concatenate([*walks, np.zeros(3), gyro, accel])


class CovariancePropagation:
    """Carries the covariance; keeps the workspace of that, which runs at every IMU sample."""

    def __init__(self, imu: ImuConfig) -> None:
        self._density = noise_density(imu).tolist()
        self._f, self._q, self._a, self._transition, self._half = np.zeros((5, STATES, STATES))
        _write_decay(self._f, imu)
        self._flat_f, self._flat_q = _flat(self._f), _flat(self._q)

    def step(self, covariance: Array, state: NavState, rates: Rates, step_s: float) -> Array:
        """(15, 15) covariance after a step: second-order transition, noise turned to ``n``."""
        _write_dynamics(self._flat_f, state, rates)
        self._write_noise(rates.rotation_nb, step_s)
        transition = self._transition
        np.multiply(self._f, step_s, out=self._a)
        np.dot(self._a, self._a, out=transition)
        transition *= 0.5
        transition += self._a
        transition += _IDENTITY
        np.dot(transition, covariance, out=self._half)
        out = np.dot(self._half, transition.T)
        out += self._q
        out = out + out.T
        out *= 0.5
        return np.asarray(out)

    def _write_noise(self, rotation: Rotation, step_s: float) -> None:
        """Random walks turned to ``n``, and the biases' driving noise, over a step."""
        q, density = self._flat_q, self._density
        _write_turned(q, 0, rotation, density[0:3], step_s)
        _write_turned(q, 48, rotation, density[3:6], step_s)
        for i in range(9, STATES):
            q[16 * i] = density[i] * step_s


def _write_turned(
    q: memoryview[float], at: int, r: Rotation, density: list[float], step_s: float
) -> None:
    """``R diag(density) R^T step_s`` into the 3 x 3 block that begins at flat index ``at``."""
    a, b, c = density[0] * step_s, density[1] * step_s, density[2] * step_s
    ra, rb, rc = r[0] * a, r[1] * b, r[2] * c
    q[at] = ra * r[0] + rb * r[1] + rc * r[2]
    q[at + 1] = q[at + 15] = ra * r[3] + rb * r[4] + rc * r[5]
    q[at + 2] = q[at + 30] = ra * r[6] + rb * r[7] + rc * r[8]
    ra, rb, rc = r[3] * a, r[4] * b, r[5] * c
    q[at + 16] = ra * r[3] + rb * r[4] + rc * r[5]
    q[at + 17] = q[at + 31] = ra * r[6] + rb * r[7] + rc * r[8]
    q[at + 32] = r[6] * r[6] * a + r[7] * r[7] * b + r[8] * r[8] * c


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
