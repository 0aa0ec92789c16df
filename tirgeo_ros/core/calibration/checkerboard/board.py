"""Define a checkerboard by its inner corners on a plane.

The board's frame has x along the columns, y along the rows and z into the board, like the optical
frame of a camera that looks straight at it. Its origin is the first inner corner.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError

_FEWEST = 3  # corners per side, the least that one of the detectors needs
_MOST = 100


@dataclass(frozen=True)
class Checkerboard:
    """Hold a board of ``columns`` x ``rows`` inner corners, ``square_m`` apart.

    Raises CalibrationError if no such board can exist.
    """

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        """Check that such a board can exist."""
        if not _FEWEST <= min(self.columns, self.rows) <= max(self.columns, self.rows) <= _MOST:
            raise CalibrationError(
                f"board {self.columns}x{self.rows}: it needs {_FEWEST} to {_MOST} inner corners "
                "a side (corners between squares, not squares)"
            )
        if not (math.isfinite(self.square_m) and self.square_m > 0):
            raise CalibrationError(f"square {self.square_m:g} m: its side must be positive")

    @property
    def count(self) -> int:
        """Return the number of inner corners."""
        return self.columns * self.rows

    @property
    def size(self) -> tuple[int, int]:
        """Return columns and rows, as OpenCV takes them."""
        return self.columns, self.rows

    @property
    def grid(self) -> Array:
        """Return (count, 2) column and row of every corner, row by row."""
        rows, columns = np.mgrid[: self.rows, : self.columns]
        return np.stack([columns.ravel(), rows.ravel()], -1).astype(float)

    @property
    def points_m(self) -> Array:
        """Return (count, 3) the corners in the board's frame, m."""
        return np.hstack([self.grid * self.square_m, np.zeros((self.count, 1))])


def board_of(text: str, square_m: float) -> Checkerboard:
    """Return a board from a text such as ``9x6``. Raises CalibrationError."""
    found = re.fullmatch(r"\s*(\d{1,4})\s*[xX]\s*(\d{1,4})\s*", text)
    if found is None:
        raise CalibrationError(f"board {text!r}: give inner corners as COLUMNSxROWS, as 9x6")
    return Checkerboard(int(found[1]), int(found[2]), square_m)


def rotation_of(turn: Any) -> Array:
    """Return the (3, 3) rotation matrix of OpenCV's rotation vector."""
    return np.asarray(cv2.Rodrigues(turn)[0], float)
