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
"""Fit the state at the end of a short window to all measurements in it.

Generalised least squares on readings that are integrated backwards from the end, which needs no
attitude (Groves, 2nd ed., section 5.6.2). Seen from the end, at time T, the gyroscopes carry body
vectors at t to the body at T (``D``), and the accelerometers give, in the same axes and without
gravity, ``S = integral of D f`` and ``W = integral of S``, both from t to T. With ``u = T - t``::

    v(t) = v - R S - g u                  (Groves, 2nd ed., 5.6.2, extended to motion)
    p(t) = p - v u + R W + g u^2 / 2
    direction(t) = R D d

So every observation is ``a v + b p + c g + R x`` with its own scalars a, b, c and body vector x.
Noise and bias of the IMU enter through x and correlate the errors of all observations; the
covariance of the end's state has all cross terms. Earth rate and Coriolis force are left out: over
some seconds they are a tenth of possible turn-on biases.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.rotations import matrix_from_rotvec, skew, wrap_pi
from tirgeo_ros.core.navigation.ins.propagation import Powers
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.measurements import ImuSample

#: Steps in which the IMU's noise is integrated: their length, and the most in a window.
_NOISE_STEP_NS = 20_000_000
_NOISE_STEPS = 100
_ITERATIONS = 8
_CONVERGED_RAD = 1e-7


class Biases(NamedTuple):
    """Hold the IMU's biases and their covariance."""

    gyro_b: Vector  # rad/s, subtracted from the reading
    accel_b: Vector  # m/s2, subtracted from the reading
    covariance: Array  # (6, 6) gyroscope, then accelerometer

    @property
    def vector(self) -> Array:
        """Return the biases as (6,), gyroscope, then accelerometer."""
        return np.array([*self.gyro_b, *self.accel_b])

    @classmethod
    def expected(cls, means: Array, variances: Array) -> Biases:
        """Return biases (6,) with variances (6,)."""
        return cls(tuple(means[:3].tolist()), tuple(means[3:].tolist()), np.diag(variances))


@dataclass(frozen=True, slots=True)
class PreintegratedImu:
    """Hold IMU readings integrated from each of n instants to the last, in the last body frame."""

    stamps_ns: npt.NDArray[np.int64]  # (n,) of the IMU samples and of the observations
    before_s: Array  # (n,) time to the end
    to_end: Array  # (n, 3, 3) D
    velocity: Array  # (n, 3) S, m/s
    position: Array  # (n, 3) W, m
    rate_b: Array  # (n, 3) rad/s, in the body frame at the instant
    taken: Array  # (6,) biases subtracted from the readings, gyroscope, then accelerometer

    def at(self, stamps_ns: Sequence[int]) -> npt.NDArray[np.intp]:
        """Return the indices of instants that are in the window."""
        return np.searchsorted(self.stamps_ns, np.array(stamps_ns, np.int64))


def integrate(
    imu: Sequence[ImuSample], stamps_ns: Sequence[int], taken: Array
) -> PreintegratedImu:
    """Integrate readings, less biases ``taken`` (6,), over all of the observations' stamps."""
    imu_ns = np.array([s.stamp_ns for s in imu], np.int64)
    first, last = min(stamps_ns), max(stamps_ns)
    inside = imu_ns[(imu_ns > first) & (imu_ns < last)]
    nodes = np.unique(np.concatenate([inside, np.array(stamps_ns, np.int64)]))
    readings = [[*s.angular_rate_b, *s.specific_force_b] for s in imu]
    columns = np.array(readings).T - taken[:, None]
    # Seconds from the first: a float of today's time in ns resolves only a quarter of a us.
    imu_s, seconds = (imu_ns - first) * 1e-9, (nodes - first) * 1e-9
    values = np.stack([np.interp(seconds, imu_s, column) for column in columns], -1)
    rate_b, force_b = values[:, :3], values[:, 3:]
    steps = np.diff(seconds)[:, None]
    turns = 0.5 * (rate_b[1:] + rate_b[:-1]) * steps
    to_first = [np.eye(3)]
    for turn in matrix_from_rotvec(turns):
        to_first.append(to_first[-1] @ turn)
    to_end = to_first[-1].T @ np.array(to_first)
    middle = to_end[:-1] @ matrix_from_rotvec(0.5 * turns)
    pushes = np.einsum("kij,kj->ki", middle, 0.5 * (force_b[1:] + force_b[:-1]) * steps)
    velocity = _sums_to_end(pushes)
    position = _sums_to_end((velocity[1:] + 0.5 * pushes) * steps)
    return PreintegratedImu(
        nodes, seconds[-1] - seconds, to_end, velocity, position, rate_b, taken
    )


