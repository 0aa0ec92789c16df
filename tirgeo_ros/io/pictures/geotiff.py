"""Write GeoTIFFs by GDAL: rasters tile by tile (Cloud-Optimised), and warped orthophotos.

Whole numbers get an alpha band as the last one, which is 0 where nothing is known; floats are nan
there, which is declared as no data. Of an orthophoto only the hull of the control points is known:
outside it the polynomial is meaningless.
"""

from __future__ import annotations

import importlib
import math
import os
import uuid
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.calibration.polynomial_transform import PolynomialTransform
from tirgeo_ros.core.types.arrays import BoolArray
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.io.files.bounded_reading import imported_rasterio, read_map
from tirgeo_ros.io.files.whole_files import PathLike, check_place, part_of

_BLOCK_PX = 512
_TILED = {
    "driver": "GTiff",
    "tiled": True,
    "blockxsize": _BLOCK_PX,
    "blockysize": _BLOCK_PX,
    "compress": "DEFLATE",
    "bigtiff": "IF_SAFER",
}
#: GDAL's cache of unpacked blocks. By default it is 5 % of all memory.
CACHE_MB = 64


class RasterPart(NamedTuple):
    """Hold a rectangle of a raster: its first column and row, its values, and which are known."""

    column: int
    row: int
    values: npt.NDArray[Any]  # (h, w, bands)
    known: BoolArray  # (h, w)


@dataclass(frozen=True)
class RasterForm:
    """Describe a raster: its place, north up with square pixels, and its kind of values."""

    crs_wkt: str
    pixel_m: float
    west_m: float  # x of the left edge
    north_m: float  # y of the upper edge
    width: int
    height: int
    bands: int  # 1, or 3: red, green, blue
    dtype: str  # uint8, uint16 or float32
    unit: str = ""  # of the values
    tags: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_float(self) -> bool:
        """Return whether nan marks unknown pixels, in place of an alpha band."""
        return self.dtype.startswith("float")


def write_cog(path: PathLike, form: RasterForm, parts: Iterable[RasterPart]) -> None:
    """Write a raster from its parts, which must not overlap; what no part covers is unknown.

    Raise MapError where rasterio is not installed or the file cannot be written; then no file is
    left under the name.
    """
    with _whole(path, os.fspath(path), f"{os.fspath(path)}: cannot be written") as (
        rasterio,
        part,
    ):
        plain = part.with_suffix(".plain")
        try:
            with rasterio.Env(GDAL_CACHEMAX=CACHE_MB):
                with _created(rasterio, plain, form) as target:
                    for each in parts:
                        _write(target, form, each)
                _copied(plain, part)
        finally:
            for left in (plain, Path(f"{part}.ovr.tmp")):
                left.unlink(missing_ok=True)


@contextmanager
def _whole(path: PathLike, needs: str, fault: str) -> Iterator[tuple[Any, Path]]:
    """Yield rasterio and a temporary name that becomes ``path``.

    Raise MapError: that ``needs`` needs rasterio, or one that begins with ``fault``.
    """
    rasterio = imported_rasterio(f"{needs}: a GeoTIFF needs", MapError)
    check_place(path, MapError)
    part = part_of(path)
    try:
        yield rasterio, part
        part.replace(path)
    except (rasterio.errors.RasterioError, OSError) as error:
        first = str(error).partition("\n")[0]
        raise MapError(f"{fault}: {first}") from None
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def _created(rasterio: Any, path: Path, form: RasterForm) -> Iterator[Any]:
    """Create a plain GeoTIFF, in which parts may be written in any order."""
    alpha = {} if form.is_float else {"alpha": "YES"}
    profile = {
        **_TILED,
        "width": form.width,
        "height": form.height,
        "count": form.bands + bool(alpha),
        "dtype": form.dtype,
        "crs": form.crs_wkt,
        "transform": rasterio.Affine(form.pixel_m, 0, form.west_m, 0, -form.pixel_m, form.north_m),
        "photometric": "RGB" if form.bands == 3 else "MINISBLACK",
        "nodata": float("nan") if form.is_float else None,
        "sparse_ok": True,
        "zlevel": 1,  # quick: the file is soon copied and removed
    }
    with rasterio.open(path, "w", **profile, **alpha) as target:
        target.update_tags(**form.tags)
        if form.unit:
            target.units = (form.unit,) * form.bands
        yield target


