"""Solve the windows of a flight for lever arm and delays, with sigmas from their scatter.

Each window begins in the middle of the previous one, so each value is in two windows and counts
half.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.checks.lever_arm_equations import Normal
from tirgeo_ros.core.types.arrays import Array

#: With fewer windows their scatter gives no useful sigma.
_LEAST_WINDOWS = 6
_ONCE = 0.5  # weight of a value that is in two windows
#: Prior information for the lever arm (m), the delay (s), and the velocities' extra delay (s). It
#: keeps unobservable unknowns at 0. A receiver measures both at once; some smooth the velocity.
_PRIOR = 1 / np.array((10.0, 10.0, 10.0, 2.0, 0.05)) ** 2
#: Maps these five unknowns to the four of positions and to the four of velocities.
_PARTS = np.eye(4, 5), np.eye(4, 5) + np.outer(np.eye(4)[3], np.eye(5)[4])


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
