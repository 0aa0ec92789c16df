"""Decode pictures of files (PNG, JPEG, TIFF ...) after a check of their size.

A PNG of one colour is a thousandth of its pixels' size; its header contains the true size.
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

#: Formats that OpenCV reads too; no other reader of Pillow's is used.
FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "PPM", "WEBP")
#: Most pixels of a picture of a video (4K): the frames of a second may wait for their poses.
MOST_OF_VIDEO = 1 << 23
#: Most pixels of a single picture: more than the cameras of aircraft have.
MOST_OF_FILE = 50_000_000
#: More than any of them.
BEYOND = 1 << 16, 1 << 16


def unpacked(data: bytes, flags: int, most_pixels: int) -> npt.NDArray[Any] | None:
    """Return the pixels as ``cv2.imdecode`` with ``flags`` does; None if it is no picture.

    Raises ValueError for one of more than ``most_pixels``.
    """
    pixels = math.prod(size_of(data))
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


def size_of(data: bytes, formats: tuple[str, ...] = FORMATS) -> tuple[int, int]:
    """Return width and height by the header: zeros without one, ``BEYOND`` past Pillow's limit."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=formats) as picture:
                return picture.size
    except Image.DecompressionBombError:
        return BEYOND
    except (OSError, ValueError, SyntaxError, ArithmeticError, LookupError, TypeError):
        return 0, 0
