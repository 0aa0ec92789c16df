"""Define the error states, their dynamics and feedback into the state, and the IMU's noise.

All states are truth minus estimate, vectors in ``n`` (biases in ``b``):

=====  =========================  =====
0-2    attitude ``phi_n``         rad
3-5    velocity                   m/s
6-8    position north, east, down m
9-11   gyroscope bias             rad/s
12-14  accelerometer bias         m/s2
15-17  error of the ordinary GPS  m
18-20  RTK antenna's place in b   m, only where it is not measured
=====  =========================  =====

With ``R_nb_true = exp([phi x]) R_nb``, differentiating the equations of ``strapdown`` gives the
matrix of the first 15; it is Groves, 2nd ed., section 14.2.4, in metres and with the opposite sign
of error. The error of the GPS is a first-order Gauss-Markov process, as the biases are; the
antenna's place is constant.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from tirgeo_ros.core.config import EkfConfig, ImuConfig
from tirgeo_ros.core.frames.rotations import quat_multiply
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Rates, normalised, quaternion_of
from tirgeo_ros.core.types.arrays import Array, Rotation, Vector
from tirgeo_ros.core.types.measurements import ImuSample

#: Power densities: gyroscopes x, y, z in rad2/s, accelerometers x, y, z in m2/s3.
Powers = tuple[float, float, float, float, float, float]
STILL: Powers = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

#: Length of the running mean.
_MEMORY_S = 3.0
#: A longer step has lost samples: a difference across it would contain motion.
_LONGEST_STEP_S = 0.035
#: While clipped PX4's EKF2 uses 4.9 m/s2 a step of 10 ms: 0.49 m/s/sqrt(s); this in m2/s3.
_CLIPPED = 0.49**2

STATES = 15  # states of the INS itself, without the receivers'
ATTITUDE = slice(0, 3)
VELOCITY = slice(3, 6)
POSITION = slice(6, 9)
GYRO_BIAS = slice(9, 12)
ACCEL_BIAS = slice(12, 15)
GPS_ERROR = slice(15, 18)
ANTENNA = slice(18, 21)


def states_of(config: EkfConfig) -> int:
    """Return the number of error states that the parameters ask for."""
    return ANTENNA.stop if config.aircraft.rtk_lever_sigma_b.any() else GPS_ERROR.stop


def has_antenna(states: int) -> bool:
    """Return whether the RTK antenna's place is one of ``states`` error states."""
    return states >= ANTENNA.stop


def flat_memory(square: Array) -> memoryview[float]:
    """Return a matrix's memory by rows: scalars are written there at a tenth of the cost."""
    return cast("memoryview[float]", square.reshape(-1).data)