def _sums_to_end(parts: Array) -> Array:
    """Return the sums (n, 3) of (n - 1, 3) parts from each instant to the last."""
    sums = np.cumsum(parts[::-1], axis=0)[::-1]
    return np.concatenate([sums, np.zeros((1, 3))])


class ObservationKind(Enum):
    """Name the quantity that an observation measures; the value is its unit in messages."""

    VELOCITY = "m/s"
    POSITION = "m"
    AZIMUTH = "deg"


@dataclass(frozen=True, slots=True)
class AlignmentObservation:
    """Hold one measurement of the window; k = 3, or 1 for an azimuth."""

    stamp_ns: int
    name: str  # its topic
    kind: ObservationKind
    value: Array  # (k,) NED m/s or m of an antenna, or the azimuth of a direction in rad
    arm_b: Array  # (3,) lever arm from IMU to antenna in m, or the direction
    white: Array  # (k, k) covariance of the white error
    slow_sigma: Array  # (k,) standard deviation of the slow error
    slow_time_s: float = np.inf  # correlation time of the slow error


@dataclass(frozen=True, slots=True)
class WindowFit:
    """Hold the state at the window's end."""

    rotation_nb: Array  # (3, 3)
    velocity_n: Array  # (3,) m/s
    position_n: Array  # (3,) m, in the axes of the observations
    biases: Array  # (6,) gyroscope rad/s, accelerometer m/s2
    covariance: Array  # (15, 15) attitude, velocity, position, biases
    tilt_sigma_rad: float  # larger one of the two tilt angles, for biases without error
    residuals: list[Array]  # (k,) of each observation
    distances: Array  # (m,) squared distance per degree of freedom, of each observation
    settled: bool


