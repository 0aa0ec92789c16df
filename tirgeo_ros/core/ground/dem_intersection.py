"""Find the first point at which a ray meets an elevation model's surface.

The ray is followed in pieces. Each is so short that column, row and height along it are parabolas
to 0.1 mm (the third derivative of an ellipsoid's coordinates over 2 km, below 85 deg of latitude).
A piece is cut at every grid line that it crosses. Over one cell the ray's height above the
bilinear surface is then a parabola too, and its first zero is computed in closed form. No ridge is
missed, however thin it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.types.arrays import Array, BoolArray

_PIECE_M, _LEAST_PIECE_M = 2000.0, 1.0
_PIECE_CELLS = 2048.0
_LEVEL = 1e-6  # a ray that falls less steeply than this counts as level
_KNOTS = np.array([0.0, 0.5, 1.0])
#: Converts the values at the knots to the constant, linear and square coefficients.
_PARABOLA = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [2.0, -4.0, 2.0]])
#: Places along a line of sight at which the terrain is compared with it.
_PLACES = 48
#: The terrain hides what is behind it if it is this much higher than the line of sight: elevation
#: models are hardly ever better, and the point itself lies on the surface.
_CLEAR_M = 0.1


class Reason(Enum):
    """Name why a pixel has no ground point; the value is the text shown to the user."""

    OUTSIDE_LENS = "the pixel is outside the lens model"
    OUTSIDE_PICTURE = "the pixel is outside the picture"
    ABOVE_HORIZON = "the pixel is above the horizon"
    UNDERGROUND = "the camera is below the ground: are both heights ellipsoidal?"
    CAMERA_OFF_MODEL = "the camera is outside the elevation model"
    OFF_MODEL = "the line of sight leaves the elevation model"
    GAP = "the elevation model has a gap along the line of sight"
    GRAZING = "the line of sight is too flat to locate a point"
    NO_POSE = "no trusted pose at that picture"
    UNCERTAIN_POSE = "the pose's covariance is not known"
    UNKNOWN_PICTURE = "no picture of that stamp was shown"
    TOO_OLD = "the picture of that stamp is too old"
    NO_PICTURE = "no picture was shown yet"
    NO_GROUND = "the height of the ground is not known: set ground_height_m or dem"


@dataclass(frozen=True, slots=True)
class _Piece:
    """Hold a part of a ray as parabolas of s, from 0 at ``start_m`` to 1 after ``length_m``."""

    start_m: float
    length_m: float
    column: Array  # (3,) constant, linear, square
    row: Array
    height: Array

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """Return column, row and height (m) at s, any shape."""
        column, row, height = (
            c[0] + s * (c[1] + s * c[2]) for c in (self.column, self.row, self.height)
        )
        return column, row, height

    def is_over(self, s: float, highest_m: float) -> bool:
        """Return whether the ray at s is above ``highest_m`` and does not descend there."""
        height, linear, square = self.height.tolist()
        return bool(
            height + s * (linear + s * square) > highest_m and linear + 2 * s * square >= 0
        )


def first_hit(
    terrain: Terrain, plane: TangentPlane, position_n: Array, ray_n: Array
) -> float | Reason:
    """Return the distance (m) along a unit ray (3,) to the surface, or why it meets none.

    The ray starts at ``position_n`` (3,), m; both are NED in the map's plane. A ray with nan gives
    Reason.ABOVE_HORIZON.
    """
    if not math.isfinite(float(ray_n.sum())):
        return Reason.ABOVE_HORIZON
    start_m = 0.0
    while True:
        piece = _piece(terrain, plane, position_n, ray_n, start_m)
        if piece.is_over(0.0, terrain.highest_m):
            return Reason.ABOVE_HORIZON
        found = _within(terrain, piece)
        if isinstance(found, float):
            return start_m + found * piece.length_m
        if found is not None:
            return found
        start_m += piece.length_m


def _piece(
    terrain: Terrain, plane: TangentPlane, position_n: Array, ray_n: Array, start_m: float
) -> _Piece:
    """Return the ray's next piece.

    It reaches about to the model's lowest height, but not beyond ``_PIECE_M`` and about
    ``_PIECE_CELLS`` cells.
    """
    # A first guess of the length: 1 % and 1 m more than to the lowest height on a flat earth.
    drop = plane.height_m - float(position_n[2]) - terrain.lowest_m
    down = float(ray_n[2])
    length_m = min(_PIECE_M, 1.01 * max(drop, 0.0) / down + 1.0) if down > _LEVEL else _PIECE_M
    while True:
        ways = start_m + length_m * _KNOTS
        places = plane.geodetic_from_ned(position_n + ways[:, None] * ray_n)
        column, row = terrain.grid_of(places[0], places[1])
        piece = _Piece(start_m, length_m, *(_PARABOLA @ x for x in (column, row, places[2])))
        # To where the piece's tangent reaches the lowest height, plus 1 m.
        drop, down = float(piece.height[0]) - terrain.lowest_m, -float(piece.height[1]) / length_m
        to_lowest_m = max(drop, 0.0) / down + 1.0 if down > _LEVEL else math.inf
        cells = abs(column[2] - column[0]) + abs(row[2] - row[0])
        fits = length_m <= 1.5 * to_lowest_m and not cells > _PIECE_CELLS
        if fits or length_m <= _LEAST_PIECE_M:
            return piece
        shorter = min(to_lowest_m, 0.9 * length_m * _PIECE_CELLS / max(cells, _PIECE_CELLS))
        length_m = max(shorter, _LEAST_PIECE_M)


def _within(terrain: Terrain, piece: _Piece) -> float | Reason | None:
    """Return s, 0 to 1, of a piece's first intersection, or a Reason to stop; None to go on."""
    cuts = np.sort(np.concatenate([[0.0], _crossings(piece.column), _crossings(piece.row), [1.0]]))
    begin, end = cuts[:-1], cuts[1:]
    middle = 0.5 * (begin + end)
    columns, rows, heights = piece.at(np.stack([begin, middle, end]))
    i, j, inside = terrain.cells(columns[1], rows[1])
    above = heights - terrain.surface(i, j, columns - i, rows - j)
    blind = ~inside | np.isnan(above[1])
    if piece.start_m == 0.0 and not blind[0] and not above[0, 0] > 0:
        return Reason.UNDERGROUND
    share = _first_zero(above)
    stops = np.flatnonzero(blind | ~np.isnan(share))
    if not stops.size:
        return None
    first = stops[0]
    if not blind[first]:
        return float(begin[first] + share[first] * (end[first] - begin[first]))
    s = float(begin[first])
    if piece.is_over(s, terrain.highest_m):
        return Reason.ABOVE_HORIZON
    if inside[first]:
        return Reason.GAP
    return Reason.CAMERA_OFF_MODEL if piece.start_m == s == 0.0 else Reason.OFF_MODEL