def _write_dynamics(
    f: memoryview[float], n: int, state: NavState, rates: Rates, force_n: Vector
) -> None:
    """Write the part of ``F`` that changes into its flat memory, in rows of ``n`` entries."""
    a0, a1, a2, v0, v1, v2 = 0, n, 2 * n, 3 * n, 4 * n, 5 * n
    p0, p1, p2 = 6 * n, 7 * n, 8 * n
    north, east, down = state.velocity_n
    (earth_n, _, earth_d), (over_n, over_e, over_d) = rates.earth_rate_n, rates.transport_rate_n
    meridian, transverse, gravity = rates.meridian_m, rates.transverse_m, rates.gravity_m_s2
    fn, fe, fd = force_n
    tangent = math.tan(state.latitude_rad)
    square = 1 + tangent * tangent
    # Gyroscope bias into attitude, accelerometer bias into velocity: -R_nb.
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = rates.rotation_nb
    f[a0 + 9] = f[v0 + 12] = -r0
    f[a0 + 10] = f[v0 + 13] = -r1
    f[a0 + 11] = f[v0 + 14] = -r2
    f[a1 + 9] = f[v1 + 12] = -r3
    f[a1 + 10] = f[v1 + 13] = -r4
    f[a1 + 11] = f[v1 + 14] = -r5
    f[a2 + 9] = f[v2 + 12] = -r6
    f[a2 + 10] = f[v2 + 13] = -r7
    f[a2 + 11] = f[v2 + 14] = -r8
    # Attitude: -[w_in x]; minus the partials of the n frame's rate by velocity and by position.
    wn, wd = earth_n + over_n, earth_d + over_d
    f[a0 + 1], f[a0 + 2] = wd, -over_e
    f[a1], f[a1 + 2] = -wd, wn
    f[a2], f[a2 + 1] = over_e, -wn
    f[a0 + 4], f[a1 + 3], f[a2 + 4] = -1 / transverse, 1 / meridian, tangent / transverse
    dn, de, dd = over_n / transverse, over_e / meridian, over_d / transverse
    f[a0 + 8], f[a1 + 8], f[a2 + 8] = -dn, -de, -dd
    f[a0 + 6] = -earth_d / meridian
    by_latitude = over_n * square / meridian + earth_n / meridian
    f[a2 + 6] = by_latitude
    # Velocity: -[f x] on attitude, Coriolis and transport terms, gravity's gradient in height.
    f[v0 + 1], f[v0 + 2] = fd, -fe
    f[v1], f[v1 + 2] = -fd, fn
    f[v2], f[v2 + 1] = fe, -fn
    cn, ce, cd = 2 * earth_n + over_n, over_e, 2 * earth_d + over_d
    f[v0 + 3], f[v0 + 4], f[v0 + 5] = down / meridian, cd - over_n * tangent, -ce
    f[v1 + 3], f[v1 + 4], f[v1 + 5] = -cd, (down + north * tangent) / transverse, cn
    f[v2 + 3], f[v2 + 4] = ce - north / meridian, -cn - over_n
    # [v x] times the partials of the frame rates by position.
    sn, sd = 2 * earth_d / meridian, -by_latitude - earth_n / meridian
    f[v0 + 6], f[v1 + 6], f[v2 + 6] = east * sd, down * sn - north * sd, -east * sn
    f[v0 + 8], f[v1 + 8] = east * dd - down * de, down * dn - north * dd
    f[v2 + 8] = north * de - east * dn + 2 * gravity / math.sqrt(meridian * transverse)
    # Position: velocity, and the turn and scale of the axes in metres as the position changes.
    f[p0 + 3] = f[p1 + 4] = f[p2 + 5] = 1.0
    f[p0 + 6], f[p0 + 8] = -down / meridian, -over_e
    f[p1 + 6] = east * tangent / meridian
    f[p1 + 7] = -down / transverse - north * tangent / meridian
    f[p1 + 8] = over_n


class VibrationMeter:
    """Measure the power densities of an IMU, sample by sample."""

    def __init__(self, initial: Powers = STILL, initial_s: float = 0.0) -> None:
        """Begin with ``initial`` densities, the mean over ``initial_s`` seconds."""
        self._means: Powers = initial
        self._seconds = min(initial_s, _MEMORY_S)
        self._run = 0  # samples since the last gap, up to 2
        self._force: Vector = (0.0, 0.0, 0.0)
        self._rate: Vector = (0.0, 0.0, 0.0)
        self._force_step: Vector = (0.0, 0.0, 0.0)
        self._rate_step: Vector = (0.0, 0.0, 0.0)

    def add(self, step_s: float, force_b: Vector, rate_b: Vector) -> Powers:
        """Take a reading ``step_s`` after the one before (m/s2, rad/s); return the means."""
        fx, fy, fz = force_b
        wx, wy, wz = rate_b
        px, py, pz = self._force
        qx, qy, qz = self._rate
        f0, f1, f2 = force_step = fx - px, fy - py, fz - pz
        w0, w1, w2 = rate_step = wx - qx, wy - qy, wz - qz
        if step_s > _LONGEST_STEP_S:
            self._run = 0
        elif self._run == 2:
            a0, a1, a2 = self._force_step
            b0, b1, b2 = self._rate_step
            seconds = self._seconds
            if seconds < _MEMORY_S:
                self._seconds = seconds = min(seconds + step_s, _MEMORY_S)
            share = step_s / seconds
            scale, keep = share * step_s / 6, 1 - share
            m0, m1, m2, m3, m4, m5 = self._means
            w0 -= b0
            w1 -= b1
            w2 -= b2
            f0 -= a0
            f1 -= a1
            f2 -= a2
            self._means = (
                keep * m0 + scale * w0 * w0,
                keep * m1 + scale * w1 * w1,
                keep * m2 + scale * w2 * w2,
                keep * m3 + scale * f0 * f0,
                keep * m4 + scale * f1 * f1,
                keep * m5 + scale * f2 * f2,
            )
        else:
            self._run += 1
        self._force, self._rate = force_b, rate_b
        self._force_step, self._rate_step = force_step, rate_step
        return self._means


