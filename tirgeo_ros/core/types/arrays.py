"""Define the array types that the whole package uses."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
#: A picture to draw on or to show: (h, w) grey or (h, w, 3) BGR, uint8.
Pixels = npt.NDArray[np.uint8]
#: A picture as a camera delivers it: (h, w) or (h, w, 3), uint8 or uint16.
RawPixels = npt.NDArray[Any]
