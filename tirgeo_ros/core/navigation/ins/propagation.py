# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Propagate state and covariance between two IMU samples: dynamics, and process noise of the IMU.

The covariance follows the state at a lower rate, and at every measurement. With
``R_nb_true = exp([phi x]) R_nb``, differentiating the equations of ``strapdown`` gives the matrix
of the first 15 error states (``error_states``); it is Groves, 2nd ed., section 14.2.4, in metres
and with the opposite sign of error. The GPS error, like the biases, is a first-order Gauss-Markov
process, as is that of GPS velocities; the barometer's offset is a random walk; the IMU's delay and
the antenna's position are constant.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from tirgeo_ros.core.config import EkfConfig, ImuConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.ins.error_states import (
    ACCEL_BIAS,
    ATTITUDE,
    BAROMETER_OFFSET,
    GPS_ERROR,
    GPS_VELOCITY_ERROR,
    GYRO_BIAS,
    POSITION,
    VELOCITY,
    flat_memory,
    states_of,
)
from tirgeo_ros.core.navigation.ins.kalman import Change, Mark
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Rates, propagate, rotate
from tirgeo_ros.core.types.arrays import Array, Rotation, Vector
from tirgeo_ros.core.types.measurements import ImuSample

_OFFSET = BAROMETER_OFFSET.start
#: Longest single step of the state.
_LARGEST_STEP_S = 0.02
#: Shortest step of the covariance; it gives steps of 50 ms at IMU rates of 100 to 400 Hz.
_COVARIANCE_STEP_S = 0.0495
#: In an interval longer than this, that of the slowest IMU with jitter, samples are lost: a
#: difference of readings across it would contain motion.
_LOST_SAMPLES_S = 0.035
#: Possible motion in such an interval that the samples around it do not show.
_UNSEEN_RATE_RAD_S = 0.03
_UNSEEN_FORCE_M_S2 = 0.2
#: Rms of a number uniform in 0 to 1: the unknown share of a gap's motion that did not happen.
_UNIFORM_RMS = 0.58

#: Power densities: gyroscopes x, y, z in rad2/s, accelerometers x, y, z in m2/s3.
Powers = tuple[float, float, float, float, float, float]
_Three = tuple[Powers, Powers, Powers]
STILL: Powers = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
#: Length of the running mean of the IMU's noise.
_MEMORY_S = 3.0
#: Shortest time over which readings are averaged: two or three samples of a slow IMU.
_AVERAGE_S = 0.0245
#: Noise of clipped accelerometers, m2/s3: PX4's EKF2 uses 4.9 m/s2 over 10 ms, 0.49 m/s/sqrt(s).
_CLIPPED = 0.49**2

E = TypeVar("E", bound="Epoch")


class Propagated(NamedTuple):
    """Hold a state, and its covariance, which is ``lag_s`` older and is propagated later."""

    state: NavState
    covariance: Array
    lag_s: float = 0.0
    start: NavState | None = None  # the state at the covariance's time
    rates: Rates | None = None  # near the middle of the lag
    vibration: Powers = STILL  # IMU noise of the last seconds
    trail: Mark | None = None  # newest change of the covariance, if a smoother needs it


@dataclass(slots=True, eq=False)
class Epoch:
    """Hold an IMU sample, the interval that ends with it, and the state at its stamp."""

    stamp_ns: int
    force_b: Vector  # m/s2
    rate_b: Vector  # rad/s
    propagated: Propagated
    step_s: float = 0.0  # length of the interval
    mean_force_b: Vector = (0.0, 0.0, 0.0)
    mean_rate_b: Vector = (0.0, 0.0, 0.0)
    vibration: Powers = STILL
    autopilot_q_nb: Array | None = None

    @classmethod
    def first(cls: type[E], stamp_ns: int, sample: ImuSample, start: Propagated) -> E:
        """Return the first epoch; ``sample`` is the newest one up to its stamp."""
        force, rate = sample.specific_force_b.tolist(), sample.angular_rate_b.tolist()
        return cls(stamp_ns, tuple(force), tuple(rate), start)

    @classmethod
    def after(cls: type[E], before: Epoch, sample: ImuSample, meter: VibrationMeter) -> E:
        """Return the epoch of the next sample; its own state is computed later."""
        force: Vector = tuple(sample.specific_force_b.tolist())
        rate: Vector = tuple(sample.angular_rate_b.tolist())
        step_s = (sample.stamp_ns - before.stamp_ns) * 1e-9
        fx, fy, fz = force
        wx, wy, wz = rate
        gx, gy, gz = before.force_b
        vx, vy, vz = before.rate_b
        return cls(
            sample.stamp_ns,
            force,
            rate,
            before.propagated,
            step_s,
            (0.5 * (gx + fx), 0.5 * (gy + fy), 0.5 * (gz + fz)),
            (0.5 * (vx + wx), 0.5 * (vy + wy), 0.5 * (vz + wz)),
            meter.add(step_s, force, rate),
            sample.autopilot_q_nb,
        )