def mean_powers(imu: Sequence[ImuSample]) -> Powers:
    """Return the mean densities over consecutive samples; zeros for fewer than three."""
    if len(imu) < 3:
        return STILL
    readings = np.array([[*s.angular_rate_b, *s.specific_force_b] for s in imu])
    steps_s = np.diff([s.stamp_ns for s in imu]) * 1e-9
    differences = np.diff(readings, 2, axis=0)
    near = np.maximum(steps_s[1:], steps_s[:-1]) <= _LONGEST_STEP_S
    if not near.any():
        return STILL
    powers: Array = (differences[near] ** 2 * steps_s[1:][near, None] / 6).mean(axis=0)
    return tuple(powers.tolist())


def clipped_powers(powers: Powers) -> Powers:
    """Return densities that hold where the accelerometers are shaken beyond their range."""
    x, y, z, a, b, c = powers
    return x, y, z, max(a, _CLIPPED), max(b, _CLIPPED), max(c, _CLIPPED)


def densities(powers: Powers) -> Powers:
    """Return square roots: rad/sqrt(s) of the gyroscopes, m/s/sqrt(s) of the accelerometers."""
    return tuple(map(math.sqrt, powers))  # type: ignore[return-value]


class NoisePowers:
    """Hold the IMU's noise densities: as configured, or a share of the vibration if larger."""

    def __init__(self, imu: ImuConfig) -> None:
        walks = (*imu.angle_random_walk, *imu.velocity_random_walk)
        self._least: Powers = tuple(w * w for w in walks)  # type: ignore[assignment]
        self._gyro = imu.gyro_vibration_share**2
        self._accel = imu.accel_vibration_share**2

    def exceeded(self, vibration: Powers) -> bool:
        """Return whether a vibration makes any density larger than configured."""
        return self.under(vibration) != self._least

    def under(self, vibration: Powers) -> Powers:
        """Return all six under a vibration: never less than the configured ones."""
        a, b, c, d, e, f = self._least
        x, y, z, u, v, w = vibration
        gyro, accel = self._gyro, self._accel
        return (
            max(a, x * gyro),
            max(b, y * gyro),
            max(c, z * gyro),
            max(d, u * accel),
            max(e, v * accel),
            max(f, w * accel),
        )


