"""Smooth the errors of one run: a fixed-interval smoother in the modified Bryson-Frazier form.

What later measurements say of the error at an instant is a vector ``l`` and a matrix ``L``, so
that the smoothed error is ``P l`` and its covariance ``P - P L P``, with the filter's covariance
``P``. Backwards through the filter's changes, with ``S`` the innovation's covariance, ``y`` the
innovation, ``A = I - P H^T S^-1 H`` and ``P`` from before the update:

========================  =============================  =====================================
propagation or reset F    ``l <- F^T l``                 ``L <- F^T L F``
update                    ``l <- H^T S^-1 y + A^T l``    ``L <- H^T S^-1 H + A^T L A``
larger uncertainty        ``l``                          ``L``
========================  =============================  =====================================

(G. J. Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973),
65-75.) No covariance is inverted, so one that is nearly singular does no harm. A reset discards
what the filter knew of some states; so nothing that comes later says anything of them before it.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.navigation.smoothing.flight_record import CORRECTED, MOVED, FlightRecord
from tirgeo_ros.core.types.arrays import Array

#: Changes that are computed together: their matrices take 20 MB.
_BLOCK = 4096


def smooth(record: FlightRecord) -> Array:
    """Return the smoothed errors (changes, n) of the state after each change of a run.

    The record's covariances are replaced by those of the smoothed errors.
    """
    return _BackwardPass(record).smoothed()


class _BackwardPass:
    """Go back through a record."""

    def __init__(self, record: FlightRecord) -> None:
        n = record.states
        self._lower, self._square = record.lower, record.square
        self._covariances = record.covariances
        self._transitions, self._corrections = record.transitions, record.corrections
        self._kinds = np.frombuffer(record.kinds, np.int8)
        moved, corrected = self._kinds == MOVED, self._kinds == CORRECTED
        self._places = np.where(moved, np.cumsum(moved), np.cumsum(corrected)) - 1
        self._vector, self._matrix = np.zeros(n), np.zeros((n, n))

    def smoothed(self) -> Array:
        """Return the smoothed errors (changes, n)."""
        count, n = len(self._covariances), len(self._vector)
        finite = np.isfinite(self._covariances).all(axis=1)
        sound = count if finite.all() else int(np.argmin(finite))  # a filter that is lost
        errors = np.zeros((count, n))
        vectors, matrices = np.zeros((_BLOCK, n)), np.zeros((_BLOCK, n, n))
        for begin in reversed(range(0, sound, _BLOCK)):
            end = min(begin + _BLOCK, sound)
            for number in reversed(range(begin, end)):
                vectors[number - begin] = self._vector
                matrices[number - begin] = self._matrix
                self._step_back(number)
            errors[begin:end] = self._finished(begin, end, vectors, matrices)
        return errors

    def _finished(self, begin: int, end: int, vectors: Array, matrices: Array) -> Array:
        """Replace the covariances of some changes; return their smoothed errors."""
        covariance = self._covariances[begin:end][:, self._square]
        known = covariance @ matrices[: end - begin] @ covariance
        covariance -= 0.5 * (known + known.swapaxes(1, 2))
        errors = self._covariances[begin:end][:, self._square] @ vectors[: end - begin, :, None]
        self._covariances[begin:end] = covariance[:, self._lower[0], self._lower[1]]
        return np.asarray(errors[:, :, 0])

    def _step_back(self, number: int) -> None:
        """Go from after a change to before it."""
        kind, place = self._kinds[number], self._places[number]
        if kind == MOVED:
            back = self._transitions[place].T
            self._vector = back.dot(self._vector)
            self._matrix = back.dot(self._matrix).dot(back.T)
        elif kind == CORRECTED:
            self._uncorrect(number - 1, self._corrections[place])

    def _uncorrect(self, before: int, whitened: Array) -> None:
        """Go back through an update; with a weight of identity ``A = I - (H P)^T H``."""
        design, innovation = whitened[:, :-1], whitened[:, -1]
        cross = design.dot(self._covariances[before].take(self._square))
        self._vector = self._vector + design.T.dot(innovation - cross.dot(self._vector))
        half = self._matrix - self._matrix.dot(cross.T).dot(design)
        matrix = half + design.T.dot(design - cross.dot(half))
        self._matrix = 0.5 * (matrix + matrix.T)
