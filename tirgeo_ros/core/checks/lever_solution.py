"""Lever arm and delays from the windows of a flight, with sigmas that their scatter tells."""

from __future__ import annotations

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
_NOTHING = Normal(np.zeros((4, 4)), np.zeros(4), 0.0, 0)


class Lever(NamedTuple):
    """What a flight tells."""

    lever_b: Array  # (3,) m, FRD
    lever_sigma_b: Array  # (3,)
    delays_s: Array  # (2,) stamps later than measurements; velocities by so much more
    delay_sigmas_s: Array  # (2,)
    windows: int


class Windows:
    """The newest windows' equations, of positions (0) and of velocities (1).

    In arrays that are made once, 50 kB: as objects 150 windows took 170 kB of a node's memory, a
    bit more with each of the first ten minutes of a flight. What there is none of is zero.
    """

    def __init__(self, most: int) -> None:
        self._number = 0
        # Zeros that are written: those of np.zeros take memory when they are touched.
        self.matrices = np.full((most, 2, 4, 4), 0.0)
        self.rights = np.full((most, 2, 4), 0.0)
        self.squares = np.full((most, 2), 0.0)
        self.degrees = np.full((most, 2), 0)

    def add(self, positions: Normal | None, velocities: Normal | None) -> None:
        """Take a window in the place of the oldest."""
        at = self._number % len(self.degrees)
        self._number += 1
        for kind, normal in enumerate((positions, velocities)):
            given = _NOTHING if normal is None else normal
            self.matrices[at, kind], self.rights[at, kind] = given.matrix, given.right
            self.squares[at, kind], self.degrees[at, kind] = given.squares, given.degrees


def solved(windows: Windows) -> Lever | None:
    """Return the solution of windows' equations, None of too few.

    Each sigma is the larger one of what the residuals and what the scatter from window to window
    tell (the sandwich of White, Econometrica 48, 1980): tilts err by more than white noise.
    """
    most = len(windows.degrees)
    matrices, rights = np.zeros((most, 5, 5)), np.zeros((most, 5))
    for kind, part in enumerate(_PARTS):
        variance = _variance(windows, kind)
        if variance is not None:
            matrices += part.T @ windows.matrices[:, kind] @ part / variance
            rights += windows.rights[:, kind] @ part / variance
    there = matrices.any(axis=(1, 2))
    number = int(there.sum())
    if number < _LEAST_WINDOWS:
        return None
    inverse = np.linalg.inv(matrices.sum(axis=0) + np.diag(_PRIOR))
    found = inverse @ rights.sum(axis=0)
    left = (rights - matrices @ found)[there]
    scatter = inverse @ (left.T @ left) @ inverse * number / (number - 4)
    sigma = np.sqrt(np.maximum(inverse.diagonal(), scatter.diagonal()))
    return Lever(found[:3], sigma[:3], -found[3:], sigma[3:], number)


def _variance(windows: Windows, kind: int) -> float | None:
    """Return the variance of one value about the best fit of all windows."""
    degrees = windows.degrees[:, kind]
    if np.count_nonzero(degrees) < _LEAST_WINDOWS:
        return None
    matrix = windows.matrices[:, kind].sum(axis=0) + np.diag(_PRIOR[:4])
    right = windows.rights[:, kind].sum(axis=0)
    squares = float(windows.squares[:, kind].sum() - right @ np.linalg.solve(matrix, right))
    return max(squares, 1e-12) / (int(degrees.sum()) - 4)