class CovariancePropagation:
    """Propagate the covariance; the work arrays are kept, since it runs many times a second."""

    def __init__(self, config: EkfConfig) -> None:
        states = states_of(config)
        self._states = states
        self._identity = np.eye(states)
        self._f, self._q, self._a, self._transition, self._half = np.zeros((5, states, states))
        self._flat_f, self._flat_q = flat_memory(self._f), flat_memory(self._q)
        imu, gps, antenna = config.imu, config.gps, states - GPS_ERROR.stop
        sigmas = np.array(
            [*imu.gyro_bias_instability, *imu.accel_bias_instability, *gps.position_sigma_m]
            + [0.0] * antenna
        )
        times_s = np.array(
            [*imu.gyro_bias_time_s, *imu.accel_bias_time_s, *[gps.position_time_s] * 3]
            + [math.inf] * antenna
        )
        self._f[range(9, states), range(9, states)] = -1 / times_s
        self._noise_powers = NoisePowers(imu)
        # A Gauss-Markov state of sigma s and correlation time tau is driven by s sqrt(2 / tau).
        self._driving = np.diag(np.concatenate([np.zeros(9), sigmas**2 * 2 / times_s]))

    @property
    def transition(self) -> Array:
        """Return the transition matrix (n, n) of the newest step, as a view."""
        return np.asarray(self._transition)

    def step(
        self,
        covariance: Array,
        state: NavState,
        rates: Rates,
        force_n: Vector,
        step_s: float,
        vibration: Powers = STILL,
    ) -> Array:
        """Return the covariance (n, n) after a step: second-order transition, noise in ``n``.

        ``force_n`` (m/s2) is the mean specific force of the step; ``state`` and ``rates`` are
        those of an instant within it; ``vibration`` are the noise densities of the IMU's readings.
        """
        _write_dynamics(self._flat_f, self._states, state, rates, force_n)
        transition, a = self._transition, self._a
        np.multiply(self._f, step_s, out=a)
        a.dot(a, out=transition)  # np.dot(a, a) takes a detour in Python
        transition *= 0.5
        transition += a
        transition += self._identity
        transition.dot(covariance, out=self._half)
        out = self._half.dot(transition.T)
        out += self._noise(rates.rotation_nb, step_s, vibration)
        np.add(out, out.T, out=self._half)
        np.multiply(self._half, 0.5, out=out)
        return np.asarray(out)

    def _noise(self, rotation: Rotation, step_s: float, vibration: Powers) -> Array:
        """Return the process noise (n, n) of a step: random walks in ``n``, and driving noise."""
        np.multiply(self._driving, step_s, out=self._q)
        q, n, walks = self._flat_q, self._states, self._noise_powers.under(vibration)
        _write_turned(q, 0, n, rotation, walks[0:3], step_s)
        _write_turned(q, 3 * n + 3, n, rotation, walks[3:6], step_s)
        return self._q


def _write_turned(
    q: memoryview[float], at: int, n: int, r: Rotation, density: Sequence[float], step_s: float
) -> None:
    """Write ``R diag(density) R^T step_s`` into the 3 x 3 block that begins at index ``at``."""
    a, b, c = density[0] * step_s, density[1] * step_s, density[2] * step_s
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = r
    ra, rb, rc = r0 * a, r1 * b, r2 * c
    second, third = at + n, at + 2 * n
    q[at] = ra * r0 + rb * r1 + rc * r2
    q[at + 1] = q[second] = ra * r3 + rb * r4 + rc * r5
    q[at + 2] = q[third] = ra * r6 + rb * r7 + rc * r8
    ra, rb, rc = r3 * a, r4 * b, r5 * c
    q[second + 1] = ra * r3 + rb * r4 + rc * r5
    q[second + 2] = q[third + 1] = ra * r6 + rb * r7 + rc * r8
    q[third + 2] = r6 * r6 * a + r7 * r7 * b + r8 * r8 * c


def feedback(state: NavState, error: Array) -> NavState:
    """Return the state corrected by an estimated error (n,), of which the first 15 are used.

    Positions are converted from metres; the corrections of position and velocity are summed up in
    ``correction_n`` and ``push_n``.
    """
    e = error.tolist()
    meridian, transverse = radii_of_curvature(state.latitude_rad)
    north, east, down = e[6:9]
    latitude = state.latitude_rad + north / (meridian + state.height_m)
    cosine = math.cos(state.latitude_rad)
    v, c, p = state.velocity_n, state.correction_n, state.push_n
    g, a = state.gyro_bias_b, state.accel_bias_b
    return NavState(
        q_nb=normalised(quat_multiply(quaternion_of(e[0], e[1], e[2]), state.q_nb)),
        velocity_n=(v[0] + e[3], v[1] + e[4], v[2] + e[5]),
        latitude_rad=latitude,
        longitude_rad=state.longitude_rad + east / ((transverse + state.height_m) * cosine),
        height_m=state.height_m - down,
        gyro_bias_b=(g[0] + e[9], g[1] + e[10], g[2] + e[11]),
        accel_bias_b=(a[0] + e[12], a[1] + e[13], a[2] + e[14]),
        correction_n=(c[0] + north, c[1] + east, c[2] + down),
        push_n=(p[0] + e[3], p[1] + e[4], p[2] + e[5]),
    )
