"""Name the array types of the whole package, each once."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
#: Of a picture to be drawn on or shown: (h, w) grey or (h, w, 3) BGR.
Pixels = npt.NDArray[np.uint8]
#: Of a picture as a camera gives it: (h, w) or (h, w, 3), uint8 or uint16.
RawPixels = npt.NDArray[Any]
