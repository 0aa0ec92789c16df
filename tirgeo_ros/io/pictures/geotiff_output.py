"""Write an orthophoto in a plane as a GeoTIFF, tile by tile, however large it is.

Only pixels within the hull of the control points are written: outside it the polynomial is
meaningless, and the fourth band (alpha) is zero there.
"""

from __future__ import annotations

import importlib
import math
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.calibration.orthophoto.polynomial_inverse import pixels_of
from tirgeo_ros.core.calibration.orthophoto.polynomial_transform import PolynomialTransform
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.projected_planes import Plane
from tirgeo_ros.io.files.offline_reading import check_closed, read_map
from tirgeo_ros.io.files.whole_files import PathLike, check_place, part_of

_TILE = 512
#: Spacing in pixels of the computed positions, with interpolation between them: a bend of 20 px
#: over a picture of 7000 px leaves an error of 1e-3 px.
_KNOTS = 32
_RIM = 2  # pixels that interpolation reads beyond those it hits


class _Grid(NamedTuple):
    """Hold the pixel grid of the GeoTIFF: north up, square pixels."""

    west_m: float
    north_m: float
    pixel_m: float
    columns: int
    rows: int

    def metres(self, columns: Array, rows: Array) -> Array:
        """Return the coordinates (rows, columns, 2), m, of pixel corners with these numbers."""
        x, y = np.meshgrid(
            self.west_m + columns * self.pixel_m, self.north_m - rows * self.pixel_m
        )
        return np.stack([x, y], axis=-1)


def write_warped(
    image: PathLike, out: PathLike, found: PolynomialTransform, plane: Plane, pixel_m: float
) -> None:
    """Write a picture (one to four bands) as a GeoTIFF with pixels of ``pixel_m``.

    Raises MapError where rasterio is not installed or a file cannot be read or written; then no
    file is left under the name. A picture on the network is not fetched.
    """
    read_map(partial(_write, image, out, found, plane, pixel_m), network=False)


def _write(
    image: PathLike, out: PathLike, found: PolynomialTransform, plane: Plane, pixel_m: float
) -> None:
    rasterio = _rasterio(image)
    check_closed()
    check_place(out, MapError)
    part = part_of(out)
    try:
        with _opened(rasterio, image) as source:
            _check_size(image, source, found)
            grid = _grid(found, pixel_m)
            with rasterio.open(part, "w", **_profile(rasterio, source, grid, plane)) as target:
                _fill(rasterio, source, target, found, grid)
        part.replace(out)
    except (rasterio.errors.RasterioError, OSError) as error:
        first = str(error).partition("\n")[0]
        raise MapError(f"{os.fspath(image)} to {os.fspath(out)}: {first}") from None
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def _opened(rasterio: Any, image: PathLike) -> Iterator[Any]:
    with warnings.catch_warnings():  # it has no coordinates yet: to add them is the purpose here
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        source = rasterio.open(image)
    with source:
        yield source


def _check_size(image: PathLike, source: Any, found: PolynomialTransform) -> None:
    size = np.array([source.width, source.height])
    if (found.hull_px < -1).any() or (found.hull_px > size + 1).any():
        raise MapError(
            f"{os.fspath(image)}: control points lie outside its {size[0]} x {size[1]} pixels; "
            "give the picture that they were marked on"
        )


def _rasterio(image: PathLike) -> Any:
    try:
        return importlib.import_module("rasterio")
    except ImportError:
        raise MapError(
            f"{os.fspath(image)}: a GeoTIFF needs rasterio: pip install 'tirgeo[dem]'"
        ) from None


def _grid(found: PolynomialTransform, pixel_m: float) -> _Grid:
    """Return the bounding box of the hull, whose edges are curves: sampled at many points."""
    begin, end = found.hull_px, np.roll(found.hull_px, -1, axis=0)
    along = np.linspace(0, 1, 50)[:, None, None]
    rim = found((begin + along * (end - begin)).reshape(-1, 2))
    (west, south), (east, north) = rim.min(axis=0), rim.max(axis=0)
    columns, rows = math.ceil((east - west) / pixel_m), math.ceil((north - south) / pixel_m)
    return _Grid(float(west), float(north), pixel_m, columns, rows)


