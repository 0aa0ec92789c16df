"""Blend the views of a tile: the best one on top, feathered where another one becomes better.

The value of a pixel is the mean of all views with the weights (best score / score)^32. A view
with a score 10 % worse than the best has a weight of 5 %, one 15 % worse 1 %: only near a seam,
where two views are equally good, do both count. In the rim of a picture the seam is an eighth of
the rim wide. The sums are kept relative to the best score so far, so that the order of the
pictures does not matter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.orthorectification.frame_view import Patch
from tirgeo_ros.core.orthorectification.ground_tiles import TILE_PX, Floats
from tirgeo_ros.core.types.arrays import BoolArray, RawPixels

_SQUARINGS = 5  # (best / score) to the power of 2^5
_LEVELS_SHARE = 0.9
#: Fewer pixels in common say nothing; nor does a picture of one grey level.
_LEAST_PIXELS, _LEAST_SIGMA = 1000, 1.0
_MOST_GAIN = 4.0


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


class LevelMatch:
    """Collect pixels that a picture and a mosaic have in common, and find the picture's levels.

    An 8-bit thermal camera chooses brightness and contrast anew for each picture. Mean and
    standard deviation of the picture are brought to those of the mosaic on the ground that both
    show, by nine tenths of the way: the errors of many pictures then do not add up, and what the
    camera changes for long is followed.
    """

    def __init__(self) -> None:
        self._count, self._sums = 0, np.zeros((2, 2))  # of values and squares; picture, mosaic

    def add(self, picture: npt.NDArray[Any], mosaic: npt.NDArray[Any]) -> None:
        """Add values of the same places, in arrays of one size."""
        for row, values in enumerate((picture, mosaic)):
            exact = values.astype(float)
            self._sums[row] += exact.sum(), np.square(exact).sum()
        self._count += picture.size

    def matched(self, values: npt.NDArray[Any]) -> Floats:
        """Return values of the picture as they are in the mosaic."""
        gain, offset = self._levels()
        return (values * np.float32(gain) + np.float32(offset)).astype(np.float32)

    def _levels(self) -> tuple[float, float]:
        if self._count < _LEAST_PIXELS:
            return 1.0, 0.0
        means, squares = (self._sums / self._count).T
        sigma, wanted = np.sqrt(np.maximum(squares - means**2, 0.0)).tolist()
        gain = 1.0
        if min(sigma, wanted) >= _LEAST_SIGMA:
            gain = math.exp(_LEVELS_SHARE * math.log(wanted / sigma))
            gain = min(max(gain, 1 / _MOST_GAIN), _MOST_GAIN)
        mean = float(means[0])
        return gain, mean + _LEVELS_SHARE * float(means[1] - means[0]) - gain * mean
