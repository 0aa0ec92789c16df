"""Hold an elevation model in memory: heights at the nodes of a grid, bilinear between them.

The grid is the one of the model's file, in the file's coordinate system. ``grid_of`` converts
latitude and longitude to it. The heights are not resampled, so the surface is the file's own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.wgs84 import earth_at
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ElevationError

#: Convert latitude and longitude (rad, any shape) to the grid's column and row, in nodes from 0.
GridOf = Callable[[Array, Array], tuple[Array, Array]]

#: Above any mountain and below any trench: a value beyond is an undeclared no-data mark.
_HIGHEST_M, _LOWEST_M = 9500.0, -12000.0
_PROBE_M = 1.0


@dataclass(frozen=True, eq=False)
class Terrain:
    """Hold ellipsoidal heights (rows, cols), m, at the nodes of a grid; nan where unknown.

    The surface extends to the outermost nodes. ``notes`` are remarks for the user on the source
    file. Raise ElevationError if the grid has no cell, no height or impossible heights. Infinite
    heights become nan.
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
                f"elevation model of shape {heights.shape}: at least 2 x 2 are needed"
            )
        heights = np.ascontiguousarray(heights)  # no copy if it already is
        lowest, highest = _range(heights)
        if math.isinf(lowest) or math.isinf(highest):
            heights = np.where(np.isinf(heights), np.nan, heights)
            lowest, highest = _range(heights)
        if math.isnan(lowest):
            raise ElevationError("elevation model without a single height: all of it is no-data")
        if lowest < _LOWEST_M or highest > _HIGHEST_M:
            raise ElevationError(
                f"elevation model with heights from {lowest:g} to {highest:g} m: is "
                "its no-data value declared?"
            )
        object.__setattr__(self, "heights_m", heights)
        object.__setattr__(self, "lowest_m", lowest)
        object.__setattr__(self, "highest_m", highest)

    def height_m(self, latitude_rad: npt.ArrayLike, longitude_rad: npt.ArrayLike) -> Array:
        """Return heights (m) at places of any shape; nan off the grid and beside a nan node."""
        return self.at(*self.grid_of(np.asarray(latitude_rad), np.asarray(longitude_rad)))

    def at(self, column: Array, row: Array) -> Array:
        """Return heights (m) at columns and rows of any shape; nan as in ``height_m``."""
        with np.errstate(invalid="ignore"):
            i, j, inside = self.cells(column, row)
        return np.where(inside, self.surface(i, j, column - i, row - j), np.nan)

    def cells(
        self, column: Array, row: Array
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
        """Return the cell (its first column and row) of each place, and whether it is on the grid.

        For a place off the grid the cell is a valid but arbitrary one.
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

        ``x`` and ``y`` are the places' columns and rows from the cell's first node.
        """
        flat = self.heights_m.reshape(-1)
        columns = self.heights_m.shape[1]
        nodes = np.add.outer([0, 1, columns, columns + 1], j * columns + i)
        nw, ne, sw, se = flat[nodes].astype(float)
        height: Array = nw + (ne - nw) * x + (sw - nw) * y + (nw - ne - sw + se) * (x * y)
        return height


def _range(heights: npt.NDArray[np.floating]) -> tuple[float, float]:
    """Return the lowest and the highest height, without nan; nan if all are nan."""
    return float(np.fmin.reduce(heights, None)), float(np.fmax.reduce(heights, None))


class Slopes:
    """Measure the terrain's slope around one place, given by latitude and longitude (rad).

    ``axes_n`` (3, 3) has north, east and down at that place as columns. ``cell_m`` is about the
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

        The differences are to both sides. Where one side has no height (edge or gap), the other
        side is used alone. Where neither has one, the surface counts as level in that direction.
        """
        steps = step_m * np.array([0.0, -1.0, 1.0])
        column, row = self._place[:, None, None] + self._by_m[:, :, None] * steps
        slopes = []
        for here, before, after in self._terrain.at(column, row).tolist():
            rises = [x for x in (here - before, after - here) if math.isfinite(x)]
            slopes.append(sum(rises) / max(len(rises), 1) / step_m)
        normal: Array = -self._axes_n[:, 2] - self._axes_n[:, :2] @ slopes
        return normal
