"""Read the heights of raster files as one grid: of a single file, or of adjacent tiles."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.errors import ElevationError

#: A grid with more nodes is kept in a mapped file, and read where it is accessed: as float32 a
#: quarter of a gigabyte.
MOST_IN_MEMORY = 64_000_000
#: A larger grid is refused: it would take more than some seconds to read and to search.
_MOST_BYTES = 600_000_000
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
    tile, for one of another system or another grid than the first one's, and if there is no room.
    """
    corners = [_corner(tile, tiles[0]) for tile in tiles]
    left, top = (min(each) for each in zip(*corners, strict=True))
    placed = [
        _Placed(tile, column - left, row - top)
        for tile, (column, row) in zip(tiles, corners, strict=True)
    ]
    columns = max(each.column + each.tile.source.width for each in placed)
    rows = max(each.row + each.tile.source.height for each in placed)
    dtype = np.result_type(*map(_dtype, tiles))
    if rows * columns * dtype.itemsize > _MOST_BYTES:
        raise ElevationError(
            f"{tiles[0].name}: {columns} x {rows} pixels, and at most "
            f"{_MOST_BYTES // dtype.itemsize / 1e6:g} million are taken; cut out the flight's "
            "surroundings (gdal_translate -projwin)"
        )
    strips = _strips(placed, (rows, columns), dtype, guard)
    heights = _kept(strips, (rows, columns), dtype, tiles[0].name)
    transform = tiles[0].source.transform
    return heights, transform * type(transform).translation(left, top)


def _corner(tile: Tile, first: Tile) -> tuple[int, int]:
    """Return column and row of a tile's first pixel on the first one's grid."""
    source = tile.source
    if source.crs != first.source.crs:
        raise ElevationError(
            f"{tile.name}: another coordinate system than that of {first.name}; bring the tiles "
            "into one (gdalwarp -t_srs)"
        )
    to_grid = ~first.source.transform * source.transform
    places = [(0, 0), (source.width, 0), (0, source.height)]
    moves = np.array([to_grid * place for place in places]) - places
    moves[:, 0] -= _turn(first.source, moves[0, 0])
    corner = moves[0].round()
    if np.abs(moves - corner).max() > _OFF_PIXELS:
        raise ElevationError(
            f"{tile.name}: its pixels are not on the grid of {first.name}; make one model of the "
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


def _strips(
    placed: Sequence[_Placed], shape: tuple[int, int], dtype: npt.DTypeLike, guard: Guard
) -> Iterator[Heights]:
    """Yield the grid from its first row to its last, some rows at a time."""
    rows, columns = shape
    step = max(_AT_ONCE // columns, 1)
    block = placed[0].tile.source.block_shapes[0][0]
    step = max(step // block * block, min(block, step))  # do not cut a block if it fits
    for begin in range(0, rows, step):
        strip = np.full((min(step, rows - begin), columns), np.nan, dtype)
        for each in reversed(placed):
            with guard(each.tile.name):
                _paste(each, strip, begin)
        yield strip


def _paste(placed: _Placed, strip: Heights, begin: int) -> None:
    """Copy a tile's finite heights into a strip of the grid that begins at row ``begin``."""
    source = placed.tile.source
    first = max(begin - placed.row, 0)
    last = min(begin + len(strip) - placed.row, source.height)
    if first < last:
        window = ((first, last), (0, source.width))
        part = _heights(placed.tile, source.read(1, masked=True, window=window))
        row = first + placed.row - begin
        place = strip[row : row + len(part), placed.column : placed.column + source.width]
        np.copyto(place, part, where=np.isfinite(part))


def _kept(
    strips: Iterator[Heights], shape: tuple[int, int], dtype: npt.DTypeLike, name: str
) -> Heights:
    """Return strips as one array, in memory or in an unnamed file that is deleted with it."""
    if shape[0] * shape[1] <= MOST_IN_MEMORY:
        heights = np.empty(shape, dtype)
        row = 0
        for strip in strips:
            heights[row : row + len(strip)] = strip
            row += len(strip)
        return heights
    size = shape[0] * shape[1] * np.dtype(dtype).itemsize
    with tempfile.TemporaryFile(prefix="tirgeo-dem-") as file:
        try:
            # fails now if there is no room, not half-way
            os.posix_fallocate(file.fileno(), 0, size)
            for strip in strips:
                file.write(strip.data)
        except OSError as error:
            raise ElevationError(
                f"{name}: {shape[1]} x {shape[0]} pixels need {size / 1e9:.1f} GB in "
                f"{tempfile.gettempdir()} ({error.strerror}); cut out the flight's surroundings "
                "(gdal_translate -projwin), or name a folder with room in TMPDIR"
            ) from None
        file.flush()
        return np.memmap(file, dtype, "r", shape=shape)


def _heights(tile: Tile, band: Any) -> Heights:
    """Convert numbers of a file to metres above the ellipsoid; nan where there is no height."""
    heights: Heights = np.ma.filled(band.astype(_dtype(tile), copy=False), np.nan)
    if (tile.scale, tile.offset_m) != (1.0, 0.0):
        heights = (heights * tile.scale + tile.offset_m).astype(heights.dtype, copy=False)
    heights[~np.isfinite(heights)] = np.nan
    return heights
