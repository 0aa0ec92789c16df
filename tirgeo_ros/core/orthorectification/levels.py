"""Match the grey levels of a picture to those of a mosaic that it overlaps.

An 8-bit thermal camera chooses brightness and contrast anew for each picture. Mean and standard
deviation of the picture are brought to those of the mosaic on the ground that both show, by nine
tenths of the way: the errors of many pictures then do not add up, and what the camera changes for
long is followed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.orthorectification.ground_tiles import Floats

_SHARE = 0.9
#: Fewer pixels in common say nothing; nor does a picture of one grey level.
_LEAST_PIXELS, _LEAST_SIGMA = 1000, 1.0
_MOST_GAIN = 4.0


class LevelMatch:
    """Collect pixels that a picture and a mosaic have in common, and find the picture's levels."""

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
            gain = math.exp(_SHARE * math.log(wanted / sigma))
            gain = min(max(gain, 1 / _MOST_GAIN), _MOST_GAIN)
        mean = float(means[0])
        return gain, mean + _SHARE * float(means[1] - means[0]) - gain * mean
