"""The first point at which a ray meets an elevation model's surface.

The ray is followed in pieces, each so short that column, row and height along it are parabolas to
0.1 mm (the third derivative of an ellipsoid's coordinates over 2 km, below 85 deg of latitude).
A piece is cut at every line of the grid that it crosses; over one cell the ray's height above the
bilinear surface is a parabola again, and its first zero is exact. So no ridge is stepped over,
however thin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.types.arrays import Array

_PIECE_M, _LEAST_PIECE_M = 2000.0, 1.0
_PIECE_CELLS = 2048.0
_LEVEL = 1e-6  # the slope of a ray that is as good as level
_KNOTS = np.array([0.0, 0.5, 1.0])
#: From the values at the knots to constant, linear and square coefficient.
_PARABOLA = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [2.0, -4.0, 2.0]])


class Stop(Enum):
    """Why a ray meets no ground."""

    OVER = "over"  # it passes over all that is there
    UNDER = "under"  # it starts below the surface
    STARTS_BESIDE = "starts beside"  # the grid is not under its start
    BESIDE = "beside"  # it leaves the grid before it meets the surface
    GAP = "gap"  # it passes over a cell without heights before it meets the surface


@dataclass(frozen=True, slots=True)
class _Piece:
    """A part of a ray: parabolas of s, 0 to 1, from ``start_m`` over ``length_m``."""

    start_m: float
    length_m: float
    column: Array  # (3,) constant, linear, square
    row: Array
    height: Array

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """Column, row and height."""
        column, row, height = (
            c[0] + s * (c[1] + s * c[2]) for c in (self.column, self.row, self.height)
        )
        return column, row, height

    def is_over(self, s: float, highest_m: float) -> bool:
        """Whether the ray is above all heights at a place, and climbs from there on."""
        height, linear, square = self.height.tolist()
        return bool(
            height + s * (linear + s * square) > highest_m and linear + 2 * s * square >= 0
        )


def first_hit(
    terrain: Terrain, plane: TangentPlane, position_n: Array, ray_n: Array
) -> float | Stop:
    """How far (m) along a unit ray (3,) from a place (3,) it meets the surface first, or why not.

    Both are NED in the map's plane. Of a ray with nan it is Stop.OVER.
    """
    if not math.isfinite(float(ray_n.sum())):
        return Stop.OVER
    start_m = 0.0
    while True:
        piece = _piece(terrain, plane, position_n, ray_n, start_m)
        if piece.is_over(0.0, terrain.highest_m):
            return Stop.OVER
        found = _within(terrain, piece)
        if isinstance(found, float):
            return start_m + found * piece.length_m
        if found is not None:
            return found
        start_m += piece.length_m


def _piece(
    terrain: Terrain, plane: TangentPlane, position_n: Array, ray_n: Array, start_m: float
) -> _Piece:
    """The ray's next part: as far as it may reach the lowest height, but no longer than may be."""
    length_m = _guessed_m(terrain, plane, position_n, ray_n)
    while True:
        ways = start_m + length_m * _KNOTS
        places = plane.geodetic_from_ned(position_n + ways[:, None] * ray_n)
        column, row = terrain.grid_of(places[0], places[1])
        piece = _Piece(start_m, length_m, *(_PARABOLA @ x for x in (column, row, places[2])))
        to_lowest_m = _to_lowest_m(terrain, piece)
        cells = abs(column[2] - column[0]) + abs(row[2] - row[0])
        fits = length_m <= 1.5 * to_lowest_m and not cells > _PIECE_CELLS
        if fits or length_m <= _LEAST_PIECE_M:
            return piece
        shorter = min(to_lowest_m, 0.9 * length_m * _PIECE_CELLS / max(cells, _PIECE_CELLS))
        length_m = max(shorter, _LEAST_PIECE_M)


def _guessed_m(terrain: Terrain, plane: TangentPlane, position_n: Array, ray_n: Array) -> float:
    """The way to the lowest height as on a flat earth, and a little more."""
    drop = plane.height_m - float(position_n[2]) - terrain.lowest_m
    down = float(ray_n[2])
    return min(_PIECE_M, 1.01 * max(drop, 0.0) / down + 1.0) if down > _LEVEL else _PIECE_M


def _to_lowest_m(terrain: Terrain, piece: _Piece) -> float:
    """The length of a piece that goes down to the lowest height, and 1 m more."""
    drop = float(piece.height[0]) - terrain.lowest_m
    down = -float(piece.height[1]) / piece.length_m
    return max(drop, 0.0) / down + 1.0 if down > _LEVEL else math.inf


def _within(terrain: Terrain, piece: _Piece) -> float | Stop | None:
    """The first meeting within a piece, as s from 0 to 1; None where it only passes over."""
    cuts = np.sort(np.concatenate([[0.0], _crossings(piece.column), _crossings(piece.row), [1.0]]))
    begin, end = cuts[:-1], cuts[1:]
    middle = 0.5 * (begin + end)
    columns, rows, heights = piece.at(np.stack([begin, middle, end]))
    i, j, inside = terrain.cells(columns[1], rows[1])
    above = heights - _surface(terrain, i, j, columns, rows)
    blind = ~inside | np.isnan(above[1])
    if piece.start_m == 0.0 and not blind[0] and not above[0, 0] > 0:
        return Stop.UNDER
    share = _first_zero(above)
    stops = np.flatnonzero(blind | ~np.isnan(share))
    if not stops.size:
        return None
    first = stops[0]
    if not blind[first]:
        return float(begin[first] + share[first] * (end[first] - begin[first]))
    return _why_blind(terrain, piece, float(begin[first]), on_grid=bool(inside[first]))


def _why_blind(terrain: Terrain, piece: _Piece, s: float, *, on_grid: bool) -> Stop:
    if piece.is_over(s, terrain.highest_m):
        return Stop.OVER
    if on_grid:
        return Stop.GAP
    return Stop.STARTS_BESIDE if piece.start_m == s == 0.0 else Stop.BESIDE


def _surface(
    terrain: Terrain,
    i: npt.NDArray[np.intp],
    j: npt.NDArray[np.intp],
    columns: Array,
    rows: Array,
) -> Array:
    """The surface of cells (K,) at three places (3, K) of each."""
    nw, ne, sw, se = terrain.corners(i, j)
    x, y = columns - i, rows - j
    surface: Array = nw + (ne - nw) * x + (sw - nw) * y + (nw - ne - sw + se) * (x * y)
    return surface


def _crossings(parabola: Array) -> Array:
    """Where in (0, 1) a parabola passes a whole number: both roots, stable for no curvature."""
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
    """Where from 0 to 1 a parabola of values (3, K) at its knots first falls to zero, or nan."""
    constant, linear, square = _PARABOLA @ above
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(linear**2 - 4 * square * constant)
        # The smaller positive root is this one whatever the square term's sign; at or below zero
        # from the start (by rounding, on a line of the grid) it is there already.
        share = np.where(constant <= 0, 0.0, 2 * constant / (root - linear))
        return np.where((share >= 0) & (share <= 1), share, np.nan)
