"""Compute overlapping Allan variances of a record on a grid, at averaging times in octaves.

An average over ``m`` slots is compared with the average over the next ``m``, at every slot for
``m`` up to 4 and at every quarter of the averaging time beyond. This uses nearly all the
information of full overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array

#: An average is used if at least this share of its samples is present.
_PRESENT = 0.75
#: Longer averages, relative to the record, have too few neighbours to be useful.
_LONGEST = 0.25


class AllanCurve(NamedTuple):
    """Hold overlapping Allan variances over increasing averaging times."""

    tau_s: Array  # (k,) averaging times
    degrees: Array  # (k,) equivalent degrees of freedom
    white: Array  # (k,) variances of white noise with N = 1: mean of 1 / (sampled time), 1/s
    variances: Array  # (k, channels)
    span_s: float  # length of the longest comparison of averages


def allan_curve(runs: Sequence[Array], step_s: float, ramps: Array | None = None) -> AllanCurve:
    """Return the curve of runs (n, channels), NaN where a sample is missing.

    No comparison crosses a break. ``ramps`` (channels,), unit/s, are steady drifts to remove. The
    degrees of freedom are those of flicker noise (Lesage and Audoin, NIST SP 1065, table 5), which
    are between those of white noise and of a random walk.
    """
    longest = max(map(len, runs))
    sizes = [1 << level for level in range(longest.bit_length()) if 2 << level <= longest]
    slopes = np.zeros(runs[0].shape[1]) if ramps is None else ramps * step_s
    counts = [_total(np.isfinite(run[:, 0])) for run in runs]
    sums = np.zeros((len(sizes), len(slopes), 3))
    for channel, slope in enumerate(slopes.tolist()):
        # Subtract a common value, which cancels in the differences: sums of gravity lose digits.
        level = np.nanmean(runs[0][:, channel])
        for run, count in zip(runs, counts, strict=True):
            values = run[:, channel] - level
            values -= slope * np.arange(len(run))
            total = _total(np.nan_to_num(values, copy=False))
            sums[:, channel] += [_compared(total, count, size) for size in sizes]
    there = sums[:, 0, 0] > 0
    m, pairs = np.array(sizes, float)[there], sums[there, 0, 0]
    spans = (pairs - 1) * np.maximum(m // 4, 1) + 2 * m
    used = m <= _LONGEST * spans
    degrees = np.maximum(1.25 * spans**2 / (m * (spans + 3 * m)), 1.0)
    means = sums[there] / pairs[:, None, None]
    return AllanCurve(
        (m * step_s)[used],
        degrees[used],
        means[used, 0, 1] / step_s,
        means[used, :, 2] / 2,
        float(spans.max(initial=0.0)) * step_s,
    )


def _total(values: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(values)])


def _compared(sums: Array, counts: Array, m: int) -> tuple[int, float, float]:
    """Return the number of pairs of averages, the sums of 1 / count and of squared steps."""
    stride = max(m // 4, 1)
    stops = max(len(sums) - 2 * m, 0), max(len(sums) - m, 0), len(sums)
    ends = [slice(i * m, stop, stride) for i, stop in enumerate(stops)]
    first, second = (counts[ends[i + 1]] - counts[ends[i]] for i in (0, 1))
    enough = np.minimum(first, second) >= _PRESENT * m
    first, second = first[enough], second[enough]
    before, after = ((sums[ends[i + 1]] - sums[ends[i]])[enough] for i in (0, 1))
    steps = after / second - before / first
    return len(steps), float(0.5 * (1 / first + 1 / second).sum()), float(steps @ steps)
