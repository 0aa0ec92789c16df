"""Lever arm and delays from the windows of a flight, with sigmas that their scatter tells.

Each window begins in the middle of the one before: its values are in two windows, and count half.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.checks.lever_fit import Normal
from tirgeo_ros.core.types.arrays import Array

#: With fewer their scatter tells no sigma.
_LEAST_WINDOWS = 6
_ONCE = 0.5  # of what is in two windows
#: Of lever arm (m), delay, and what velocities are later than that (s): what is believed before,
#: so that the unseen stays at 0. A receiver measures both at once; some smooth the velocity.
_PRIOR = 1 / np.array((10.0, 10.0, 10.0, 2.0, 0.05)) ** 2
#: What the unknowns of positions and of velocities are in those.
_PARTS = np.eye(4, 5), np.eye(4, 5) + np.outer(np.eye(4)[3], np.eye(5)[4])


class Window(NamedTuple):
    """Equations of a window, where there are any."""

    positions: Normal | None
    velocities: Normal | None
    overlaps: bool  # whether it begins in the middle of the one before


class Lever(NamedTuple):
    """What a flight tells."""

    lever_b: Array  # (3,) m, FRD
    lever_sigma_b: Array  # (3,)
    delays_s: Array  # (2,) stamps later than measurements; velocities by so much more
    delay_sigmas_s: Array  # (2,)
    windows: int
    misfit: float  # variances of the residuals of positions and of velocities, multiplied


def solved(windows: Sequence[Window]) -> Lever | None:
    """Return the solution of consecutive windows, None of too few.

    Each sigma is the larger one of what the residuals and what the scatter from window to window
    tell: tilts err by more than white noise. The scatter is the sandwich of White (Econometrica
    48, 1980), with neighbours that overlap as Newey and West have it (Econometrica 55, 1987).
    """
    variances = [_variance(normals) for normals in zip(*(w[:2] for w in windows), strict=True)]
    matrices, rights, overlaps = [], [], []
    before = False  # whether the window before tells anything
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
    return Lever(found[:3], sigma[:3], -found[3:], sigma[3:], len(left), misfit)


def _joined(window: Window, variances: Sequence[float | None]) -> tuple[Array, Array]:
    """Return the equations (5, 5), (5,) of positions and velocities together."""
    matrix, right = np.zeros((5, 5)), np.zeros(5)
    for normal, variance, part in zip(window[:2], variances, _PARTS, strict=True):
        if normal is not None and variance is not None:
            weight = _ONCE / variance
            matrix += weight * (part.T @ normal.matrix @ part)
            right += weight * (part.T @ normal.right)
    return matrix, right


def _scatter(left: Array, overlaps: Array) -> Array:
    """Return the covariance (5, 5) of the sum of what equations (N, 5) have left.

    ``overlaps`` (N,) are those that share half of their values with the one before.
    """
    later = overlaps.nonzero()[0]
    shared = left[later].T @ left[later - 1]
    return np.asarray(left.T @ left + 0.5 * (shared + shared.T))  # Bartlett's weight


def _variance(normals: Sequence[Normal | None]) -> float | None:
    """Return the variance of one value about the best fit of all windows."""
    there = [one for one in normals if one is not None]
    if len(there) < _LEAST_WINDOWS:
        return None
    matrix = np.sum([one.matrix for one in there], axis=0) + np.diag(_PRIOR[:4])
    right = np.sum([one.right for one in there], axis=0)
    squares = sum(one.squares for one in there) - float(right @ np.linalg.solve(matrix, right))
    return max(squares, 1e-12) / (sum(one.degrees for one in there) - 4)
