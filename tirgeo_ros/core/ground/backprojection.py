# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Back-project pixels to the ground (Ren et al. 2022, Eq. 23), or return why it is impossible.

The ray through the pixel is intersected with the ground: a surface of constant ellipsoidal height,
or the bilinear surface of an elevation model. Both follow the earth's curvature; the map's tangent
plane departs from it by 8 cm at 1 km.

Over an elevation model the ray is followed in pieces. Each is so short that column, row and height
along it are parabolas to 0.1 mm (the third derivative of an ellipsoid's coordinates over 2 km,
below 85 deg of latitude). A piece is cut at every grid line that it crosses. Over one cell the
ray's height above the bilinear surface is then a parabola too, and its first zero is computed in
closed form. No ridge is missed, however thin it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M, earth_at
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import ElevationError
from tirgeo_ros.core.types.poses import CameraPose

#: Convert latitude and longitude (rad, any shape) to the grid's column and row, in nodes from 0.
GridOf = Callable[[Array, Array], tuple[Array, Array]]

# The terrain, and its slope.
#: Above any mountain and below any trench: a height beyond is a no-data value, not declared.
_HIGHEST_M, _LOWEST_M = 9500.0, -12000.0
_PROBE_M = 1.0
# A ray over an elevation model, cut into pieces.
_PIECE_M, _LEAST_PIECE_M = 2000.0, 1.0
_PIECE_CELLS = 2048.0
_LEVEL = 1e-6  # a ray that falls less steeply than this counts as level
_KNOTS = np.array([0.0, 0.5, 1.0])
#: Converts a parabola's values at the knots to its constant, linear and square coefficients.
_PARABOLA = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [2.0, -4.0, 2.0]])
#: Number of steps of a line of sight in which it is compared with the terrain.
_PLACES = 48
#: The terrain hides a point if it is this much higher than the line of sight: few elevation models
#: are more accurate, and the point itself lies on the surface.
_CLEAR_M = 0.1
# A ray over ground of one height.
_MOST_STEPS = 6
#: Height errors at which the iteration ends and at which its result is accepted. Earth-fixed
#: coordinates have a rounding error of 1e-9 m, which accumulates.
_SETTLED_M, _CLOSE_M = 1e-8, 1e-6
#: Rays closer to the surface's tangent than this (rad) give no point: no attitude is so accurate.
_LEVEL_RAD = 1e-4


