"""Integrate IMU readings over a short window, backwards from its end.

That needs no attitude: the gyroscopes carry every reading into the body frame at the end, and
there the readings are summed (Groves, 2nd ed., section 5.6.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.rotations import matrix_from_rotvec
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.measurements import ImuSample


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
    def unknown(cls, sigmas: Array) -> Biases:
        """Return biases of zero with standard deviations (6,)."""
        return cls((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), np.diag(sigmas**2))


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
    known = np.array([s.stamp_ns for s in imu], np.int64)
    first, last = min(stamps_ns), max(stamps_ns)
    inside = known[(known > first) & (known < last)]
    nodes = np.unique(np.concatenate([inside, np.array(stamps_ns, np.int64)]))
    readings = [[*s.angular_rate_b, *s.specific_force_b] for s in imu]
    columns = np.array(readings).T - taken[:, None]
    # Seconds from the first: a float holds today's nanoseconds to a quarter of a microsecond.
    known_s, seconds = (known - first) * 1e-9, (nodes - first) * 1e-9
    values = np.stack([np.interp(seconds, known_s, column) for column in columns], -1)
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