def _crossings(parabola: Array) -> Array:
    """Return all s in (0, 1) at which a parabola of s is a whole number.

    The roots are computed in the form that is stable for a curvature near zero.
    """
    constant, linear, square = parabola.tolist()
    ends = [constant, constant + linear + square]
    if square and 0 < -linear / (2 * square) < 1:
        ends.append(constant - linear * linear / (4 * square))
    if not all(map(math.isfinite, ends)):
        return np.empty(0)
    numbers = np.arange(math.ceil(min(ends)), math.floor(max(ends)) + 1, dtype=float)
    rest = constant - numbers
    with np.errstate(invalid="ignore", divide="ignore"):
        q = -0.5 * (linear + math.copysign(1, linear) * np.sqrt(linear**2 - 4 * square * rest))
        roots = np.concatenate([rest / q, q / square]) if square else rest / q
        return roots[(roots > 0) & (roots < 1)]


def _first_zero(above: Array) -> Array:
    """Return s (K,), 0 to 1, where parabolas first fall to zero; nan where they do not.

    The parabolas are given by their values (3, K) at the knots.
    """
    constant, linear, square = _PARABOLA @ above
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(linear**2 - 4 * square * constant)
        # This form gives the smaller positive root for either sign of the square term. A start at
        # or below zero (by rounding, on a grid line) is itself the intersection.
        share = np.where(constant <= 0, 0.0, 2 * constant / (root - linear))
        return np.where((share >= 0) & (share <= 1), share, np.nan)


def hidden(terrain: Terrain, plane: TangentPlane, eye_n: Array, points_n: Array) -> BoolArray:
    """Return for points (N, 3) of the terrain whether it hides them from a place ``eye_n`` (3,).

    Both are NED in the map's plane, m. Between the ends column, row and height are taken as
    linear: the height is then off by 2 cm in the middle of a line of 1 km. An obstacle shorter
    than a 48th of the line may be missed. A place without a height hides nothing.
    """
    ends = np.concatenate([np.asarray(points_n), np.asarray(eye_n)[None]])
    latitude, longitude, height = plane.geodetic_from_ned(ends)
    column, row = terrain.grid_of(latitude, longitude)
    share = np.arange(1, _PLACES) / _PLACES
    columns, rows, heights = (
        ends[:-1, None] + share * (ends[-1] - ends[:-1, None]) for ends in (column, row, height)
    )
    with np.errstate(invalid="ignore"):
        above = terrain.at(columns, rows) > heights + _CLEAR_M
    return np.asarray(above.any(axis=1))
