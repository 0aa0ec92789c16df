"""An elevation model in memory: heights at the nodes of a grid, bilinear between them.

The grid is that of the model's own file, in whatever coordinate system it came: ``grid_of`` says
where on it a place lies. Nothing is resampled, so that the surface is the file's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ElevationError

#: Latitude and longitude (rad, any shape) to column and row of the grid, in nodes, from 0.
GridOf = Callable[[Array, Array], tuple[Array, Array]]

#: Above any mountain and below any trench: what is beyond is no height but a mark of none.
_HIGHEST_M, _LOWEST_M = 9500.0, -12000.0


@dataclass(frozen=True, eq=False)
class Terrain:
    """Ellipsoidal heights (rows, cols) in m at the nodes of a grid; nan where there is none.

    Its surface lies between the outermost nodes. ``notes`` is what a person should be told of the
    file that it came from. Raises ElevationError where it has no cell, no height or impossible
    ones.
    """

    heights_m: npt.NDArray[np.floating]
    grid_of: GridOf
    notes: tuple[str, ...] = ()
    lowest_m: float = field(init=False)
    highest_m: float = field(init=False)

    def __post_init__(self) -> None:
        """Check the heights and find their range."""
        heights = np.asarray(self.heights_m)
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise ElevationError(f"elevation model of shape {heights.shape}: 2 x 2 are the fewest")
        heights = np.ascontiguousarray(heights)  # which copies nothing of a large model
        lowest, highest = _range(heights)
        if math.isinf(lowest) or math.isinf(highest):
            heights = np.where(np.isinf(heights), np.nan, heights)
            lowest, highest = _range(heights)
        if math.isnan(lowest):
            raise ElevationError("elevation model without a height: all of it is no data")
        if lowest < _LOWEST_M or highest > _HIGHEST_M:
            raise ElevationError(
                f"elevation model with heights from {lowest:g} to {highest:g} m; is its no-data "
                "value declared?"
            )
        object.__setattr__(self, "heights_m", heights)
        object.__setattr__(self, "lowest_m", lowest)
        object.__setattr__(self, "highest_m", highest)

    def height_m(self, latitude_rad: npt.ArrayLike, longitude_rad: npt.ArrayLike) -> Array:
        """Heights at places of any shape; nan outside the grid and where a node next to it is."""
        return self.at(*self.grid_of(np.asarray(latitude_rad), np.asarray(longitude_rad)))

    def at(self, column: Array, row: Array) -> Array:
        """Heights at places of the grid, any shape; nan as in ``height_m``."""
        with np.errstate(invalid="ignore"):
            i, j, inside = self.cells(column, row)
            x, y = column - i, row - j
        nw, ne, sw, se = self.corners(i, j)
        height = nw + (ne - nw) * x + (sw - nw) * y + (nw - ne - sw + se) * (x * y)
        return np.where(inside, height, np.nan)

    def cells(
        self, column: Array, row: Array
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
        """The cell (its first column and row) of places of the grid, and which lie on the grid.

        Of a place beside the grid it is some cell.
        """
        rows, columns = self.heights_m.shape
        inside = (column >= 0) & (column <= columns - 1) & (row >= 0) & (row <= rows - 1)
        i = np.fmin(np.fmax(column, 0.0), columns - 2).astype(np.intp)  # of nan the first
        j = np.fmin(np.fmax(row, 0.0), rows - 2).astype(np.intp)
        return i, j, inside

    def corners(
        self, i: npt.NDArray[np.intp], j: npt.NDArray[np.intp]
    ) -> tuple[Array, Array, Array, Array]:
        """Heights at nodes (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1); i columns, j rows."""
        flat = self.heights_m.reshape(-1)
        columns = self.heights_m.shape[1]
        nodes = np.add.outer([0, 1, columns, columns + 1], j * columns + i)
        nw, ne, sw, se = flat[nodes].astype(float)
        return nw, ne, sw, se


def _range(heights: npt.NDArray[np.floating]) -> tuple[float, float]:
    """The lowest and the highest of all but the nan."""
    return float(np.fmin.reduce(heights, None)), float(np.fmax.reduce(heights, None))


def graticule(
    south_west_deg: tuple[float, float], step_deg: tuple[float, float], rows: int
) -> GridOf:
    """``grid_of`` of a grid along meridians and parallels, its first row in the north.

    Both arguments are (latitude, longitude); ``rows`` is the grid's number of rows.
    """
    south, west = south_west_deg
    step_lat, step_lon = step_deg

    def grid_of(latitude_rad: Array, longitude_rad: Array) -> tuple[Array, Array]:
        turned = np.degrees(longitude_rad) - west
        # the way round that a grid across the antimeridian, or one from 0 to 360, needs
        turned = (turned + 90.0) % 360.0 - 90.0
        return turned / step_lon, rows - 1 - (np.degrees(latitude_rad) - south) / step_lat

    return grid_of
