"""Note each change of the filter's covariance, so that a smoother can go back through them.

A mark leads to the one before it, as the filter's states do: where a late measurement makes the
filter compute again, new marks continue from the state that it goes back to, and the old ones are
forgotten with the states that they led to.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array


class Correction(NamedTuple):
    """Hold a Kalman update by its measurement (m rows)."""

    design: Array  # (m, n) H
    weight: Array  # (m, m) inverse of the innovation's covariance
    innovation: Array  # (m,)


class Change(NamedTuple):
    """Hold one step of the covariance of the error states.

    The error after it is ``transition @ error`` plus noise (None: identity), or the update by
    ``correction``.
    """

    covariance: Array  # (n, n) after it
    transition: Array | None = None  # (n, n)
    correction: Correction | None = None
    step_s: float = 0.0  # length of a propagation


@dataclass(slots=True, eq=False)
class Mark:
    """Hold a change, and the way to the one before it."""

    change: Change
    before: Mark | None = None
    number: int = -1  # its place in the record, once it is there

    def followed_by(self, changes: Iterable[Change]) -> Mark:
        """Return the last of the marks of further changes."""
        newest = self
        for change in changes:
            newest = Mark(change, newest)
        return newest


def cut(states: int, *blocks: slice) -> Array:
    """Return the transition (states, states) that discards the errors of some states."""
    transition = np.eye(states)
    for block in blocks:
        transition[block, :] = 0.0
    return transition
