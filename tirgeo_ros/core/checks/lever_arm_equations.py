"""Fit the RTK antenna's lever arm to the receiver's and the IMU's paths, without the filter.

Over a window the antenna's position is ``p + R l - d v``: the integral of the IMU's readings, the
lever arm ``l`` turned with the body, and the delay ``d`` of the stamps after the measurements.
The unknowns at the window's start (position, velocity, tilt, bias, heading) cause errors that grow
with powers of time and along the integrals turned by 90 deg; these parts are projected out. Turns
show the horizontal lever arm, tilts the vertical one. Velocity is treated in the same way, with
one power less.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.checks.imu_blocks import ImuMean
from tirgeo_ros.core.frames.rotations import matrix_from_quat, matrix_from_rotvec, skew
from tirgeo_ros.core.types.arrays import Array

_GRAVITY_N = np.array((0.0, 0.0, 9.81))
_LEAST_ROWS = 8
_CUBIC, _QUADRATIC = 3, 2


class Normal(NamedTuple):
    """Hold one window's normal equations for the lever arm (m, FRD) and minus the delay (s)."""

    matrix: Array  # (4, 4)
    right: Array  # (4,)
    squares: float
    degrees: int


class ImuPath(NamedTuple):
    """Hold the IMU's readings of a window, integrated from zero, at N instants.

    Attitude, rate and the antenna's motion are those in the middle of each block; the IMU's
    velocity and position are those at its end.
    """

    times_s: Array  # (N,) ends of the blocks
    rotation_nb: Array  # (N, 3, 3)
    rate_b: Array  # (N, 3) rad/s
    velocity_n: Array  # (N, 3) m/s
    position_n: Array  # (N, 3) m
    antenna_velocity_n: Array  # (N, 3) m/s
    antenna_acceleration_n: Array  # (N, 3) m/s2

    @property
    def middles_s(self) -> Array:
        """Return (N,) the times of the blocks' middles."""
        return np.asarray(self.times_s - 0.5 * np.diff(self.times_s, prepend=0.0))


def integrated(
    blocks: Sequence[ImuMean], q_nb: Array, rotation_bi: Array | None, lever_b: Array
) -> ImuPath:
    """Return the path over consecutive blocks; ``q_nb`` (4,) is the attitude before the first.

    ``lever_b`` (3,) is an estimate of the lever arm; its motion is small compared with the path.
    """
    forces, rates = (np.array([b[k] for b in blocks]) for k in (2, 3))
    if rotation_bi is not None:
        forces, rates = forces @ rotation_bi.T, rates @ rotation_bi.T
    steps_s = np.array([b.step_s for b in blocks])
    halves = matrix_from_rotvec(0.5 * steps_s[:, None] * rates)
    rotation = matrix_from_quat(q_nb)
    middles = []
    for half in halves:
        middle = np.dot(rotation, half)
        rotation = np.dot(middle, half)
        middles.append(middle)
    middle_nb = np.array(middles)
    acceleration = np.einsum("nij,nj->ni", middle_nb, forces) + _GRAVITY_N
    change = acceleration * steps_s[:, None]
    velocity = np.cumsum(change, axis=0)
    position = np.cumsum((velocity - 0.5 * change) * steps_s[:, None], axis=0)
    times_s = np.cumsum(steps_s)
    swing = np.einsum("nij,nj->ni", middle_nb, np.cross(rates, lever_b))
    antenna = velocity - 0.5 * change + swing
    pull = acceleration + np.gradient(swing, times_s - 0.5 * steps_s, axis=0)
    return ImuPath(times_s, middle_nb, rates, velocity, position, antenna, pull)


def by_positions(path: ImuPath, times_s: Array, positions_n: Array) -> Normal | None:
    """Return the equations for positions (N, 3), in any NED plane, at times (N,) of the path."""
    middles_s = path.middles_s
    rotation = _between(middles_s, path.rotation_nb, times_s)
    antenna = _between(middles_s, path.antenna_velocity_n, times_s)
    position = _between(path.times_s, path.position_n, times_s)
    design = np.concatenate((rotation, antenna[:, :, None]), axis=2)
    return _reduced(times_s, positions_n - position, design, position, _CUBIC)


def by_velocities(path: ImuPath, times_s: Array, velocities_n: Array) -> Normal | None:
    """Return the equations for velocities (N, 3), NED, at times (N,) of the path."""
    middles_s = path.middles_s
    rotation = _between(middles_s, path.rotation_nb, times_s)
    rate = _between(middles_s, path.rate_b, times_s)
    antenna = _between(middles_s, path.antenna_acceleration_n, times_s)
    velocity = _between(path.times_s, path.velocity_n, times_s)
    design = np.concatenate((rotation @ skew(rate), antenna[:, :, None]), axis=2)
    return _reduced(times_s, velocities_n - velocity, design, velocity, _QUADRATIC)


def _between(known_s: Array, values: Array, times_s: Array) -> Array:
    """Return values (N, ...) at times, interpolated linearly."""
    at = np.clip(np.searchsorted(known_s, times_s), 1, len(known_s) - 1)
    share = (times_s - known_s[at - 1]) / (known_s[at] - known_s[at - 1])
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1 - share) * values[at - 1] + share * values[at])


def _reduced(
    times_s: Array, off: Array, design: Array, turning: Array, powers: int
) -> Normal | None:
    """Return normal equations from which the unknowns of the window's start are projected out.

    ``off`` (N, 3) is ``design`` (N, 3, 4) times the unknowns. ``turning`` (N, 3) is the vector
    that a heading error turns.
    """
    number = len(times_s)
    if number < _LEAST_ROWS:
        return None
    scaled = 2 * (times_s - times_s.mean()) / (times_s[-1] - times_s[0])
    columns = [np.kron((scaled**k)[:, None], np.eye(3)) for k in range(powers + 1)]
    turned = np.stack((-turning[:, 1], turning[:, 0], np.zeros(number)), axis=1)
    basis = np.linalg.qr(np.hstack([*columns, turned.reshape(-1, 1)]))[0]
    rows, values = design.reshape(3 * number, 4), off.ravel()
    rows = rows - basis @ (basis.T @ rows)
    values = values - basis @ (basis.T @ values)
    degrees = 3 * number - basis.shape[1]
    return Normal(rows.T @ rows, rows.T @ values, float(values @ values), degrees)
