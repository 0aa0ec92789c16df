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
"""Load elevation models from GeoTIFF and whatever else rasterio reads, without resampling."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyproj

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.ground.backprojection import GridOf, Ground, Terrain
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ElevationError, MapError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.coordinates.crs import checked_system
from tirgeo_ros.io.files.bounded_reading import bounded_memory, elsewhere, read_map
from tirgeo_ros.io.files.whole_files import PathLike, named_files, path_of

#: A larger grid is refused: a quarter of a gigabyte as float32.
_MOST_NODES = 64_000_000
_AT_ONCE = 12_000_000  # nodes read from a file at once
#: Largest offset in pixels between the grids of two tiles. The surface moves by as much.
_OFF_PIXELS = 0.01
#: Cache of what GDAL has unpacked: each pixel is read once. By default it is 5 % of all memory.
_CACHE_MB = 64
#: Metres in a unit of height, by the names that files use.
_UNITS_M = {
    **dict.fromkeys(("", "m", "metre", "meter", "metres", "meters"), 1.0),
    "cm": 0.01,
    **dict.fromkeys(("ft", "foot", "feet"), 0.3048),
    **dict.fromkeys(("us survey foot", "us-ft", "ftus"), 1200 / 3937),
}


class _Tile(NamedTuple):
    """Hold an open file and the conversion of its numbers to metres above the ellipsoid."""

    name: str
    source: Any  # of rasterio
    system: pyproj.CRS
    scale: float
    offset_m: float
    notes: list[str]  # for a person

    @property
    def dtype(self) -> type[np.floating]:
        """Return a type as wide as the file's; float32 resolves 0.5 mm on a high mountain."""
        return np.float64 if self.source.dtypes[0] == "float64" else np.float32


def load_terrain(dem: PathLike, undulation_m: float = 0.0, *, network: bool = False) -> Terrain:
    """Load the whole elevation model of a raster file, in any coordinate system.

    ``dem`` is a file, or several with commas: tiles of one grid; where they overlap, the first
    with a height is used. ``undulation_m`` is the height of the files' zero above the ellipsoid;
    it is added. No data and masked pixels become nan. A file's heights are those of its pixel
    centres, whether it calls its pixels areas or points. ``notes`` of the result tells a person of
    several bands, heights in feet, a vertical datum that is not an ellipsoid's. ``network``:
    places on the network that a file names may be fetched.

    Raises ElevationError, naming the file, if rasterio is not installed, or if the file cannot be
    read, has no coordinate system of the Earth, or is too large.
    """
    path_of(dem, ElevationError)
    paths = named_files(os.fspath(dem))
    if not paths:
        raise ElevationError(f"{os.fspath(dem)!r}: does not name an elevation model")
    try:
        with bounded_memory():
            return read_map(partial(_loaded, paths, undulation_m), network=network)
    except MemoryError:
        raise ElevationError(f"{paths[0]}: does not fit into memory") from None


def ground_of(config: OverlayConfig) -> Ground | None:
    """Return the ground by ``ground_height_m``, else by ``dem``; None if neither is set.

    Raises ElevationError as ``load_terrain``.
    """
    if math.isfinite(config.ground_height_m):
        return config.ground_height_m
    if not config.dem:
        return None
    return load_terrain(config.dem, config.dem_undulation_m, network=config.network)


def _loaded(paths: list[str], undulation_m: float) -> Terrain:
    rasterio = needed("rasterio", f"reading {paths[0]}", ElevationError)
    with ExitStack() as opened:
        opened.enter_context(rasterio.Env(GDAL_CACHEMAX=_CACHE_MB))
        tiles = []
        for path in paths:
            with _readable(rasterio, path):
                source = opened.enter_context(rasterio.open(path))
            tiles.append(_tile(path, source, undulation_m))
        heights, transform = _read_grid(rasterio, tiles)
    owners: dict[str, list[str]] = {}
    for tile in tiles:
        for note in tile.notes:
            owners.setdefault(note, []).append(tile.name)
    notes = tuple(
        f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}: {note}"
        for note, names in owners.items()
    )
    name, system = tiles[0].name, tiles[0].system
    try:
        return Terrain(heights, _grid_of(system, transform, heights.shape), notes)
    except ElevationError as error:
        raise ElevationError(f"{name}: {error}") from None
    except pyproj.exceptions.ProjError:
        raise ElevationError(
            f"{name}: cannot be transformed from WGS84 to its coordinate system {system.name!r}: "
            "is it of the Earth?"
        ) from None


@contextmanager
def _readable(rasterio: Any, path: str) -> Iterator[None]:
    try:
        yield
    except (rasterio.errors.RasterioError, OSError) as error:
        first = str(error).partition("\n")[0]
        hint = elsewhere(f"{path} {first}")
        raise ElevationError(f"{path}: cannot be read as a raster: {first}{hint}") from None


