"""Write an orthophoto in a plane as a GeoTIFF, by GDAL's warper, however large it is.

Only pixels within the hull of the control points are written: outside it the polynomial is
meaningless, and the last band (alpha) is zero there.
"""

from __future__ import annotations

import importlib
import math
import os
import uuid
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.polynomial_transform import PolynomialTransform
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.io.files.offline_reading import imported_rasterio, read_map
from tirgeo_ros.io.files.whole_files import PathLike, check_place, part_of

_TILE = 512
#: Points along either side of the hull's box at which GDAL is given the polynomial's positions;
#: between them it uses a thin plate spline, and lines where these are as near as _TOLERANCE_PX.
_KNOTS = 16
_TOLERANCE_PX = 0.02


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
    rasterio = imported_rasterio(f"{os.fspath(image)}: a GeoTIFF needs", MapError)
    check_place(out, MapError)
    part = part_of(out)
    try:
        with _opened(rasterio, image) as source:
            _check_size(image, source, found)
            profile = _profile(rasterio, source, found, pixel_m) | {"crs": plane.system.to_wkt()}
            with rasterio.open(part, "w", **profile) as target:
                _warp(rasterio, source, target, found)
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
        with rasterio.open(image) as source:
            yield source


def _check_size(image: PathLike, source: Any, found: PolynomialTransform) -> None:
    size = np.array([source.width, source.height])
    if (found.hull_px < -1).any() or (found.hull_px > size + 1).any():
        raise MapError(
            f"{os.fspath(image)}: control points lie outside its {size[0]} x {size[1]} pixels; "
            "give the picture that they were marked on"
        )


def _profile(
    rasterio: Any, source: Any, found: PolynomialTransform, pixel_m: float
) -> dict[str, Any]:
    """Return the GeoTIFF's form: north up, square pixels, over the hull's bounding box."""
    begin, end = found.hull_px, np.roll(found.hull_px, -1, axis=0)
    along = np.linspace(0, 1, 50)[:, None, None]  # the hull's edges are curves in the plane
    rim = found((begin + along * (end - begin)).reshape(-1, 2))
    (west, south), (east, north) = rim.min(axis=0).tolist(), rim.max(axis=0).tolist()
    colours = min(source.count, 3)
    return {
        "driver": "GTiff",
        "width": math.ceil((east - west) / pixel_m),
        "height": math.ceil((north - south) / pixel_m),
        "count": colours + 1,
        "dtype": source.dtypes[0],
        "transform": rasterio.Affine(pixel_m, 0, west, 0, -pixel_m, north),
        "photometric": "RGB" if colours == 3 else "MINISBLACK",
        "alpha": "YES",
        "tiled": True,
        "blockxsize": _TILE,
        "blockysize": _TILE,
        "compress": "DEFLATE",
        "bigtiff": "IF_SAFER",
    }


def _warp(rasterio: Any, source: Any, target: Any, found: PolynomialTransform) -> None:
    """Fill the target within the hull of the control points."""
    control, shutil, warp = (
        importlib.import_module(f"rasterio.{name}") for name in ("control", "shutil", "warp")
    )
    sides = np.linspace(found.hull_px.min(axis=0), found.hull_px.max(axis=0), _KNOTS).T
    pixels = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    points = [
        control.GroundControlPoint(row=row, col=column, x=x, y=y)
        for (column, row), (x, y) in zip(pixels.tolist(), found(pixels).tolist(), strict=True)
    ]
    rim = ", ".join(f"{column} {row}" for column, row in [*found.hull_px, found.hull_px[0]])
    bands = list(range(1, target.count))
    placed = f"/vsimem/{uuid.uuid4()}.vrt"  # the picture with these points, in memory
    shutil.copy(source, placed, driver="VRT")
    try:
        with rasterio.open(placed, "r+") as picture:
            picture.gcps = points, target.crs
            picture.nodata = None  # within the hull every pixel is shown
        with rasterio.open(placed) as picture:
            warp.reproject(
                rasterio.band(picture, bands),
                rasterio.band(target, bands),
                dst_alpha=target.count,
                resampling=warp.Resampling.bilinear,
                tolerance=_TOLERANCE_PX,
                SRC_METHOD="GCP_TPS",
                CUTLINE=f"POLYGON (({rim}))",
            )
    finally:
        shutil.delete(placed)
