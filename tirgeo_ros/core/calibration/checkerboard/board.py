"""Define a checkerboard by its inner corners on a plane, and what is seen of it in a picture.

The board's frame has x along the columns, y along the rows and z into the board, like the optical
frame of a camera that looks straight at it. Its origin is the first inner corner.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import Enum
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


class RefusalReason(Enum):
    """Name why a view is not used; the value is its name in reports."""

    NO_BOARD = "no board"
    PARTIAL = "board not whole"
    OTHER_BOARD = "another board"
    COVERED = "corners covered"
    BLURRED = "blurred"
    SMEARED = "moved while exposed"
    FAINT = "too faint"
    UNCLEAN = "squares not clean"
    SMALL = "too small"
    OBLIQUE = "too oblique"
    UNEVEN = "corners are not on a plane"
    DUPLICATE = "as another view"
    OUTLIER = "does not fit the others"
    OTHER_SIZE = "another picture size"
    UNREADABLE = "not readable"


@dataclass(frozen=True)
class Refused:
    """Hold the reason why a view is not used."""

    reason: RefusalReason
    detail: str  # numbers, and what to do

    def __str__(self) -> str:
        """Return reason and detail as reports have them."""
        return f"{self.reason.value}: {self.detail}"


@dataclass(frozen=True)
class BoardSighting:
    """Hold a board's corners in a picture, in the order of ``Checkerboard.grid``.

    The order begins at one of the grid's ends and is right-handed: the board's z points away from
    the camera.
    """

    corners_px: Array  # (count, 2)
    sigma_px: float  # standard deviation of a coordinate, from the corner fits
    blur_px: Array  # (2,) sigma of the blur across the rows' edges and across the columns' edges


def steps_of(corners: Array, board: Checkerboard) -> Array:
    """Return (count, 2, 2), px, the steps from each corner along its row and along its column."""
    grid = corners.reshape(board.rows, board.columns, 2)
    steps = np.stack([np.gradient(grid, axis=1), np.gradient(grid, axis=0)], 2)
    return np.asarray(steps.reshape(-1, 2, 2))