def _tile(path: str, source: Any, undulation_m: float) -> _Tile:
    """Return an open file as a tile. Raises ElevationError without position or heights."""
    remedy = "give it one (gdal_edit -a_srs)"
    if source.crs is None or source.transform.is_identity:
        raise ElevationError(f"{path}: no coordinate system; {remedy}")
    a, b, c, d, e, f = (float(x) for x in tuple(source.transform)[:6])
    if not all(map(math.isfinite, (c, f, a * e - b * d))) or not a * e - b * d:
        raise ElevationError(f"{path}: its pixels cover no ground; place it (gdal_edit -a_ullr)")
    if source.dtypes[0].startswith("complex"):
        raise ElevationError(f"{path}: complex numbers are not heights")
    try:
        system = checked_system(source.crs.to_wkt(), path)
    except MapError as error:
        raise ElevationError(f"{str(error).partition(';')[0]}; {remedy}") from None
    notes = [f"{source.count} bands; the first is used"] if source.count > 1 else []
    unit = (source.units[0] or "").strip()
    unit_m = _UNITS_M.get(unit.lower())
    if unit_m is None:
        notes.append(f"heights in the unknown unit {unit!r}; they are taken as metres")
        unit_m = 1.0
    elif unit_m != 1.0:
        notes.append(f"heights in {unit}; they are converted to metres")
    vertical = [part for part in system.sub_crs_list if part.is_vertical]
    if vertical and not undulation_m:
        datum = vertical[0].name
        notes.append(f"heights above {datum}, not the ellipsoid; set dem_undulation_m")
    scale, offset_m = source.scales[0] * unit_m, source.offsets[0] * unit_m + undulation_m
    return _Tile(path, source, system, scale, offset_m, notes)


def _read_grid(rasterio: Any, tiles: Sequence[_Tile]) -> tuple[npt.NDArray[np.floating], Any]:
    """Return heights (rows, columns) of tiles on one grid, nan where absent, and its transform.

    Where tiles overlap, the first with a height is used. Raises ElevationError, naming the tile,
    if its coordinate system or grid is not that of the first, or if the grid is too large.
    """
    corners = np.array([_corner(tile, tiles[0]) for tile in tiles])
    left, top = corners.min(axis=0).tolist()
    sizes = [(tile.source.width, tile.source.height) for tile in tiles]
    columns, rows = ((corners + sizes).max(axis=0) - [left, top]).tolist()
    if rows * columns > _MOST_NODES:
        raise ElevationError(
            f"{tiles[0].name}: {columns} x {rows} pixels, more than the {_MOST_NODES / 1e6:g} "
            "million allowed; cut out the area of the flight (gdal_translate -projwin)"
        )
    heights = np.full((rows, columns), np.nan, np.result_type(*(tile.dtype for tile in tiles)))
    for tile, (column, row) in reversed(list(zip(tiles, corners.tolist(), strict=True))):
        with _readable(rasterio, tile.name):
            _paste(tile, heights[row - top :, column - left :])
    transform = tiles[0].source.transform
    return heights, transform * type(transform).translation(left, top)


def _corner(tile: _Tile, first: _Tile) -> tuple[int, int]:
    """Return column and row of a tile's first pixel on the first tile's grid."""
    source = tile.source
    if source.crs != first.source.crs:
        raise ElevationError(
            f"{tile.name}: a different coordinate system from that of {first.name}; "
            "convert the tiles to one (gdalwarp -t_srs)"
        )
    to_grid = ~first.source.transform * source.transform
    places = [(0, 0), (source.width, 0), (0, source.height)]
    moves = np.array([to_grid * place for place in places]) - places
    corner = moves[0].round()
    if np.abs(moves - corner).max() > _OFF_PIXELS:
        raise ElevationError(
            f"{tile.name}: its pixels are not on the grid of {first.name}; merge the "
            "tiles (gdalwarp A.tif B.tif OUT.tif)"
        )
    column, row = corner.astype(int).tolist()
    return column, row


def _paste(tile: _Tile, heights: npt.NDArray[np.floating]) -> None:
    """Copy a tile's heights into the upper left of a grid, some rows at a time."""
    source = tile.source
    step = max(_AT_ONCE // source.width, 1)
    for first in range(0, source.height, step):
        window = ((first, min(first + step, source.height)), (0, source.width))
        band = source.read(1, masked=True, window=window)
        part = np.ma.filled(band.astype(tile.dtype, copy=False), np.nan)
        if (tile.scale, tile.offset_m) != (1.0, 0.0):
            part = (part * tile.scale + tile.offset_m).astype(part.dtype, copy=False)
        place = heights[first : first + len(part), : source.width]
        np.copyto(place, part, where=np.isfinite(part))


def _grid_of(system: pyproj.CRS, transform: Any, shape: tuple[int, ...]) -> GridOf:
    """Return the function from latitude and longitude (rad) to the file's column and row.

    They count from the centre of the first pixel. rasterio's transform is for pixel corners, even
    in files of points.
    """
    flat = pyproj.Transformer.from_crs("EPSG:4326", system.to_2d(), always_xy=True)
    a, b, c, d, e, f = (float(x) for x in tuple(~transform)[:6])
    middle, _ = transform * (shape[1] / 2, shape[0] / 2)
    turn = math.inf
    if system.is_geographic:  # longitudes are wrapped to the file's, which may go beyond 180
        turn = 2 * np.pi / system.axis_info[0].unit_conversion_factor  # radians in a unit

    def grid_of(latitude_rad: Array, longitude_rad: Array) -> tuple[Array, Array]:
        x, y = flat.transform(np.degrees(longitude_rad), np.degrees(latitude_rad))
        x = np.where(np.isfinite(x), x, np.nan)
        if math.isfinite(turn):
            x = middle + (x - middle + turn / 2) % turn - turn / 2
        y = np.where(np.isfinite(y), y, np.nan)
        return a * x + b * y + (c - 0.5), d * x + e * y + (f - 0.5)

    return grid_of
