"""Cut the pieces of a record into blocks of equal length."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tirgeo_ros.core.calibration.allan.sample_grid import Piece
from tirgeo_ros.core.types.arrays import Array


class SampleBlocks:
    """Cut consecutive slots into blocks of ``size``; drop the remainder before a break."""

    def __init__(self, size: int, step_ns: float) -> None:
        self._size = size
        self._step_s = step_ns * 1e-9
        self._rest: list[tuple[Array, Array]] = []
        self._start_s = 0.0

    def add(self, piece: Piece) -> Iterator[tuple[float, Array, Array]]:
        """Yield each block's start (s from the first sample), sums (size, channels), counts."""
        if piece.fresh or not self._rest:
            self._rest = []
            self._start_s = piece.start_ns * 1e-9
        self._rest.append((piece.sums, piece.counts))
        if sum(len(counts) for _, counts in self._rest) < self._size:
            return
        sums, counts = (np.concatenate(column) for column in zip(*self._rest, strict=True))
        whole = len(counts) // self._size * self._size
        for begin in range(0, whole, self._size):
            end = begin + self._size
            yield self._start_s + begin * self._step_s, sums[begin:end], counts[begin:end]
        self._rest = [(sums[whole:].copy(), counts[whole:].copy())]
        self._start_s += whole * self._step_s
