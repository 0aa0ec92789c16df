"""Give each sample a slot of its own, in order, for spectra of stamps with jitter.

On a grid of even times (``SampleGrid``), stamps with a jitter of half a step put two samples into
one slot and none into the next. Here a sample follows the previous one, and only a step that
rounds to two or more leaves slots empty.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.calibration.allan.sample_grid import Piece, SampleGrid, binned
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import CalibrationError

_FEWEST = 100  # steps needed for a rate
_ALONE = 1.75  # times the median step: no sample is missing in a shorter step


class SampleRuns(SampleGrid):
    """Convert blocks of stamps and values to pieces; the first block gives the rate."""

    def __init__(self) -> None:
        super().__init__()
        self._before_ns = 0

    def _update_rate(self, stamps_ns: IntArray) -> None:
        if not self.step_ns:
            steps = np.diff(stamps_ns)
            if len(steps) < _FEWEST:
                raise CalibrationError(
                    f"{len(stamps_ns)} samples are too few to tell their rate; record longer"
                )
            self.step_ns = float(steps[steps <= _ALONE * np.median(steps)].mean())
        self._rates = (self.step_ns, 1)

    def _piece(self, stamps_ns: IntArray, values: Array, *, fresh: bool) -> Piece:
        before_ns = stamps_ns[0] - self.step_ns if fresh else self._before_ns
        self._before_ns = int(stamps_ns[-1])
        steps = np.diff(stamps_ns, prepend=before_ns) / self.step_ns
        numbers = np.maximum(np.rint(steps), 1)
        self._shaking += float(((steps - numbers) ** 2).sum())
        slots = np.cumsum(numbers).astype(np.int64) - 1
        sums, counts = binned(slots, values)
        empty = counts == 0
        self.irregularities.gaps += int((empty[1:] & ~empty[:-1]).sum() + empty[0])
        self.irregularities.missing += int(empty.sum())
        begin_ns = float(stamps_ns[0]) - float(slots[0]) * self.step_ns
        return Piece(round(begin_ns), fresh, sums, counts)
