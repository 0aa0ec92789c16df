"""Samples of a sensor laid on a regular grid in time, as they come from a long record.

IntArray shake, repeat, go back, and samples are missing. On a grid each slot holds the sum and the
number of the samples that fall into it, none where they are missing: averages over many slots are
then averages of the samples that exist, at their right times.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.allan.sample_rate import usual_step
from tirgeo_ros.core.types.arrays import Array, IntArray

#: A longer gap, or a clock that goes back by more than a second, splits the record.
SPLIT_NS = 10_000_000_000
_BACK_NS = 1_000_000_000


class Piece(NamedTuple):
    """Consecutive slots."""

    start_ns: int  # time of the first slot since the first sample, clock steps taken out
    fresh: bool  # nothing before it belongs to it
    sums: Array  # (n, channels)
    counts: Array  # (n,) samples in each slot


@dataclass
class Irregularities:
    """What was wrong with the stamps and the values of a record."""

    samples: int = 0  # those on the grid
    not_finite: int = 0
    repeated: int = 0  # of the same stamp as the one before
    late: int = 0  # stamped before the one before
    identical: int = 0  # the same in all channels as the one before
    gaps: int = 0  # runs of slots without a sample
    missing: int = 0  # slots more than samples, gaps that split the record apart
    splits: int = 0


class SampleGrid:
    """Turns blocks of stamps and values into pieces; the first block tells the rate."""

    def __init__(self) -> None:
        self.irregularities = Irregularities()
        self.step_ns = 0.0  # time between slots, the newest estimate
        self._begun = False
        self._shift_ns = 0  # from stamps to times since the first, steps of the clock taken out
        self._last_ns = 0  # newest stamp, shifted
        self._slot_ns = 0.0  # time of the newest slot
        self._rates = (0.0, 0)  # sum of the steps of all samples, and their number
        self._shaking = 0.0  # sum of squared distances from the grid, slots
        self._last_values: Array | None = None

    @property
    def mean_step_ns(self) -> float:
        """Mean time between samples of which none is missing."""
        total, number = self._rates
        return total / number

    @property
    def jitter_ns(self) -> float:
        """Standard deviation of the stamps about the grid."""
        return self.step_ns * math.sqrt(self._shaking / max(self.irregularities.samples, 1))

    def add(self, stamps_ns: IntArray, values: Array) -> Iterator[Piece]:
        """Pieces of samples (n,), (n, channels). Raises CalibrationError where no rate shows."""
        stamps_ns, values = self._sound(stamps_ns, values)
        if not len(stamps_ns):
            return
        first = not self._begun
        steps_ns = np.diff(stamps_ns, prepend=stamps_ns[0] if first else self._last_ns)
        self._begun = True
        self._last_ns = int(stamps_ns[-1])
        self._tell_rate(stamps_ns)
        cuts = np.flatnonzero(steps_ns > SPLIT_NS)
        self.irregularities.splits += len(cuts)
        edges = [0, *cuts.tolist(), len(stamps_ns)]
        for number, (begin, end) in enumerate(pairwise(edges)):
            if end > begin:
                fresh = first or number > 0
                yield self._piece(stamps_ns[begin:end], values[begin:end], fresh=fresh)

    def _sound(self, stamps_ns: IntArray, values: Array) -> tuple[IntArray, Array]:
        """Samples with finite values and rising stamps, steps of the clock taken out."""
        told = self.irregularities
        finite = np.isfinite(values).all(axis=1)
        told.not_finite += int((~finite).sum())
        stamps_ns, values = stamps_ns[finite], values[finite]
        if not len(stamps_ns):
            return stamps_ns, values
        self._count_identical(values)
        stamps_ns = self._without_clock_steps(stamps_ns)
        before = np.maximum.accumulate(stamps_ns)
        first = self._last_ns if self._begun else stamps_ns[0] - 1
        before = np.concatenate([[first], np.maximum(before[:-1], first)])
        told.repeated += int((stamps_ns == before).sum())
        told.late += int((stamps_ns < before).sum())
        rising = stamps_ns > before
        told.samples += int(rising.sum())
        return stamps_ns[rising], values[rising]

    def _without_clock_steps(self, stamps_ns: IntArray) -> IntArray:
        if not self._begun:
            self._shift_ns = -int(stamps_ns[0])  # small numbers, which floats hold to a nanosecond
        shifted = stamps_ns + self._shift_ns
        start = self._last_ns if self._begun else shifted[0]
        steps = np.diff(shifted, prepend=start)
        back = steps < -_BACK_NS
        if not back.any():
            return shifted
        shifts = np.cumsum(np.where(back, SPLIT_NS + 1 - steps, 0))
        self._shift_ns += int(shifts[-1])
        return np.asarray(shifted + shifts)

    def _count_identical(self, values: Array) -> None:
        if self._last_values is not None:
            self.irregularities.identical += int((values[0] == self._last_values).all())
        self.irregularities.identical += int((values[1:] == values[:-1]).all(axis=1).sum())
        self._last_values = values[-1].copy()

    def _tell_rate(self, stamps_ns: IntArray) -> None:
        self.step_ns = usual_step(stamps_ns, self.step_ns, SPLIT_NS)
        total, number = self._rates
        self._rates = (total + self.step_ns * len(stamps_ns), number + len(stamps_ns))

    def _piece(self, stamps_ns: IntArray, values: Array, *, fresh: bool) -> Piece:
        start_ns = float(stamps_ns[0]) if fresh else self._slot_ns
        times = (stamps_ns - start_ns) / self.step_ns
        # The grid lies where most stamps do, whatever the shaking of the one it begins with.
        phase = float(np.angle(np.exp(2j * np.pi * times).mean())) / math.tau
        slots = np.rint(times - phase).astype(np.int64)
        self._shaking += float(((times - phase - slots) ** 2).sum())
        lowest = int(slots[0]) if fresh else 1
        slots = np.maximum(slots, lowest) - lowest
        sums, counts = binned(slots, values)
        empty = counts == 0
        self.irregularities.gaps += int((empty[1:] & ~empty[:-1]).sum() + empty[0])
        self.irregularities.missing += max(len(counts) - len(values), 0)
        self._slot_ns = start_ns + (lowest + phase + int(slots[-1])) * self.step_ns
        begin_ns = start_ns + (lowest + phase) * self.step_ns
        return Piece(round(begin_ns), fresh, sums, counts)


def binned(slots: IntArray, values: Array) -> tuple[Array, Array]:
    """Sums (n, channels) and numbers (n,) of the samples in each slot; ``slots`` does not fall."""
    size = int(slots[-1]) + 1
    if size == len(slots):  # each slot once, as ``slots`` does not fall
        counts = np.bincount(slots, minlength=size)
        if (counts == 1).all():
            return values, np.ones(size)
    counts = np.bincount(slots, minlength=size)
    sums = [np.bincount(slots, channel, minlength=size) for channel in values.T]
    return np.stack(sums, axis=1), counts.astype(float)
