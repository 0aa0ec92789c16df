"""Compute overlapping Allan variances of a record on a grid.

An average over ``m`` slots is compared with the average over the next ``m``: for ``m`` up to 7 at
every slot, for longer times at every quarter to seventh of the averaging time. This uses nearly
all the information of full overlap (the equivalent degrees of freedom of white noise are 3 %
fewer).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

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
    inverse_counts: Array  # (k,) mean of 1 / (samples in an average)
    variances: Array  # (k, channels)
    steps: Array  # (k, channels) mean difference from one average to the next


def allan_curve(runs: Sequence[Array]) -> AllanCurve:
    """Return the curve of runs (n, channels), NaN where a sample is missing.

    It has all averaging times that fit into a run twice; no comparison crosses a break.
    """
    longest = max(map(len, runs))
    spans = [
        (m << level, 1 << level)
        for level in range(longest.bit_length())
        for m in (_LATER if level else _FIRST)
        if 2 * (m << level) <= longest
    ]
    counts = [_total(np.isfinite(run[:, 0])) for run in runs]
    rows = np.zeros((runs[0].shape[1], len(spans), 4))
    for channel in range(len(rows)):
        # Subtract a common value, which cancels in the differences: sums of gravity lose digits.
        level = np.nanmean(runs[0][:, channel])
        sums = [_total(np.nan_to_num(run[:, channel] - level)) for run in runs]
        for row, span in enumerate(spans):
            rows[channel, row] = sum(
                _compared(*totals, *span) for totals in zip(sums, counts, strict=True)
            )
    there = rows[0, :, 0] > 0
    pairs = rows[0, there, 0]
    inverses, squares, steps = np.moveaxis(rows[:, there, 1:] / pairs[:, None], -1, 0)
    slots, strides = np.array(spans, float)[there].T
    return AllanCurve(slots, strides, pairs, inverses[0], squares.T / 2, steps.T)


def _total(values: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(values)])


def _compared(sums: Array, counts: Array, m: int, stride: int) -> Array:
    """Return (4,) number of pairs of averages, sum of 1 / count, of squared steps, of steps."""
    stops = max(len(sums) - 2 * m, 0), max(len(sums) - m, 0), len(sums)
    ends = [slice(i * m, stop, stride) for i, stop in enumerate(stops)]
    first, second = (counts[ends[i + 1]] - counts[ends[i]] for i in (0, 1))
    enough = np.minimum(first, second) >= _PRESENT * m
    first, second = first[enough], second[enough]
    before, after = ((sums[ends[i + 1]] - sums[ends[i]])[enough] for i in (0, 1))
    steps = after / second - before / first
    inverse = 0.5 * (1 / first + 1 / second).sum()
    return np.array([len(steps), inverse, steps @ steps, steps.sum()])
