"""Place a sensor's samples on a regular grid in time, block by block from a long record.

Time stamps have jitter, repeat and go back, and samples are missing. On the grid each slot holds
the sum and the number of the samples that fall into it, zero where they are missing. Averages over
many slots are then averages of the existing samples, at their right times.
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

#: A longer gap splits the record; so does a clock that goes back by more than _BACK_NS.
SPLIT_NS = 10_000_000_000
_BACK_NS = 1_000_000_000


class Piece(NamedTuple):
    """Hold consecutive slots."""

    start_ns: int  # time of the first slot from the first sample, without clock steps
    fresh: bool  # whether it does not continue the previous piece
    sums: Array  # (n, channels)
    counts: Array  # (n,) number of samples in each slot


@dataclass
class Irregularities:
    """Count the faults of a record's stamps and values."""

    samples: int = 0  # placed on the grid
    not_finite: int = 0
    repeated: int = 0  # with the stamp of the previous one
    late: int = 0  # stamped before the previous one
    identical: int = 0  # equal to the previous one in all channels
    gaps: int = 0  # runs of slots without a sample
    missing: int = 0  # slots without a sample, not counting gaps that split the record
    splits: int = 0


class SampleGrid:
    """Convert blocks of stamps and values to pieces; the first block gives the rate."""

    def __init__(self) -> None:
        self.irregularities = Irregularities()
        self.step_ns = 0.0  # time between slots, newest estimate
        self._begun = False
        self._shift_ns = 0  # from stamps to times from the first one, without clock steps
        self._last_ns = 0  # newest stamp, shifted
        self._slot_ns = 0.0  # time of the newest slot
        self._rates = (0.0, 0)  # sum of the steps of all samples, and their number
        self._shaking = 0.0  # sum of squared distances from the grid, slots
        self._last_values: Array | None = None

    @property
    def mean_step_ns(self) -> float:
        """Return the mean time between samples where none is missing, ns."""
        total, number = self._rates
        return total / number

    @property
    def jitter_ns(self) -> float:
        """Return the standard deviation of the stamps about the grid, ns."""
        return self.step_ns * math.sqrt(self._shaking / max(self.irregularities.samples, 1))

    def add(self, stamps_ns: IntArray, values: Array) -> Iterator[Piece]:
        """Yield pieces of samples (n,), (n, channels). Raises CalibrationError without a rate."""
        stamps_ns, values = self._sound(stamps_ns, values)
        if not len(stamps_ns):
            return
        first = not self._begun
        steps_ns = np.diff(stamps_ns, prepend=stamps_ns[0] if first else self._last_ns)
        self._begun = True
        self._last_ns = int(stamps_ns[-1])
        self._update_rate(stamps_ns)
        cuts = np.flatnonzero(steps_ns > SPLIT_NS)
        self.irregularities.splits += len(cuts)
        edges = [0, *cuts.tolist(), len(stamps_ns)]
        for number, (begin, end) in enumerate(pairwise(edges)):
            if end > begin:
                fresh = first or number > 0
                yield self._piece(stamps_ns[begin:end], values[begin:end], fresh=fresh)

    def _sound(self, stamps_ns: IntArray, values: Array) -> tuple[IntArray, Array]:
        """Return the samples with finite values and rising stamps, without clock steps."""
        faults = self.irregularities
        finite = np.isfinite(values).all(axis=1)
        faults.not_finite += int((~finite).sum())
        stamps_ns, values = stamps_ns[finite], values[finite]
        if not len(stamps_ns):
            return stamps_ns, values
        self._count_identical(values)
        stamps_ns = self._without_clock_steps(stamps_ns)
        before = np.maximum.accumulate(stamps_ns)
        first = self._last_ns if self._begun else stamps_ns[0] - 1
        before = np.concatenate([[first], np.maximum(before[:-1], first)])
        faults.repeated += int((stamps_ns == before).sum())
        faults.late += int((stamps_ns < before).sum())
        rising = stamps_ns > before
        faults.samples += int(rising.sum())
        return stamps_ns[rising], values[rising]

    def _without_clock_steps(self, stamps_ns: IntArray) -> IntArray:
        if not self._begun:
            self._shift_ns = -int(stamps_ns[0])  # small numbers, exact to a nanosecond in floats
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

    def _update_rate(self, stamps_ns: IntArray) -> None:
        self.step_ns = usual_step(stamps_ns, self.step_ns, SPLIT_NS)
        total, number = self._rates
        self._rates = (total + self.step_ns * len(stamps_ns), number + len(stamps_ns))

    def _piece(self, stamps_ns: IntArray, values: Array, *, fresh: bool) -> Piece:
        start_ns = float(stamps_ns[0]) if fresh else self._slot_ns
        times = (stamps_ns - start_ns) / self.step_ns
        # The grid's phase is that of most stamps, whatever the jitter of the first one.
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
    """Return sums (n, channels) and numbers (n,) of samples by slot; ``slots`` must not fall."""
    size = int(slots[-1]) + 1
    if size == len(slots):  # perhaps each slot once
        counts = np.bincount(slots, minlength=size)
        if (counts == 1).all():
            return values, np.ones(size)
    counts = np.bincount(slots, minlength=size)
    sums = [np.bincount(slots, channel, minlength=size) for channel in values.T]
    return np.stack(sums, axis=1), counts.astype(float)