@dataclass(frozen=True, eq=False)
class Terrain:
    """Hold ellipsoidal heights (rows, cols), m, at the nodes of a grid; nan where unknown.

    The surface extends to the outermost nodes. ``notes`` are remarks for the user about the
    source file. Raise ElevationError if the grid has no cell, no height or impossible heights.
    Infinite heights become nan.
    """

    heights_m: npt.NDArray[np.floating]
    grid_of: GridOf
    notes: tuple[str, ...] = ()
    lowest_m: float = field(init=False)
    highest_m: float = field(init=False)

    def __post_init__(self) -> None:
        """Check the heights and compute their range."""
        heights = np.asarray(self.heights_m)
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise ElevationError(
                f"elevation model of shape {heights.shape}: at least 2 x 2 heights are needed"
            )
        heights = np.ascontiguousarray(heights)  # no copy if it already is
        lowest, highest = _range(heights)
        if math.isinf(lowest) or math.isinf(highest):
            heights = np.where(np.isinf(heights), np.nan, heights)
            lowest, highest = _range(heights)
        if math.isnan(lowest):
            raise ElevationError("elevation model without heights: all its values are no-data")
        if lowest < _LOWEST_M or highest > _HIGHEST_M:
            raise ElevationError(
                f"elevation model with heights from {lowest:g} to {highest:g} m: is "
                "its no-data value declared?"
            )
        object.__setattr__(self, "heights_m", heights)
        object.__setattr__(self, "lowest_m", lowest)
        object.__setattr__(self, "highest_m", highest)

    def height_m(self, latitude_rad: npt.ArrayLike, longitude_rad: npt.ArrayLike) -> Array:
        """Return heights (m) at points of any shape; nan off the grid and beside a nan node."""
        return self.at(*self.grid_of(np.asarray(latitude_rad), np.asarray(longitude_rad)))

    def at(self, column: Array, row: Array) -> Array:
        """Return heights (m) at columns and rows of any shape; nan as in ``height_m``."""
        with np.errstate(invalid="ignore"):
            i, j, inside = self.cells(column, row)
        return np.where(inside, self.surface(i, j, column - i, row - j), np.nan)

    def cells(
        self, column: Array, row: Array
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
        """Return the cell (first column and row) of each point, and whether it is on the grid.

        For a point off the grid the cell is valid but arbitrary.
        """
        rows, columns = self.heights_m.shape
        inside = (column >= 0) & (column <= columns - 1) & (row >= 0) & (row <= rows - 1)
        i = np.fmin(np.fmax(column, 0.0), columns - 2).astype(np.intp)  # nan gives cell 0
        j = np.fmin(np.fmax(row, 0.0), rows - 2).astype(np.intp)
        return i, j, inside

    def surface(
        self, i: npt.NDArray[np.intp], j: npt.NDArray[np.intp], x: Array, y: Array
    ) -> Array:
        """Return the bilinear heights (m) in the cells of columns i and rows j.

        ``x`` and ``y`` are the points' columns and rows from the cell's first node.
        """
        flat = self.heights_m.reshape(-1)
        columns = self.heights_m.shape[1]
        nodes = np.add.outer([0, 1, columns, columns + 1], j * columns + i)
        nw, ne, sw, se = flat[nodes].astype(float)
        height: Array = nw + (ne - nw) * x + (sw - nw) * y + (nw - ne - sw + se) * (x * y)
        return height


#: The ground under the map: one ellipsoidal height (m) everywhere, or an elevation model.
Ground: TypeAlias = float | Terrain


def _range(heights: npt.NDArray[np.floating]) -> tuple[float, float]:
    """Return the lowest and the highest height, without nan; nan if all are nan."""
    return float(np.fmin.reduce(heights, None)), float(np.fmax.reduce(heights, None))


class Slopes:
    """Measure the terrain's slope around one point, given by latitude and longitude (rad).

    ``axes_n`` (3, 3) has north, east and down at that point as columns. ``cell_m`` is about the
    longer side of a cell there.
    """

    def __init__(
        self, terrain: Terrain, latitude_rad: float, longitude_rad: float, axes_n: Array
    ) -> None:
        self._terrain, self._axes_n = terrain, axes_n
        _, cosine, meridian_m, transverse_m, _ = earth_at(latitude_rad, 0.0)
        north_rad = _PROBE_M / meridian_m
        east_rad = _PROBE_M / max(transverse_m * cosine, _PROBE_M)
        latitudes = np.array([latitude_rad, latitude_rad + north_rad, latitude_rad])
        longitudes = np.array([longitude_rad, longitude_rad, longitude_rad + east_rad])
        columns, rows = (x.tolist() for x in terrain.grid_of(latitudes, longitudes))
        by_m = [[x[k] - x[0] for k in (1, 2)] for x in (columns, rows)]
        self._place = np.array([columns[0], rows[0]])
        self._by_m = np.array(by_m) / _PROBE_M  # (2, 2) columns and rows per metre north and east
        least = min(math.hypot(by_m[0][k], by_m[1][k]) for k in (0, 1)) / _PROBE_M
        self.cell_m = 1.0 / max(least, 1e-9)

    def normal_n(self, step_m: float) -> Array:
        """Return the surface's normal (3,), with 1 along up, from differences over a step (m).

        The differences are to both sides. If one side has no height (edge or gap), only the other
        side is used. If both have none, the surface counts as level in that direction.
        """
        steps = step_m * np.array([0.0, -1.0, 1.0])
        column, row = self._place[:, None, None] + self._by_m[:, :, None] * steps
        slopes = []
        for here, before, after in self._terrain.at(column, row).tolist():
            rises = [x for x in (here - before, after - here) if math.isfinite(x)]
            slopes.append(sum(rises) / max(len(rises), 1) / step_m)
        return np.asarray(-self._axes_n[:, 2] - self._axes_n[:, :2] @ slopes)


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
        """Return whether the ray, at s, is above ``highest_m`` and does not descend."""
        height, linear, square = self.height.tolist()
        height += s * (linear + s * square)
        return bool(height > highest_m and linear + 2 * s * square >= 0)


def first_hit(
    terrain: Terrain, plane: TangentPlane, position_n: Array, ray_n: Array
) -> float | Reason:
    """Return the distance (m) along a unit ray (3,) to the surface, or why it does not meet it.

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
        hit = _within(terrain, piece)
        if isinstance(hit, float):
            return start_m + hit * piece.length_m
        if hit is not None:
            return hit
        start_m += piece.length_m


def _piece(
    terrain: Terrain, plane: TangentPlane, position_n: Array, ray_n: Array, start_m: float
) -> _Piece:
    """Return the ray's next piece.

    It ends about where the ray reaches the model's lowest height, and is at most ``_PIECE_M`` and
    about ``_PIECE_CELLS`` cells long.
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
        # The distance at which the piece's tangent reaches the lowest height, plus 1 m.
        drop, down = float(piece.height[0]) - terrain.lowest_m, -float(piece.height[1]) / length_m
        to_lowest_m = max(drop, 0.0) / down + 1.0 if down > _LEVEL else math.inf
        cells = abs(column[2] - column[0]) + abs(row[2] - row[0])
        fits = length_m <= 1.5 * to_lowest_m and not cells > _PIECE_CELLS
        if fits or length_m <= _LEAST_PIECE_M:
            return piece
        shorter = min(to_lowest_m, 0.9 * length_m * _PIECE_CELLS / max(cells, _PIECE_CELLS))
        length_m = max(shorter, _LEAST_PIECE_M)


def _within(terrain: Terrain, piece: _Piece) -> float | Reason | None:
    """Return s, 0 to 1, of a piece's first intersection; a Reason to stop, or None to go on."""
    cuts = np.sort(np.concatenate([[0.0], _crossings(piece.column), _crossings(piece.row), [1.0]]))
    begin, end = cuts[:-1], cuts[1:]
    middle = 0.5 * (begin + end)
    columns, rows, heights = piece.at(np.stack([begin, middle, end]))
    i, j, inside = terrain.cells(columns[1], rows[1])
    above = heights - terrain.surface(i, j, columns - i, rows - j)
    blind = ~inside | np.isnan(above[1])
    if piece.start_m == 0.0 and not blind[0] and not above[0, 0] > 0:
        return Reason.UNDERGROUND
    # s, 0 to 1, where parabolas first fall to zero; nan where they do not. This form gives the
    # smaller positive root for either sign of the square term. A start at or below zero (by
    # rounding, on a grid line) is itself the intersection.
    constant, linear, square = _PARABOLA @ above
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(linear**2 - 4 * square * constant)
        share = np.where(constant <= 0, 0.0, 2 * constant / (root - linear))
        share = np.where((share >= 0) & (share <= 1), share, np.nan)
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


def hidden(terrain: Terrain, plane: TangentPlane, eye_n: Array, points_n: Array) -> BoolArray:
    """Return (N,) whether the terrain hides its points (N, 3) from a viewpoint ``eye_n`` (3,).

    Both are NED in the map's plane, m. Column, row and height are interpolated linearly along the
    line of sight: the height is then off by 2 cm in the middle of 1 km. An obstacle shorter than
    1/48 of the line may be missed. Ground without a height hides nothing.
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


def is_given(ground: Ground | None) -> bool:
    """Return whether the ground is known: an elevation model, or a height that is not nan."""
    return ground is not None and (isinstance(ground, Terrain) or math.isfinite(ground))


def locate(
    camera: Camera, pose: CameraPose, uv: Array, plane: TangentPlane, ground: Ground
) -> tuple[Array, list[Reason | None]]:
    """Back-project pixels (N, 2) to ground points (N, 3), NED in the map's plane, m.

    The list has N entries: None for a pixel with a point; for one without, the reason, and its
    point is nan. The point is the first along the ray, so ground behind a ridge is not returned.
    """
    rays_n = camera.rays(uv) @ matrix_from_quat(pose.q_nc).T
    rays_n /= np.linalg.norm(rays_n, axis=1, keepdims=True)
    if isinstance(ground, Terrain):
        hits = [first_hit(ground, plane, pose.position_n, ray) for ray in rays_n]
        ways = np.array([np.nan if isinstance(way, Reason) else way for way in hits])
        stops = [way if isinstance(way, Reason) else None for way in hits]
    else:
        ways, stops = level_hits(ground, plane, pose.position_n, rays_n)
    reasons = [
        Reason.OUTSIDE_LENS if np.isnan(ray[0]) else stop
        for ray, stop in zip(rays_n, stops, strict=True)
    ]
    return pose.position_n + ways[:, None] * rays_n, reasons


def level_hits(
    height_m: float, plane: TangentPlane, position_n: Array, rays_n: Array
) -> tuple[Array, list[Reason | None]]:
    """Return the distances (N,), m, at which unit rays (N, 3) reach an ellipsoidal height.

    If a ray does not reach it, its distance is nan and the list has a Reason, else None. The first
    guess is on a sphere; Newton's method on the ellipsoidal height then refines it.
    """
    latitude, longitude, camera_m = plane.geodetic_from_ned(position_n)
    above_m = float(camera_m) - height_m
    if not above_m > 0:
        return np.full(len(rays_n), np.nan), [Reason.UNDERGROUND] * len(rays_n)
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = rays_n @ plane.up_n(latitude, longitude)
        # On a sphere the smaller root t of above + slope t + (1 - slope^2) t^2 / 2 R.
        bend = (1 - slopes**2) / (2 * SEMI_MAJOR_AXIS_M)
        root = np.sqrt(np.where(slopes < 0, slopes**2 - 4 * bend * above_m, np.nan))
        ways = 2 * above_m / (root - slopes)
        for _ in range(_MOST_STEPS):
            points_n = position_n + ways[:, None] * rays_n
            latitude, longitude, off_m = plane.geodetic_from_ned(points_n)
            off_m -= height_m
            # The height's gradient is the ellipsoid's normal at the point.
            slopes = (plane.up_n(latitude, longitude) * rays_n).sum(axis=1)
            if not (np.abs(off_m) > _SETTLED_M).any():
                break
            ways = ways - off_m / slopes
        hit = (np.abs(off_m) < _CLOSE_M) & (slopes < -_LEVEL_RAD) & (ways > 0)
    reasons = [None if is_hit else Reason.ABOVE_HORIZON for is_hit in hit.tolist()]
    return np.where(hit, ways, np.nan), reasons
