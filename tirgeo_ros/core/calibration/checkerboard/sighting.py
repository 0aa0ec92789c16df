"""Define a checkerboard as seen in a picture, or the reason why it is not used."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from tirgeo_ros.core.calibration.checkerboard.board import Checkerboard
from tirgeo_ros.core.types.arrays import Array


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
    UNEVEN = "corners not on a plane"
    DUPLICATE = "as another view"
    OUTLIER = "does not fit the others"
    OTHER_SIZE = "another picture size"
    UNREADABLE = "not readable"


@dataclass(frozen=True)
class Refused:
    """Hold the reason why a view is not used."""

    reason: RefusalReason
    detail: str  # numbers, and what to do


@dataclass(frozen=True)
class BoardSighting:
    """Hold a board's corners in a picture, in the order of ``Checkerboard.grid``.

    The order begins at one of the grid's ends and is right-handed: the board's z points away from
    the camera. ``dark_first`` is whether the square diagonally outside corner 0 is dark.
    """

    corners_px: Array  # (count, 2)
    sigma_px: float  # standard deviation of a coordinate, from the corner fits
    blur_px: Array  # (2,) sigma of the blur across the rows' edges and across the columns' edges
    side_px: float  # shortest side of a square
    contrast: float  # grey value difference between dark and light squares
    dark_first: bool


def steps_of(corners: Array, board: Checkerboard) -> Array:
    """Return (count, 2, 2), px, the steps from each corner along its row and along its column."""
    grid = corners.reshape(board.rows, board.columns, 2)
    steps = np.stack([np.gradient(grid, axis=1), np.gradient(grid, axis=0)], 2)
    return np.asarray(steps.reshape(-1, 2, 2))
