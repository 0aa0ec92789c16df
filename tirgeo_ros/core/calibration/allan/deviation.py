"""Compute overlapping Allan variances of records of any length, in bounded memory.

An average over ``m`` slots is compared with the average over the next ``m``. For ``m`` up to 7
this is done at every slot. For longer times the record is halved again and again by adding
neighbours, and ``m`` is 4 to 7 slots of such a level, compared at every one of them. The stride is
then a quarter to a seventh of the averaging time. This uses nearly all the information of full
overlap (the equivalent degrees of freedom of white noise are 3 % fewer) and costs one more pass
in total.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.allan.sample_grid import Piece
from tirgeo_ros.core.types.arrays import Array

_FIRST = (1, 2, 3, 4, 5, 6, 7)
_LATER = _FIRST[3:]
#: An average is used if at least this share of its samples is present.
_PRESENT = 0.75


class AllanCurve(NamedTuple):
    """Hold overlapping Allan variances over increasing averaging times."""

    slots: Array  # (k,) averaging times, in slots
    strides: Array  # (k,) slots between comparisons
    pairs: Array  # (k,) number of comparisons
    variances: Array  # (k, channels)
    inverse_counts: Array  # (k,) mean of 1 / (samples in an average)
    steps: Array  # (k, channels) mean difference from one average to the next


class AllanStream:
    """Accumulate the pieces of a record one after another."""

    def __init__(self) -> None:
        self._levels = [_Level(0)]

    def add(self, piece: Piece) -> None:
        """Add consecutive slots."""
        if piece.fresh:
            for level in self._levels:
                level.restart()
        sums, counts = piece.sums, piece.counts
        number = 0
        while len(counts):
            if number == len(self._levels):
                self._levels.append(_Level(number))
            sums, counts = self._levels[number].add(sums, counts)
            number += 1

    def curve(self) -> AllanCurve:
        """Return the curve so far, at all averaging times that fit into the record twice."""
        rows = [row for level in self._levels for row in level.rows()]
        columns = zip(*rows, strict=True)
        return AllanCurve(*(np.array(column, float) for column in columns))


@dataclass
class _Sums:
    """Hold sums over the comparisons at one averaging time."""

    pairs: int = 0
    squares: Array | None = None  # (channels,)
    inverses: float = 0.0
    steps: Array | None = None  # (channels,)


@dataclass
class _Level:
    """Accumulate the record in sums over ``2 ** number`` slots."""

    number: int
    _found: dict[int, _Sums] = field(default_factory=dict)
    _sums: Array | None = None  # the newest slots, with which later ones are compared
    _counts: Array = field(default_factory=lambda: np.zeros(0))
    _odd: int = 0  # number of these that are not in the next level yet

    def restart(self) -> None:
        """Forget the slots so far, so that later ones are not compared with them."""
        self._sums, self._counts, self._odd = None, np.zeros(0), 0

    def add(self, sums: Array, counts: Array) -> tuple[Array, Array]:
        """Add slots (n, channels), (n,); return the slots that they make for the next level."""
        old = len(self._counts)
        if self._sums is not None:
            sums = np.concatenate([self._sums, sums])
        counts = np.concatenate([self._counts, counts])
        total = np.zeros((len(sums) + 1, sums.shape[1]))
        # Subtract a common value, which cancels in the differences: sums of gravity lose digits.
        level = sums.sum(axis=0) / max(counts.sum(), 1.0)
        np.cumsum(sums - counts[:, None] * level, axis=0, out=total[1:])
        present = np.concatenate([[0.0], np.cumsum(counts)])
        for m in _LATER if self.number else _FIRST:
            self._compare(m, max(old - 2 * m + 1, 0), total, present)
        begin = old - self._odd
        even = begin + (len(counts) - begin) // 2 * 2
        keep = 2 * _FIRST[-1]
        self._odd = len(counts) - even
        self._sums, self._counts = sums[-keep:].copy(), counts[-keep:].copy()
        return (
            sums[begin:even:2] + sums[begin + 1 : even : 2],
            counts[begin:even:2] + counts[begin + 1 : even : 2],
        )

    def _compare(self, m: int, start: int, total: Array, present: Array) -> None:
        """Add the comparisons of averages over ``m`` slots, from slot ``start`` on."""
        if len(total) - 1 - start < 2 * m:
            return
        counts = present[start + m :] - present[start:-m]
        enough = counts >= _PRESENT * m * 2**self.number
        usable = enough[:-m] & enough[m:]
        inverse = 1 / np.maximum(counts, 1.0)
        averages = total[start + m :] - total[start:-m]
        averages *= inverse[:, None]
        steps = averages[m:] - averages[:-m]
        if not usable.all():
            steps, inverse = steps[usable], 0.5 * (inverse[m:] + inverse[:-m])[usable]
        found = self._found.setdefault(m, _Sums())
        squares = np.einsum("ij,ij->j", steps, steps)
        sums = steps.sum(axis=0)
        found.squares = squares if found.squares is None else found.squares + squares
        found.steps = sums if found.steps is None else found.steps + sums
        found.inverses += float(inverse.mean()) * len(steps) if len(steps) else 0.0
        found.pairs += len(steps)

    def rows(self) -> list[tuple[int, int, int, Array, float, Array]]:
        """Return the rows of ``AllanCurve``, one for each averaging time."""
        stride = 2**self.number
        return [
            (
                m * stride,
                stride,
                s.pairs,
                s.squares / (2 * s.pairs),
                s.inverses / s.pairs,
                s.steps / s.pairs,
            )
            for m, s in sorted(self._found.items())
            if s.pairs and s.squares is not None and s.steps is not None
        ]
