"""Blend the views of a tile: the best one on top, feathered where another one becomes better.

The value of a pixel is the mean of all views with the weights (best score / score)^32. A view
with a score 10 % worse than the best has a weight of 5 %, one 15 % worse 1 %: only near a seam,
where two views are equally good, do both count. In the rim of a picture the seam is an eighth of
the rim wide. The sums are kept relative to the best score so far, so that the order of the
pictures does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.orthorectification.frame_view import Patch
from tirgeo_ros.core.orthorectification.ground_tiles import TILE_PX, Floats
from tirgeo_ros.core.types.arrays import BoolArray, RawPixels

_SQUARINGS = 5  # (best / score) to the power of 2^5


@dataclass(frozen=True)
class MosaicTile:
    """Hold sums over the views of a tile: of weighted values, of weights, and the best score."""

    total: Floats  # (TILE_PX, TILE_PX, bands)
    weight: Floats  # (TILE_PX, TILE_PX); 0 where nothing was seen
    best: Floats  # (TILE_PX, TILE_PX); inf where nothing was seen

    @classmethod
    def empty(cls, bands: int) -> MosaicTile:
        """Return a tile that nobody has seen."""
        size = TILE_PX, TILE_PX
        total, weight = np.zeros((*size, bands), np.float32), np.zeros(size, np.float32)
        return cls(total, weight, np.full(size, np.inf, np.float32))

    def add(self, patch: Patch, *, hard: bool = False) -> None:
        """Blend a view in; ``hard``: the best view alone counts, and values stay as they are."""
        box = patch.rows, patch.columns
        values = patch.values.reshape(*patch.seen.shape, -1)
        if hard:
            better = patch.score < self.best[box]
            self.total[box][better], self.weight[box][better] = values[better], 1.0
        else:
            self._blend(patch, values[patch.seen])
        self.best[box] = np.minimum(self.best[box], patch.score)

    def _blend(self, patch: Patch, values: Floats) -> None:
        box, seen = (patch.rows, patch.columns), patch.seen
        former, score = self.best[box][seen], patch.score[seen]
        best: Floats = np.minimum(former, score)
        kept, weight = _weight(best, former), _weight(best, score)
        self.weight[box][seen] = kept * self.weight[box][seen] + weight
        former_total = self.total[box][seen]
        self.total[box][seen] = kept[:, None] * former_total + weight[:, None] * values

    def common(self, patch: Patch) -> tuple[RawPixels, Floats]:
        """Return values (n, bands) of a view, and the mosaic's, where there are both."""
        box = patch.rows, patch.columns
        both = patch.seen & (self.weight[box] > 0)
        values = patch.values.reshape(*patch.seen.shape, -1)
        return values[both], self.total[box][both] / self.weight[box][both][:, None]

    def values(self) -> tuple[Floats, BoolArray]:
        """Return the mosaic (TILE_PX, TILE_PX, bands), and which of its pixels were seen."""
        # The best view alone has the weight 1.
        values = self.total / np.maximum(self.weight, np.float32(1))[..., None]
        return np.asarray(values, np.float32), self.weight > 0


def _weight(best: Floats, score: Floats) -> Floats:
    """Return the weights of scores relative to the best ones."""
    weight: Floats = best / score
    for _ in range(_SQUARINGS):
        weight *= weight
    return weight
