"""Read the heights of raster files as one grid: of a single file, or of adjacent tiles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.errors import ElevationError

#: A larger grid is refused: a quarter of a gigabyte as float32.
_MOST_NODES = 64_000_000
_AT_ONCE = 12_000_000  # nodes read from a file at once
#: Largest offset in pixels between the grids of two tiles. The surface moves by as much.
_OFF_PIXELS = 0.01

Heights = npt.NDArray[np.floating]
#: Converts errors on reading a named file into those of this package.
Guard = Callable[[str], AbstractContextManager[None]]


@dataclass(frozen=True, slots=True)
class Tile:
    """Hold an open file and the conversion of its numbers to metres above the ellipsoid."""

    name: str
    source: Any  # of rasterio
    scale: float
    offset_m: float


class _Placed(NamedTuple):
    tile: Tile
    column: int  # of its first pixel on the grid
    row: int


def read_grid(tiles: Sequence[Tile], guard: Guard) -> tuple[Heights, Any]:
    """Return heights (rows, columns) of tiles on one grid, nan where absent, and its transform.

    Where tiles overlap, the first that has a height is used. Raises ElevationError, naming the
    tile, for one of another system or another grid than the first one's, and for a grid too large.
    """
    corners = [_corner(tile, tiles[0]) for tile in tiles]
    left, top = (min(each) for each in zip(*corners, strict=True))
    placed = [
        _Placed(tile, column - left, row - top)
        for tile, (column, row) in zip(tiles, corners, strict=True)
    ]
    columns = max(each.column + each.tile.source.width for each in placed)
    rows = max(each.row + each.tile.source.height for each in placed)
    if rows * columns > _MOST_NODES:
        raise ElevationError(
            f"{tiles[0].name}: {columns} x {rows} pixels, more than the {_MOST_NODES / 1e6:g} "
            "million allowed; cut out the area of the flight (gdal_translate -projwin)"
        )
    heights = np.full((rows, columns), np.nan, np.result_type(*map(_dtype, tiles)))
    for each in reversed(placed):
        with guard(each.tile.name):
            _paste(each, heights)
    transform = tiles[0].source.transform
    return heights, transform * type(transform).translation(left, top)


def _corner(tile: Tile, first: Tile) -> tuple[int, int]:
    """Return column and row of a tile's first pixel on the first one's grid."""
    source = tile.source
    if source.crs != first.source.crs:
        raise ElevationError(
            f"{tile.name}: a different coordinate system from that of {first.name}; "
            "convert the tiles to one (gdalwarp -t_srs)"
        )
    to_grid = ~first.source.transform * source.transform
    places = [(0, 0), (source.width, 0), (0, source.height)]
    moves = np.array([to_grid * place for place in places]) - places
    moves[:, 0] -= _turn(first.source, moves[0, 0])
    corner = moves[0].round()
    if np.abs(moves - corner).max() > _OFF_PIXELS:
        raise ElevationError(
            f"{tile.name}: its pixels are not on the grid of {first.name}; merge the "
            "tiles (gdalwarp A.tif B.tif OUT.tif)"
        )
    column, row = corner.astype(int).tolist()
    return column, row


def _turn(source: Any, columns: float) -> float:
    """Return the part of ``columns`` that is whole turns of the Earth, for tiles at 180 deg."""
    a, b = (float(x) for x in tuple(source.transform)[:2])
    if not source.crs.is_geographic or b:
        return 0.0
    return round(columns * a / 360) * 360 / a


def _dtype(tile: Tile) -> type[np.floating]:
    """Return a type as wide as the file's; float32 resolves 0.5 mm on a high mountain."""
    return np.float64 if tile.source.dtypes[0] == "float64" else np.float32


def _paste(placed: _Placed, heights: Heights) -> None:
    """Copy a tile's finite heights into the grid, some rows at a time."""
    source = placed.tile.source
    step = max(_AT_ONCE // source.width, 1)
    columns = slice(placed.column, placed.column + source.width)
    for first in range(0, source.height, step):
        window = ((first, min(first + step, source.height)), (0, source.width))
        part = _heights(placed.tile, source.read(1, masked=True, window=window))
        row = placed.row + first
        place = heights[row : row + len(part), columns]
        np.copyto(place, part, where=np.isfinite(part))


def _heights(tile: Tile, band: Any) -> Heights:
    """Convert numbers of a file to metres above the ellipsoid; nan where there is no height."""
    heights: Heights = np.ma.filled(band.astype(_dtype(tile), copy=False), np.nan)
    if (tile.scale, tile.offset_m) != (1.0, 0.0):
        heights = (heights * tile.scale + tile.offset_m).astype(heights.dtype, copy=False)
    heights[~np.isfinite(heights)] = np.nan
    return heights
