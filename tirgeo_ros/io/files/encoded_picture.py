"""Pictures as files have them (PNG, JPEG, TIFF ...), unpacked once their size is known.

A PNG of one colour shrinks to a thousandth: its header says how large it will be.
"""

from __future__ import annotations

import io
import math
import warnings
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

#: Those that OpenCV reads too; no other reader of Pillow's is asked.
_FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "PPM", "WEBP")
#: Pixels of a picture of a video: the frames of a second may wait for their poses. That is 4K.
MOST_OF_VIDEO = 1 << 23
#: Of a single picture: more than the cameras of aircraft have.
MOST_OF_FILE = 50_000_000


def unpacked(data: bytes, flags: int, most_pixels: int) -> npt.NDArray[Any] | None:
    """The pixels as ``cv2.imdecode`` gives them with ``flags``; None where it is no picture.

    Raises ValueError for one of more than ``most_pixels``.
    """
    pixels = _pixels(data)
    if pixels > most_pixels:
        raise ValueError(
            f"more than {most_pixels * 1e-6:.1f} million pixels; send or give a smaller picture"
        )
    if not pixels:
        return None
    try:
        return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), flags))
    except cv2.error:
        return None


def _pixels(data: bytes) -> float:
    """How many pixels there are by the header; 0 where there is none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=_FORMATS) as picture:
                return picture.width * picture.height
    except Image.DecompressionBombError:
        return math.inf
    except (OSError, ValueError, SyntaxError, ArithmeticError, LookupError, TypeError):
        return 0