def _profile(rasterio: Any, source: Any, grid: _Grid, plane: Plane) -> dict[str, Any]:
    colours = min(source.count, 3)
    return {
        "driver": "GTiff",
        "width": grid.columns,
        "height": grid.rows,
        "count": colours + 1,
        "dtype": source.dtypes[0],
        "crs": plane.system.to_wkt(),
        "transform": rasterio.Affine(grid.pixel_m, 0, grid.west_m, 0, -grid.pixel_m, grid.north_m),
        "photometric": "RGB" if colours == 3 else "MINISBLACK",
        "alpha": "YES",
        "tiled": True,
        "blockxsize": _TILE,
        "blockysize": _TILE,
        "compress": "DEFLATE",
        "bigtiff": "IF_SAFER",
    }


def _fill(
    rasterio: Any, source: Any, target: Any, found: PolynomialTransform, grid: _Grid
) -> None:
    bands = list(range(1, target.count))
    full = np.iinfo(target.dtypes[0]).max if np.dtype(target.dtypes[0]).kind == "u" else 1
    for column, row, width, height in _tiles(grid):
        places = _places(found, grid, column, row, width, height)
        inside = found.inside(places.reshape(-1, 2)).reshape(height, width)
        inside &= np.isfinite(places).all(axis=-1)
        window = _source_window(rasterio, source, places[inside])
        if window is None:
            continue
        # Pixel centres for OpenCV, which counts from the centre of the first pixel.
        maps = (places - [window.col_off, window.row_off] - 0.5).astype(np.float32)
        maps[~inside] = -1e4
        pixels = np.moveaxis(source.read(bands, window=window), 0, -1)
        drawn = cv2.remap(pixels, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR)
        drawn = np.asarray(drawn).reshape(height, width, len(bands))
        alpha = (inside * full).astype(drawn.dtype)
        to = rasterio.windows.Window(column, row, width, height)
        target.write(np.concatenate([np.moveaxis(drawn, -1, 0), alpha[None]]), window=to)


def _tiles(grid: _Grid) -> Iterator[tuple[int, int, int, int]]:
    for row in range(0, grid.rows, _TILE):
        for column in range(0, grid.columns, _TILE):
            yield column, row, min(_TILE, grid.columns - column), min(_TILE, grid.rows - row)


def _places(
    found: PolynomialTransform, grid: _Grid, column: int, row: int, width: int, height: int
) -> Array:
    """Return (height, width, 2): the picture's pixels at the centres of a tile's pixels."""
    across, down = -(-width // _KNOTS) + 1, -(-height // _KNOTS) + 1
    columns = column + np.arange(across, dtype=float) * _KNOTS
    rows = row + np.arange(down, dtype=float) * _KNOTS
    knots = pixels_of(found, grid.metres(columns, rows).reshape(-1, 2)).reshape(down, across, 2)
    x, y = (np.arange(size) + 0.5 for size in (width, height))
    i, u = np.divmod(x / _KNOTS, 1.0)
    j, v = np.divmod(y / _KNOTS, 1.0)
    i, j = i.astype(int), j.astype(int)
    left = knots[:, i] + u[:, None] * (knots[:, i + 1] - knots[:, i])
    return np.asarray(left[j] + v[:, None, None] * (left[j + 1] - left[j]))


def _source_window(rasterio: Any, source: Any, places: Array) -> Any:
    """Return the part of the picture that holds these pixels; None if there is none."""
    if not len(places):
        return None
    low = np.maximum(np.floor(places.min(axis=0)).astype(int) - _RIM, 0)
    high = np.minimum(
        np.ceil(places.max(axis=0)).astype(int) + _RIM, [source.width, source.height]
    )
    if (high <= low).any():
        return None
    return rasterio.windows.Window(*low.tolist(), *(high - low).tolist())