def _write(target: Any, form: RasterForm, part: RasterPart) -> None:
    height, width = part.known.shape
    window = ((part.row, part.row + height), (part.column, part.column + width))
    unknown = np.nan if form.is_float else 0
    bands = np.where(part.known[..., None], part.values, unknown).astype(form.dtype)
    if not form.is_float:
        alpha = (part.known * np.iinfo(form.dtype).max).astype(form.dtype)
        bands = np.dstack([bands, alpha])
    target.write(np.moveaxis(bands, 2, 0), window=window)


def _copied(plain: Path, cog: Path) -> None:
    """Copy a plain GeoTIFF to a Cloud-Optimised one, with overviews of half the size each."""
    options = {
        "compress": "DEFLATE",
        "predictor": "YES",
        "blocksize": _BLOCK_PX,
        "overview_resampling": "AVERAGE",
        "bigtiff": "IF_SAFER",
    }
    importlib.import_module("rasterio.shutil").copy(plain, cog, driver="COG", **options)


#: Points along either side of the hull's box at which GDAL is given the polynomial's positions;
#: between them it uses a thin plate spline, and lines where these are as near as _TOLERANCE_PX.
_KNOTS = 16
_TOLERANCE_PX = 0.02


def write_warped(
    image: PathLike, out: PathLike, transform: PolynomialTransform, plane: Plane, pixel_m: float
) -> None:
    """Write a picture (one to four bands) as a GeoTIFF with pixels of ``pixel_m``.

    Raises MapError where rasterio is not installed or a file cannot be read or written; then no
    file is left under the name. A picture on the network is not fetched.
    """
    read_map(partial(_write_warped, image, out, transform, plane, pixel_m), network=False)


def _write_warped(
    image: PathLike, out: PathLike, transform: PolynomialTransform, plane: Plane, pixel_m: float
) -> None:
    name = os.fspath(image)
    whole = _whole(out, name, f"{name} to {os.fspath(out)}")
    with whole as (rasterio, part), _opened(rasterio, image) as source:
        _check_size(image, source, transform)
        profile = _profile(rasterio, source, transform, pixel_m) | {"crs": plane.system.to_wkt()}
        with rasterio.open(part, "w", **profile) as target:
            _warp(rasterio, source, target, transform)


@contextmanager
def _opened(rasterio: Any, image: PathLike) -> Iterator[Any]:
    with warnings.catch_warnings():  # it has no coordinates yet: to add them is the purpose here
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with rasterio.open(image) as source:
            yield source


def _check_size(image: PathLike, source: Any, transform: PolynomialTransform) -> None:
    size = np.array([source.width, source.height])
    if (transform.hull_px < -1).any() or (transform.hull_px > size + 1).any():
        raise MapError(
            f"{os.fspath(image)}: control points lie outside its {size[0]} x {size[1]} pixels; "
            "give the picture that they were marked on"
        )


def _profile(
    rasterio: Any, source: Any, transform: PolynomialTransform, pixel_m: float
) -> dict[str, Any]:
    """Return the GeoTIFF's form: north up, square pixels, over the hull's bounding box."""
    begin, end = transform.hull_px, np.roll(transform.hull_px, -1, axis=0)
    along = np.linspace(0, 1, 50)[:, None, None]  # the hull's edges are curves in the plane
    rim = transform((begin + along * (end - begin)).reshape(-1, 2))
    (west, south), (east, north) = rim.min(axis=0).tolist(), rim.max(axis=0).tolist()
    colours = min(source.count, 3)
    return {
        **_TILED,
        "width": math.ceil((east - west) / pixel_m),
        "height": math.ceil((north - south) / pixel_m),
        "count": colours + 1,
        "dtype": source.dtypes[0],
        "transform": rasterio.Affine(pixel_m, 0, west, 0, -pixel_m, north),
        "photometric": "RGB" if colours == 3 else "MINISBLACK",
        "alpha": "YES",
    }


def _warp(rasterio: Any, source: Any, target: Any, transform: PolynomialTransform) -> None:
    """Fill the target within the hull of the control points."""
    control, shutil, warp = (
        importlib.import_module(f"rasterio.{name}") for name in ("control", "shutil", "warp")
    )
    sides = np.linspace(transform.hull_px.min(axis=0), transform.hull_px.max(axis=0), _KNOTS).T
    pixels = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    points = [
        control.GroundControlPoint(row=row, col=column, x=x, y=y)
        for (column, row), (x, y) in zip(pixels.tolist(), transform(pixels).tolist(), strict=True)
    ]
    rim = ", ".join(
        f"{column} {row}" for column, row in [*transform.hull_px, transform.hull_px[0]]
    )
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