def between(start: Epoch, end: Epoch, stamp_ns: int) -> tuple[Vector, Vector]:
    """Return specific force (m/s2) and angular rate (rad/s) in ``b``, interpolated linearly."""
    share = (stamp_ns - start.stamp_ns) / (end.stamp_ns - start.stamp_ns)
    (x, y, z), (p, q, r) = start.force_b, start.rate_b
    (fx, fy, fz), (wx, wy, wz) = end.force_b, end.rate_b
    force_b = x + share * (fx - x), y + share * (fy - y), z + share * (fz - z)
    return force_b, (p + share * (wx - p), q + share * (wy - q), r + share * (wz - r))


class Propagation:
    """Propagate the filter's state between IMU samples."""

    def __init__(self, config: EkfConfig) -> None:
        self._propagation = CovariancePropagation(config)

    def whole(self, now: Propagated, start: Epoch, end: Epoch) -> Propagated:
        """Propagate through a whole interval without measurements."""
        if end.step_s <= _LARGEST_STEP_S:
            return self._stepped(now, end, end.mean_force_b, end.mean_rate_b, end.step_s)
        return self.part(now, start, end, start.stamp_ns, end.stamp_ns)

    def part(
        self, now: Propagated, start: Epoch, end: Epoch, from_ns: int, to_ns: int
    ) -> Propagated:
        """Propagate through a part of an interval; readings are linear between two samples."""
        steps = -(-(to_ns - from_ns) // round(_LARGEST_STEP_S * 1e9))
        for step in range(steps):
            middle_ns = from_ns + (to_ns - from_ns) * (2 * step + 1) // (2 * steps)
            step_s = (to_ns - from_ns) * 1e-9 / steps
            now = self._stepped(now, end, *between(start, end, middle_ns), step_s)
        if steps and to_ns == end.stamp_ns and end.step_s > _LOST_SAMPLES_S:
            return self._bridged(now, start, end)
        return now

    def _stepped(
        self, now: Propagated, end: Epoch, force_b: Vector, rate_b: Vector, step_s: float
    ) -> Propagated:
        state, rates = propagate(now.state, force_b, rate_b, step_s)
        middle, lag_s = now.rates, now.lag_s
        if middle is None or lag_s <= 0.5 * _COVARIANCE_STEP_S:
            middle = rates
        lag_s += step_s
        start = now.start or now.state
        fields = (state, now.covariance, lag_s, start, middle, end.vibration, now.trail)
        lagging: Propagated = tuple.__new__(Propagated, fields)  # at half the cost
        return self.followed(lagging) if lag_s >= _COVARIANCE_STEP_S else lagging

    def followed(self, now: Propagated) -> Propagated:
        """Return ``now`` with its covariance propagated to the state's time."""
        lag_s, start, rates, trail = now.lag_s, now.start, now.rates, now.trail
        if start is None or rates is None:
            return now
        (n0, e0, d0), (n1, e1, d1) = start.velocity_n, now.state.velocity_n
        # Mean specific force: the change of velocity over time, less gravity.
        force_n = (n1 - n0) / lag_s, (e1 - e0) / lag_s, (d1 - d0) / lag_s - rates.gravity_m_s2
        covariance = self._propagation.step(
            now.covariance, start, rates, force_n, lag_s, now.vibration
        )
        if trail is not None:
            change = Change(covariance, self._propagation.transition.copy(), step_s=lag_s)
            trail = Mark(change, trail)
        return Propagated(now.state, covariance, trail=trail)

    def _bridged(self, now: Propagated, start: Epoch, end: Epoch) -> Propagated:
        """Return ``now`` with a covariance enlarged for a gap between two samples.

        Motion may have happened in the gap that no sample shows. Or there is no gap: a clock that
        was set forward looks the same. So the share of the propagated motion that did happen is
        unknown, from 0 to 1.
        """
        followed = self.followed(now)
        state, covariance = followed.state, followed.covariance
        covariance, before, gap_s = covariance.copy(), start.propagated.state, end.step_s
        rate = 0.5 * math.dist(start.rate_b, end.rate_b) + _UNSEEN_RATE_RAD_S
        force = 0.5 * math.dist(start.force_b, end.force_b) + _UNSEEN_FORCE_M_S2
        turn = rotate(rotation_of(state.q_nb), end.mean_rate_b)
        change = np.subtract(state.velocity_n, before.velocity_n)
        for block, sigma, motion in (
            (ATTITUDE, rate * gap_s, gap_s * np.array(turn)),
            (VELOCITY, force * gap_s, change),
            (POSITION, 0.5 * force * gap_s * gap_s, gap_s * np.array(state.velocity_n)),
        ):
            uncertainty = _UNIFORM_RMS**2 * np.outer(motion, motion)
            covariance[block, block] += sigma * sigma * np.eye(3) + uncertainty
        trail = followed.trail and Mark(Change(covariance), followed.trail)
        return followed._replace(covariance=covariance, trail=trail)


class CovariancePropagation:
    """Propagate the covariance; work arrays are reused, since it runs many times a second.

    ``transition`` (n, n) is that of the newest step.
    """

    def __init__(self, config: EkfConfig) -> None:
        states = states_of(config)
        self._states = states
        self._identity = np.eye(states)
        self._f, self._q, self._a, self.transition, self._half = np.zeros((5, states, states))
        self._flat_f, self._flat_q = flat_memory(self._f), flat_memory(self._q)
        imu, gps, barometer = config.imu, config.gps, config.barometer
        gyros, accels = imu.gyro_turn_on_bias, imu.accel_turn_on_bias
        # White noise of density s sqrt(2 / tau) drives a Gauss-Markov state (sigma s, time tau). A
        # bias is driven so too, but its constant part, from turn-on, must not decay: the decay is
        # what keeps the variance of both parts.
        driving, kept = np.zeros(states), np.full(states, np.finfo(float).tiny)
        for block, sigma, time_s, turn_on in (
            (GYRO_BIAS, imu.gyro_bias_instability, imu.gyro_bias_time_s, gyros),
            (ACCEL_BIAS, imu.accel_bias_instability, imu.accel_bias_time_s, accels),
            (GPS_ERROR, gps.position_sigma_m, gps.position_time_s, 0.0),
        ):
            driving[block] = np.square(sigma) * 2 / time_s
            kept[block] += np.square(sigma) + turn_on**2
        np.fill_diagonal(self._f, -driving / (2 * kept))
        # Driven as it is used.
        self._f[GPS_VELOCITY_ERROR, GPS_VELOCITY_ERROR] = -np.eye(3) / gps.position_time_s
        self._noise_powers = NoisePowers(imu)
        self._driving = np.diag(driving)
        self._driving[_OFFSET, _OFFSET] = barometer.density**2
        # An error of scale lasts: in ``time_s`` it adds up to that of the climb in this time.
        self._climbing = barometer.scale_sigma**2 * barometer.time_s

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
        of an instant within it; ``vibration`` holds the noise densities of the IMU's readings.
        """
        _write_dynamics(self._flat_f, self._states, state, rates, force_n)
        transition, a = self.transition, self._a
        np.multiply(self._f, step_s, out=a)
        a.dot(a, out=transition)  # np.dot(a, a) has more overhead in Python
        transition *= 0.5
        transition += a
        transition += self._identity
        transition.dot(covariance, out=self._half)
        out = self._half.dot(transition.T)
        out += self._noise(rates.rotation_nb, step_s, vibration)
        out[_OFFSET, _OFFSET] += self._climbing * state.velocity_n[2] ** 2 * step_s
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
    """Measure the noise power densities of an IMU, sample by sample.

    They follow from second differences of readings. Lines of vibration near half the sampling rate
    weigh most in these, although their integral stays bounded. They drop out of differences of
    averages, to which in turn the carrier's motion adds: the smaller density counts.
    """

    def __init__(self, initial: Powers = STILL, initial_s: float = 0.0) -> None:
        """Begin with ``initial`` densities, the mean over ``initial_s`` seconds."""
        self._by_samples = self._by_averages = self._smaller = initial
        self._seconds = min(initial_s, _MEMORY_S)
        self._readings: _Three = (STILL,) * 3  # the newest: gyroscopes, accelerometers
        self._averages: _Three = (STILL,) * 3
        self._averaged = 0  # averages since the last gap
        self._sums, self._count, self._span_s = STILL, 0, 0.0  # since the last average

    def add(self, step_s: float, force_b: Vector, rate_b: Vector) -> Powers:
        """Take a reading, ``step_s`` after the last (m/s2, rad/s); return the mean densities."""
        if step_s > _LOST_SAMPLES_S:
            self._sums, self._count, self._span_s, self._averaged = STILL, 0, 0.0, 0
        else:
            self._span_s += step_s
        p, q, r, u, v, w = self._sums
        (x, y, z), (a, b, c) = rate_b, force_b
        _, before, last = self._readings
        self._readings = before, last, (x, y, z, a, b, c)
        self._sums = p + x, q + y, r + z, u + a, v + b, w + c
        self._count += 1
        if self._span_s >= _AVERAGE_S:
            self._average(step_s)
        return self._smaller

    def _average(self, step_s: float) -> None:
        """End an average; take its second difference, and that of the newest readings."""
        (x, y, z, a, b, c), n, span_s = self._sums, self._count, self._span_s
        _, before, last = self._averages
        self._averages = before, last, (x / n, y / n, z / n, a / n, b / n, c / n)
        self._averaged += 1
        if self._averaged >= 3:
            self._seconds = min(self._seconds + span_s, _MEMORY_S)
            share = span_s / self._seconds
            p, q, r, u, v, w = by = _mixed(self._by_samples, self._readings, share, step_s)
            x, y, z, a, b, c = averaged = _mixed(self._by_averages, self._averages, share, span_s)
            self._by_samples, self._by_averages = by, averaged
            self._smaller = min(p, x), min(q, y), min(r, z), min(u, a), min(v, b), min(w, c)
        self._sums, self._count, self._span_s = STILL, 0, 0.0


def _mixed(means: Powers, three: _Three, share: float, step_s: float) -> Powers:
    """Return mean densities with a share of those by three readings, ``step_s`` apart."""
    keep, scale = 1 - share, share * step_s / 6
    m0, m1, m2, m3, m4, m5 = means
    (a0, a1, a2, a3, a4, a5), (b0, b1, b2, b3, b4, b5), (c0, c1, c2, c3, c4, c5) = three
    a0 += c0 - 2 * b0
    a1 += c1 - 2 * b1
    a2 += c2 - 2 * b2
    a3 += c3 - 2 * b3
    a4 += c4 - 2 * b4
    a5 += c5 - 2 * b5
    return (
        keep * m0 + scale * a0 * a0,
        keep * m1 + scale * a1 * a1,
        keep * m2 + scale * a2 * a2,
        keep * m3 + scale * a3 * a3,
        keep * m4 + scale * a4 * a4,
        keep * m5 + scale * a5 * a5,
    )


def mean_powers(imu: Sequence[ImuSample]) -> Powers:
    """Return the mean densities over consecutive samples; zeros for fewer than three."""
    if len(imu) < 3:
        return STILL
    readings = np.array([[*s.angular_rate_b, *s.specific_force_b] for s in imu])
    steps_s = np.diff([s.stamp_ns for s in imu]) * 1e-9
    differences = np.diff(readings, 2, axis=0)
    near = np.maximum(steps_s[1:], steps_s[:-1]) <= _LOST_SAMPLES_S
    if not near.any():
        return STILL
    powers: Array = (differences[near] ** 2 * steps_s[1:][near, None] / 6).mean(axis=0)
    return tuple(powers.tolist())


def clipped_powers(powers: Powers) -> Powers:
    """Return the densities while the accelerometers are shaken beyond their range."""
    x, y, z, a, b, c = powers
    return x, y, z, max(a, _CLIPPED), max(b, _CLIPPED), max(c, _CLIPPED)


def densities(powers: Powers) -> Powers:
    """Return the square roots: gyroscopes in rad/sqrt(s), accelerometers in m/s/sqrt(s)."""
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
        """Return the six densities under a vibration, never less than those configured."""
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