class _Terms:
    """Compute the model's terms for each observation: scalars, body vector, IMU partials."""

    def __init__(
        self,
        window: PreintegratedImu,
        observations: Sequence[AlignmentObservation],
        powers: Powers,
    ) -> None:
        at = window.at([o.stamp_ns for o in observations])
        self._is_velocity = np.array([o.kind is ObservationKind.VELOCITY for o in observations])
        self._is_position = np.array([o.kind is ObservationKind.POSITION for o in observations])
        before = window.before_s[at]
        self.of_velocity = np.where(self._is_position, -before, 1.0 * self._is_velocity)
        self.of_position = 1.0 * self._is_position
        self.of_gravity = np.where(self._is_position, 0.5 * before**2, -before * self._is_velocity)
        arms = np.array([o.arm_b for o in observations])
        swinging = np.cross(window.rate_b[at], arms)
        turned = np.where(self._is_velocity[:, None], swinging, arms)
        self.body = np.einsum("kij,kj->ki", window.to_end[at], turned)
        self.body -= self._is_velocity[:, None] * window.velocity[at]
        self.body += self._is_position[:, None] * window.position[at]
        kernels, steps = self._kernels(window, at)
        self.of_biases = np.einsum("kmij,m->kij", kernels, steps)
        swing = self._is_velocity[:, None, None] * (window.to_end[at] @ skew(arms))
        self.of_biases[:, :, :3] += swing
        flat = (kernels * np.sqrt(np.array(powers) * steps[:, None, None])).swapaxes(1, 2)
        flat = flat.reshape(3 * len(observations), -1)
        self.imu_noise = flat @ flat.T  # (3 m, 3 m) in the last body frame

    def _kernels(self, window: PreintegratedImu, at: npt.NDArray[np.intp]) -> tuple[Array, Array]:
        """Return the effect of a unit IMU error in a step on each observation: (m, steps, 3, 6).

        Also return the lengths of the steps (s). A turn at time s turns all body vectors before s,
        and the part of an integral up to s.
        """
        # Use instants 20 ms or 1 % of the window apart, and those of all observations.
        before_ns = window.stamps_ns - window.stamps_ns[-1]
        step_ns = max(_NOISE_STEP_NS, -int(before_ns[0]) // _NOISE_STEPS)
        first = np.unique(before_ns // step_ns, return_index=True)[1]
        coarse = np.unique(np.concatenate([first, at]))
        steps = -np.diff(window.before_s[coarse])
        middle, velocity, position, left = (
            0.5 * (values[coarse][1:] + values[coarse][:-1])
            for values in (window.to_end, window.velocity, window.position, window.before_s)
        )
        since = window.before_s[at][:, None] - left  # (m, steps)
        is_velocity = self._is_velocity[:, None, None]
        is_position = self._is_position[:, None, None]
        rest = is_position * (position + velocity * since[:, :, None]) - is_velocity * velocity
        kernels = np.zeros((*since.shape, 3, 6))
        kernels[..., :3] = -skew(self.body[:, None] - rest) @ middle
        kernels[..., 3:] = (is_velocity - is_position * since[:, :, None])[..., None] * middle
        return kernels * (since > 0)[:, :, None, None], steps


def fit(
    window: PreintegratedImu,
    observations: Sequence[AlignmentObservation],
    start_nb: Array,
    gravity_m_s2: float,
    biases: Biases,
    powers: Powers,
) -> WindowFit:
    """Fit the state to the observations; ``settled``: the iteration has converged.

    ``start_nb`` (3, 3) is an attitude right to some tens of degrees, ``biases`` are the prior,
    ``powers`` the densities of the IMU's white noise. The observations must hold azimuths,
    velocities or positions at three instants, and a position.
    """
    terms = _Terms(window, observations, powers)
    measured = _measured_noise(observations)
    prior = np.zeros((15, 15))
    prior[9:, 9:] = np.linalg.inv(biases.covariance)
    beside = window.taken - biases.vector
    rotation, rest = start_nb, np.zeros(12)
    for _ in range(_ITERATIONS):
        projection = _projections(observations, terms.body @ rotation.T)
        residual = _residual(observations, terms, rotation, rest, gravity_m_s2)
        design = _design(terms, rotation, projection)
        by_observation = projection.reshape(-1, len(observations), 3)
        turned = (by_observation @ rotation).reshape(projection.shape)
        noise = measured + turned @ terms.imu_noise @ turned.T
        root = np.linalg.cholesky(noise)
        whitened = np.linalg.solve(root, np.column_stack([design, residual]))
        white = whitened[:, :-1]
        information = white.T @ white + prior
        gradient = white.T @ whitened[:, -1]
        gradient[9:] -= prior[9:, 9:] @ (rest[6:] + beside)
        step = np.linalg.solve(information, gradient)
        rotation = matrix_from_rotvec(np.asarray(step[:3], float)) @ rotation
        rest = rest + step[3:]
        if settled := bool(np.abs(step[:3]).max() < _CONVERGED_RAD):
            break
    inverse = np.linalg.inv(information)
    covariance = 0.5 * (inverse + inverse.T)
    residual = residual - design @ step
    # An observation that alone determines a state has no residual: a millionth of its noise keeps
    # the ratio defined.
    spread = (1 + 1e-6) * noise - design @ covariance @ design.T
    places = _rows(observations)
    parts = [residual[rows] for rows in places]
    scaled = [np.linalg.solve(spread[rows, rows], residual[rows]) for rows in places]
    distances = [float(a @ b) / len(a) for a, b in zip(parts, scaled, strict=True)]
    without_biases = np.linalg.inv(information[:9, :9])
    tilt_sigma_rad = float(np.sqrt(max(without_biases[0, 0], without_biases[1, 1])))
    state = rotation, rest[:3], rest[3:6], rest[6:] + window.taken
    return WindowFit(*state, covariance, tilt_sigma_rad, parts, np.array(distances), settled)


def _residual(
    observations: Sequence[AlignmentObservation],
    terms: _Terms,
    rotation: Array,
    rest: Array,
    gravity: float,
) -> Array:
    turned = (terms.body + terms.of_biases @ rest[6:]) @ rotation.T
    vectors = np.outer(terms.of_velocity, rest[:3]) + np.outer(terms.of_position, rest[3:6])
    vectors += turned + np.outer(terms.of_gravity, [0.0, 0.0, gravity])
    parts = [
        wrap_pi(o.value - np.arctan2(turned[k, 1], turned[k, 0]))
        if o.kind is ObservationKind.AZIMUTH
        else o.value - vectors[k]
        for k, o in enumerate(observations)
    ]
    return np.concatenate(parts)


def _rows(observations: Sequence[AlignmentObservation]) -> list[slice]:
    """Return the rows of each observation in the stacked vector of all."""
    ends = itertools.accumulate(len(o.value) for o in observations)
    return [slice(end - len(o.value), end) for o, end in zip(observations, ends, strict=True)]


def _projections(observations: Sequence[AlignmentObservation], turned: Array) -> Array:
    """Return the matrix (rows, 3 m) from vectors in n to the observed components."""
    places = _rows(observations)
    out = np.zeros((places[-1].stop, 3 * len(observations)))
    for k, (rows, (north, east, _)) in enumerate(zip(places, turned, strict=True)):
        block = np.eye(3)
        if observations[k].kind is ObservationKind.AZIMUTH:
            block = np.array([[-east, north, 0.0]]) / (north**2 + east**2)
        out[rows, 3 * k : 3 * k + 3] = block
    return out


def _design(terms: _Terms, rotation: Array, projection: Array) -> Array:
    """Return the partials (rows, 15) by attitude, velocity, position and biases."""
    blocks = np.zeros((len(terms.body), 3, 15))
    blocks[:, :, 0:3] = -skew(terms.body @ rotation.T)
    blocks[:, :, 3:6] = terms.of_velocity[:, None, None] * np.eye(3)
    blocks[:, :, 6:9] = terms.of_position[:, None, None] * np.eye(3)
    blocks[:, :, 9:] = rotation @ terms.of_biases
    return np.asarray(projection @ blocks.reshape(-1, 15))


def _measured_noise(observations: Sequence[AlignmentObservation]) -> Array:
    """Return the covariance (rows, rows) of white errors and of each source's slow error."""
    owner = np.repeat(np.arange(len(observations)), [len(o.value) for o in observations])
    axis = np.concatenate([np.arange(len(o.value)) for o in observations])
    names = np.unique([o.name for o in observations], return_inverse=True)[1].reshape(-1)[owner]
    since_ns = np.array([o.stamp_ns - observations[0].stamp_ns for o in observations])[owner]
    rate_1_s = np.array([1 / o.slow_time_s for o in observations])[owner]
    slow = np.concatenate([o.slow_sigma for o in observations])
    same = (names[:, None] == names) & (axis[:, None] == axis)
    since_s = since_ns * 1e-9
    lasting = np.exp(-np.abs(since_s[:, None] - since_s) * rate_1_s)
    out = np.asarray(same * lasting * np.outer(slow, slow))
    for o, rows in zip(observations, _rows(observations), strict=True):
        out[rows, rows] += o.white
    return out
