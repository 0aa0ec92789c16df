"""Elevation models from GeoTIFF and whatever else rasterio reads, into memory as they are."""

from __future__ import annotations

import importlib
import math
import os
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pyproj

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.errors import ElevationError
from tirgeo_ros.core.locating import Ground
from tirgeo_ros.core.samples import Array
from tirgeo_ros.core.terrain import GridOf, Terrain

PathLike = str | os.PathLike[str]

#: More nodes than this are refused: a quarter of a gigabyte as float32, 80 km2 with 1 m.
MOST_NODES = 64_000_000

#: Metres in a unit of height, by the names that files give it.
_UNITS_M = {
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "metres": 1.0,
    "meters": 1.0,
    "cm": 0.01,
    "ft": 0.3048,
    "foot": 0.3048,
    "feet": 0.3048,
    "us survey foot": 1200 / 3937,
    "us-ft": 1200 / 3937,
    "ftus": 1200 / 3937,
}


def load_terrain(path: PathLike, undulation_m: float = 0.0) -> Terrain:
    """The elevation model of a raster file, in any coordinate system, whole.

    ``undulation_m`` is the height of the file's zero above the ellipsoid; it is added. No data and
    masked pixels become nan. A file's heights are those of its pixels' middles, whether it calls
    them areas or points. ``notes`` of the result says what a person should know of the file: more
    than one band, heights in feet, a vertical datum that is no ellipsoid's.

    Raises ElevationError naming the file where rasterio is not installed, or the file cannot be
    read, has no coordinate system or too many pixels.
    """
    rasterio = _rasterio(path)
    try:
        with rasterio.open(path) as source:
            return _terrain(path, source, undulation_m)
    except (rasterio.errors.RasterioError, OSError) as error:
        first = str(error).partition("\n")[0]
        raise ElevationError(f"{os.fspath(path)}: cannot be read as a raster: {first}") from None


def ground_of(config: OverlayConfig) -> Ground | None:
    """The ground under the map, as the parameters say; None where neither of them does.

    ``ground_height_m`` stands before ``dem``. Raises ElevationError as ``load_terrain``.
    """
    if math.isfinite(config.ground_height_m):
        return config.ground_height_m
    return load_terrain(config.dem, config.dem_undulation_m) if config.dem else None


def _rasterio(path: PathLike) -> Any:
    try:
        return importlib.import_module("rasterio")
    except ImportError:
        raise ElevationError(
            f"{os.fspath(path)}: elevation models need rasterio: pip install 'tirgeo[dem]'"
        ) from None


def _terrain(path: PathLike, source: Any, undulation_m: float) -> Terrain:
    name = os.fspath(path)
    if source.crs is None or source.transform.is_identity:
        raise ElevationError(f"{name}: no coordinate system; give it one (gdal_edit -a_srs)")
    if source.width * source.height > MOST_NODES:
        raise ElevationError(
            f"{name}: {source.width} x {source.height} pixels, more than {MOST_NODES:.2g}; cut "
            "out the flight's surroundings (gdal_translate -projwin)"
        )
    system = _system(name, source)
    unit_m, unit_note = _unit(source)
    heights = _heights(source, unit_m, undulation_m)
    notes = [_bands_note(source), unit_note, _datum_note(system, undulation_m)]
    try:
        said = tuple(f"{name}: {note}" for note in notes if note)
        return Terrain(heights, _grid_of(system, source), said)
    except ElevationError as error:
        raise ElevationError(f"{name}: {error}") from None


def _system(name: str, source: Any) -> pyproj.CRS:
    try:
        return pyproj.CRS.from_user_input(source.crs.to_wkt())
    except pyproj.exceptions.CRSError:
        raise ElevationError(f"{name}: its coordinate system is not known to PROJ") from None


def _heights(source: Any, unit_m: float, undulation_m: float) -> npt.NDArray[np.floating]:
    """The first band in metres above the ellipsoid; nan where there is no height."""
    band = source.read(1, masked=True)
    wide = np.float64 if band.dtype == np.float64 else np.float32  # 0.5 mm on a high mountain
    heights: npt.NDArray[np.floating] = np.ma.filled(band.astype(wide), np.nan)
    scale, offset = source.scales[0] * unit_m, source.offsets[0] * unit_m + undulation_m
    if (scale, offset) != (1.0, 0.0):
        heights = (heights * scale + offset).astype(wide, copy=False)
    heights[~np.isfinite(heights)] = np.nan
    return heights


def _grid_of(system: pyproj.CRS, source: Any) -> GridOf:
    """The way from latitude and longitude to the file's pixels, counted from the first's middle.

    rasterio's transform is that of the pixels' corners, of files of points too.
    """
    flat = pyproj.Transformer.from_crs("EPSG:4326", system.to_2d(), always_xy=True)
    to_pixel = ~source.transform
    a, b, c, d, e, f = (float(x) for x in tuple(to_pixel)[:6])
    unwrapped = _unwrapped(system, source)

    def grid_of(latitude_rad: Array, longitude_rad: Array) -> tuple[Array, Array]:
        x, y = flat.transform(np.degrees(longitude_rad), np.degrees(latitude_rad))
        x = unwrapped(np.where(np.isfinite(x), x, np.nan))
        y = np.where(np.isfinite(y), y, np.nan)
        return a * x + b * y + (c - 0.5), d * x + e * y + (f - 0.5)

    return grid_of


def _unwrapped(system: pyproj.CRS, source: Any) -> Callable[[Array], Array]:
    """What brings a longitude to the turn that the file counts in: 0 to 360, or over 180."""
    if not system.is_geographic:
        return lambda x: x
    unit = system.axis_info[0].unit_conversion_factor  # radians in a unit
    turn = 2 * np.pi / unit
    a, b, c = (float(x) for x in tuple(source.transform)[:3])
    middle = a * source.width / 2 + b * source.height / 2 + c
    return lambda x: middle + (x - middle + turn / 2) % turn - turn / 2


def _bands_note(source: Any) -> str:
    return f"{source.count} bands; the first one is taken" if source.count > 1 else ""


def _unit(source: Any) -> tuple[float, str]:
    """Metres in a unit of the file's heights, and what to tell of it."""
    name = (source.units[0] or "").strip()
    unit_m = _UNITS_M.get(name.lower())
    if unit_m is None and name:
        return 1.0, f"heights in {name!r}, which is not known; they are taken as metres"
    if unit_m not in {None, 1.0}:
        return unit_m or 1.0, f"heights in {name}; they are turned into metres"
    return 1.0, ""


def _datum_note(system: pyproj.CRS, undulation_m: float) -> str:
    """A word where the file says that its heights are no ellipsoid's and nobody corrects them."""
    vertical = [part for part in system.sub_crs_list if part.is_vertical]
    if not vertical or undulation_m:
        return ""
    return f"heights above {vertical[0].name}, not the ellipsoid; set dem_undulation_m"
