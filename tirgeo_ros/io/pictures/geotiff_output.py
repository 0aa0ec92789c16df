"""Write an orthophoto in a plane as a GeoTIFF; GDAL warps it, however large it is.

Only pixels within the hull of the control points are written: outside it the polynomial is
meaningless, and the last band (alpha) is zero there.
"""

from __future__ import annotations

import importlib
import math
import os
import warnings
from functools import partial
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.orthophoto.polynomial_transform import PolynomialTransform
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.projected_planes import Plane
from tirgeo_ros.io.files.offline_reading import check_closed, read_map
from tirgeo_ros.io.files.whole_files import PathLike, check_place, part_of

#: Places on each side of the hull's box that GDAL gets of the polynomial. It joins them by a
#: thin-plate spline: a bend of 15 px over 1500 px is met to 0.16 px, with 25 places no better.
_KNOTS = 15
_MEMORY_MB = 256


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
    try:
        rasterio = importlib.import_module("rasterio")
        for part_of_it in ("control", "shutil", "warp"):
            importlib.import_module(f"rasterio.{part_of_it}")
    except ImportError:
        raise MapError(
            f"{os.fspath(image)}: a GeoTIFF needs rasterio: pip install 'tirgeo[dem]'"
        ) from None
    check_closed()
    check_place(out, MapError)
    part = part_of(out)
    try:
        with warnings.catch_warnings():  # it has no coordinates yet: to add them is the purpose
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            source = rasterio.open(image)
        with source:
            _check_size(image, source, found)
            profile = _profile(rasterio, source, found, plane, pixel_m)
            with rasterio.open(part, "w", **profile) as target:
                _warp(rasterio, source, target, found)
        part.replace(out)
    except (rasterio.errors.RasterioError, OSError) as error:
        first = str(error).partition("\n")[0]
        raise MapError(f"{os.fspath(image)} to {os.fspath(out)}: {first}") from None
    finally:
        part.unlink(missing_ok=True)


def _check_size(image: PathLike, source: Any, found: PolynomialTransform) -> None:
    size = np.array([source.width, source.height])
    if (found.hull_px < -1).any() or (found.hull_px > size + 1).any():
        raise MapError(
            f"{os.fspath(image)}: control points lie outside its {size[0]} x {size[1]} pixels; "
            "give the picture that they were marked on"
        )


def _profile(
    rasterio: Any, source: Any, found: PolynomialTransform, plane: Plane, pixel_m: float
) -> dict[str, Any]:
    """Return the form of the GeoTIFF: north up, over the bounding box of the hull."""
    # The hull's edges are curves in the plane: they are sampled at many points.
    begin, end = found.hull_px, np.roll(found.hull_px, -1, axis=0)
    along = np.linspace(0, 1, 50)[:, None, None]
    rim = found((begin + along * (end - begin)).reshape(-1, 2))
    (west, south), (east, north) = rim.min(axis=0).tolist(), rim.max(axis=0).tolist()
    colours = min(source.count, 3)
    return {
        "driver": "GTiff",
        "width": math.ceil((east - west) / pixel_m),
        "height": math.ceil((north - south) / pixel_m),
        "count": colours + 1,
        "dtype": source.dtypes[0],
        "crs": plane.system.to_wkt(),
        "transform": rasterio.Affine(pixel_m, 0, west, 0, -pixel_m, north),
        "photometric": "RGB" if colours == 3 else "MINISBLACK",
        "alpha": "YES",
        "tiled": True,
        "compress": "DEFLATE",
        "bigtiff": "IF_SAFER",
    }


def _warp(rasterio: Any, source: Any, target: Any, found: PolynomialTransform) -> None:
    low, high = found.hull_px.min(axis=0), found.hull_px.max(axis=0)
    pixels = np.stack(np.meshgrid(*np.linspace(low, high, _KNOTS).T), axis=-1).reshape(-1, 2)
    points = [
        rasterio.control.GroundControlPoint(row=row, col=column, x=x, y=y)
        for (column, row), (x, y) in zip(pixels.tolist(), found(pixels).tolist(), strict=True)
    ]
    ring = ", ".join(f"{u:.9g} {v:.9g}" for u, v in [*found.hull_px, found.hull_px[0]])
    bands = list(range(1, target.count))
    with rasterio.MemoryFile(ext=".vrt") as marked:
        rasterio.shutil.copy(source, marked.name, driver="VRT")
        with rasterio.open(marked.name, "r+") as picture:
            picture.gcps = points, target.crs
        with rasterio.open(marked.name) as picture:
            rasterio.warp.reproject(
                rasterio.band(picture, bands),
                rasterio.band(target, bands),
                dst_alpha=target.count,
                resampling=rasterio.warp.Resampling.bilinear,
                warp_mem_limit=_MEMORY_MB,
                METHOD="GCP_TPS",
                CUTLINE=f"POLYGON (({ring}))",
            )
