"""Lever arm and delays from the windows of a flight, with sigmas that their scatter tells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.checks.lever_fit import Normal
from tirgeo_ros.core.samples import Array

#: With fewer their scatter tells no sigma.
_LEAST_WINDOWS = 5
#: Of lever arm (m), delay, and what velocities are later than that (s): what is believed before,
#: so that the unseen stays at 0. A receiver measures both at once; some smooth the velocity.
_PRIOR = 1 / np.array((10.0, 10.0, 10.0, 2.0, 0.05)) ** 2
#: What the unknowns of positions and of velocities are in those.
_PARTS = np.eye(4, 5), np.eye(4, 5) + np.outer(np.eye(4)[3], np.eye(5)[4])


class Lever(NamedTuple):
    """What a flight tells."""

    lever_b: Array  # (3,) m, FRD
    lever_sigma_b: Array  # (3,)
    delays_s: Array  # (2,) stamps later than measurements; velocities by so much more
    delay_sigmas_s: Array  # (2,)
    windows: int


def solved(windows: Sequence[tuple[Normal | None, Normal | None]]) -> Lever | None:
    """Return the solution of windows' equations (positions, velocities), None of too few.

    Each sigma is the larger one of what the residuals and what the scatter from window to window
    tell (the sandwich of White, Econometrica 48, 1980): tilts err by more than white noise.
    """
    variances = [_variance([w[kind] for w in windows]) for kind in (0, 1)]
    matrices, rights = [], []
    for window in windows:
        matrix, right = np.zeros((5, 5)), np.zeros(5)
        for normal, variance, part in zip(window, variances, _PARTS, strict=True):
            if normal is not None and variance is not None:
                matrix += part.T @ normal.matrix @ part / variance
                right += part.T @ normal.right / variance
        if matrix.any():
            matrices.append(matrix)
            rights.append(right)
    if len(matrices) < _LEAST_WINDOWS:
        return None
    inverse = np.linalg.inv(sum(matrices) + np.diag(_PRIOR))
    found = inverse @ sum(rights)
    left = np.array([r - m @ found for m, r in zip(matrices, rights, strict=True)])
    scatter = inverse @ (left.T @ left) @ inverse * len(left) / (len(left) - 4)
    sigma = np.sqrt(np.maximum(inverse.diagonal(), scatter.diagonal()))
    return Lever(found[:3], sigma[:3], -found[3:], sigma[3:], len(left))


def _variance(normals: Sequence[Normal | None]) -> float | None:
    """Return the variance of one value about the best fit of all windows."""
    there = [one for one in normals if one is not None]
    if len(there) < _LEAST_WINDOWS:
        return None
    matrix = np.sum([one.matrix for one in there], axis=0) + np.diag(_PRIOR[:4])
    right = np.sum([one.right for one in there], axis=0)
    squares = sum(one.squares for one in there) - float(right @ np.linalg.solve(matrix, right))
    return max(squares, 1e-12) / (sum(one.degrees for one in there) - 4)
