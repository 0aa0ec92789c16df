"""Smooth one run of the filter backwards, and hold its solutions."""

from __future__ import annotations

import bisect

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.ins.ins_error_model import ANTENNA, feedback, has_antenna
from tirgeo_ros.core.navigation.ins.strapdown import NavState, Vector
from tirgeo_ros.core.navigation.timeline.ekf import SolutionMaker, unsure_by
from tirgeo_ros.core.navigation.timeline.epochs import CORRECTED, MOVED, FlightRecord
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import NavSolution

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
        rows, columns = self._lower
        possible = np.isfinite(self._covariances).all(axis=1)
        possible &= (self._covariances[:, rows == columns] >= 0).all(axis=1)
        sound = count if possible.all() else int(np.argmin(possible))  # a filter that is lost
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
        removed = covariance @ matrices[: end - begin] @ covariance
        covariance -= 0.5 * (removed + removed.swapaxes(1, 2))
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


_ZERO: Vector = (0.0, 0.0, 0.0)


class SmoothedRun:
    """Make the smoothed solution at any IMU sample of a run; smooths the record in place."""

    def __init__(self, config: EkfConfig, record: FlightRecord) -> None:
        self._form = SolutionMaker(config)
        self._has_antenna = has_antenna(record.states)
        self._square, self._errors = record.square, smooth(record)
        # Not the record itself: its transitions and measurements are needed no more.
        self._covariances, self._kinds = record.covariances, record.kinds
        self._steps_s, self._epochs = record.steps_s, record.epochs
        self._stamps_ns, self._marks = record.stamps_ns, record.marks

    def at(self, stamp_ns: int) -> NavSolution:
        """Return the solution at an IMU sample's stamp. Raise KeyError where there is none."""
        place = bisect.bisect_left(self._stamps_ns, stamp_ns)
        if place == len(self._stamps_ns) or self._stamps_ns[place] != stamp_ns:
            raise KeyError(stamp_ns)
        numbers = self._epochs[place].tolist()
        error, covariance = self._error(self._marks[place], numbers[0])
        vectors = [tuple(numbers[at : at + 3]) for at in range(5, len(numbers), 3)]
        velocity_n, (latitude, longitude, height), gyro, accel, *rest = vectors
        rate_b, white_b, antenna_b, step = rest
        before = NavState(
            tuple(numbers[1:5]), velocity_n, latitude, longitude, height, gyro, accel, _ZERO
        )
        if self._has_antenna:
            antenna_b = tuple((error[ANTENNA] + antenna_b).tolist())
        state = feedback(before, error)
        made = self._form.made(stamp_ns, state, covariance, rate_b, white_b, antenna_b)
        return unsure_by(made, step if any(step) else ())

    def _error(self, mark: int, lag_s: float) -> tuple[Array, Array]:
        """Return the smoothed error (n,) and its covariance (n, n), ``lag_s`` after a change.

        Between the ends of a step of the covariance both are interpolated linearly.
        """
        error, lower = self._errors[mark], self._covariances[mark]
        later = mark + 1
        if lag_s and later < len(self._kinds) and self._kinds[later] == MOVED:
            share = lag_s / self._steps_s[later]
            error = error + share * (self._errors[later] - error)
            lower = lower + share * (self._covariances[later] - lower)
        return error, lower.take(self._square)
