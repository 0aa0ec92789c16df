"""Fit the RTK antenna's lever arm to the receiver's and the IMU's paths, without the filter.

Over a window the antenna's position is ``p + R l - d v``: the integral of the IMU's readings, the
lever arm ``l`` turned with the body, and the delay ``d`` of the stamps after the measurements.
The unknowns at the window's start (position, velocity, tilt, bias, heading) cause errors that grow
with powers of time and along the integrals turned by 90 deg; these parts are projected out. Turns
show the horizontal lever arm, tilts the vertical one. Velocity is treated in the same way, with
one power less.

Each window begins in the middle of the previous one, so each value is in two windows and counts
half. The sigmas come from the windows' scatter.
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
#: With fewer windows their scatter gives no useful sigma.
_LEAST_WINDOWS = 6
_ONCE = 0.5  # weight of a value that is in two windows
#: Prior information for the lever arm (m), the delay (s), and the velocities' extra delay (s). It
#: keeps unobservable unknowns at 0. A receiver measures both at once; some smooth the velocity.
_PRIOR = 1 / np.array((10.0, 10.0, 10.0, 2.0, 0.05)) ** 2
#: Maps these five unknowns to the four of positions and to the four of velocities.
_PARTS = np.eye(4, 5), np.eye(4, 5) + np.outer(np.eye(4)[3], np.eye(5)[4])


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


def equations(
    path: ImuPath, times_s: Array, values_n: Array, *, velocities: bool
) -> Normal | None:
    """Return the equations for positions (N, 3), in any NED plane, or for ``velocities``, NED.

    ``times_s`` (N,) are times of the path. The unknowns of the window's start are projected out.
    None with too few values, or with times that do not rise.
    """
    number = len(times_s)
    if number < _LEAST_ROWS or not (np.diff(times_s) > 0).all():
        return None
    middles_s = path.middles_s
    lever, antenna = _between(middles_s, path.rotation_nb, times_s), path.antenna_velocity_n
    moved, powers = path.position_n, _CUBIC
    if velocities:
        lever = lever @ skew(_between(middles_s, path.rate_b, times_s))
        moved, antenna, powers = path.velocity_n, path.antenna_acceleration_n, _QUADRATIC
    moved = _between(path.times_s, moved, times_s)
    late = _between(middles_s, antenna, times_s)
    design = np.concatenate((lever, late[:, :, None]), axis=2)  # (N, 3, 4)
    scaled = 2 * (times_s - times_s.mean()) / (times_s[-1] - times_s[0])
    columns = [np.kron((scaled**k)[:, None], np.eye(3)) for k in range(powers + 1)]
    # A heading error turns the integral.
    turned = np.stack((-moved[:, 1], moved[:, 0], np.zeros(number)), axis=1)
    basis = np.linalg.qr(np.hstack([*columns, turned.reshape(-1, 1)]))[0]
    rows, values = design.reshape(3 * number, 4), (values_n - moved).ravel()
    rows = rows - basis @ (basis.T @ rows)
    values = values - basis @ (basis.T @ values)
    degrees = 3 * number - basis.shape[1]
    return Normal(rows.T @ rows, rows.T @ values, float(values @ values), degrees)


def _between(known_s: Array, values: Array, times_s: Array) -> Array:
    """Return values (N, ...) at times, interpolated linearly."""
    at = np.clip(np.searchsorted(known_s, times_s), 1, len(known_s) - 1)
    share = (times_s - known_s[at - 1]) / (known_s[at] - known_s[at - 1])
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1 - share) * values[at - 1] + share * values[at])


class LeverArmWindow(NamedTuple):
    """Hold a window's equations, None where there are none."""

    positions: Normal | None
    velocities: Normal | None
    overlaps: bool  # whether it begins in the middle of the previous one


class LeverArmEstimate(NamedTuple):
    """Hold the estimate from a flight."""

    lever_b: Array  # (3,) m, FRD
    lever_sigma_b: Array  # (3,)
    delays_s: Array  # (2,) of stamps after measurements; the extra delay of velocities
    delay_sigmas_s: Array  # (2,)
    windows: int
    misfit: float  # product of the residual variances of positions and of velocities


def solved(windows: Sequence[LeverArmWindow]) -> LeverArmEstimate | None:
    """Return the solution of consecutive windows, or None if there are too few.

    Each sigma is the larger of the one from the residuals and the one from the scatter between
    windows, because tilts have larger errors than white noise. The scatter is the sandwich
    estimator of White (Econometrica 48, 1980), with the covariance of overlapping neighbours as in
    Newey and West (Econometrica 55, 1987).
    """
    variances = [_variance(normals) for normals in zip(*(w[:2] for w in windows), strict=True)]
    matrices, rights, overlaps = [], [], []
    before = False  # whether the previous window has equations
    for window in windows:
        matrix, right = _joined(window, variances)
        if matrix.any():
            matrices.append(matrix)
            rights.append(right)
            overlaps.append(before and window.overlaps)
        before = bool(matrix.any())
    if len(matrices) < _LEAST_WINDOWS:
        return None
    inverse = np.linalg.inv(sum(matrices) + np.diag(_PRIOR))
    found = inverse @ sum(rights)
    left = np.array([r - m @ found for m, r in zip(matrices, rights, strict=True)])
    scatter = inverse @ _scatter(left, np.array(overlaps)) @ inverse
    scatter *= len(left) / (len(left) - 4)
    sigma = np.sqrt(np.maximum(inverse.diagonal(), scatter.diagonal()))
    misfit = float(np.prod([one for one in variances if one is not None]))
    return LeverArmEstimate(found[:3], sigma[:3], -found[3:], sigma[3:], len(left), misfit)


def _joined(window: LeverArmWindow, variances: Sequence[float | None]) -> tuple[Array, Array]:
    """Return the joint equations (5, 5), (5,) of positions and velocities."""
    matrix, right = np.zeros((5, 5)), np.zeros(5)
    for normal, variance, part in zip(window[:2], variances, _PARTS, strict=True):
        if normal is not None and variance is not None:
            weight = _ONCE / variance
            matrix += weight * (part.T @ normal.matrix @ part)
            right += weight * (part.T @ normal.right)
    return matrix, right


def _scatter(left: Array, overlaps: Array) -> Array:
    """Return the covariance (5, 5) of the sum of the equations' residuals (N, 5).

    ``overlaps`` (N,) marks those that share half of their values with the previous one.
    """
    later = overlaps.nonzero()[0]
    shared = left[later].T @ left[later - 1]
    return np.asarray(left.T @ left + 0.5 * (shared + shared.T))  # Bartlett's weight


def _variance(normals: Sequence[Normal | None]) -> float | None:
    """Return the variance of one value about the best fit to all windows."""
    there = [one for one in normals if one is not None]
    if len(there) < _LEAST_WINDOWS:
        return None
    matrix = np.sum([one.matrix for one in there], axis=0) + np.diag(_PRIOR[:4])
    right = np.sum([one.right for one in there], axis=0)
    squares = sum(one.squares for one in there) - float(right @ np.linalg.solve(matrix, right))
    return max(squares, 1e-12) / (sum(one.degrees for one in there) - 4)
