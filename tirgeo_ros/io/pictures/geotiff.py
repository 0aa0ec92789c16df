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
"""Write Cloud-Optimised GeoTIFFs by GDAL, tile by tile.

Unknown pixels are 0 in an alpha band, the last one, if the values are whole numbers; floats are
nan there, which is declared as no data.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import BoolArray
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.files.whole_files import PathLike, check_place, part_of

_BLOCK_PX = 512
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

    Raise MapError if rasterio is not installed or the file cannot be written; then no file is
    left under the name.
    """
    name = os.fspath(path)
    rasterio = needed("rasterio", f"writing {name}", MapError)
    check_place(path, MapError)
    part = part_of(path)
    plain = part.with_suffix(".plain")
    try:
        with rasterio.Env(GDAL_CACHEMAX=CACHE_MB):
            with _created(rasterio, plain, form) as target:
                for each in parts:
                    _write(target, form, each)
            _copied(plain, part)
        part.replace(path)
    except (rasterio.errors.RasterioError, OSError) as error:
        first = str(error).partition("\n")[0]
        raise MapError(f"{name}: cannot be written: {first}") from None
    finally:
        for temporary in (part, plain, Path(f"{part}.ovr.tmp")):
            temporary.unlink(missing_ok=True)


@contextmanager
def _created(rasterio: Any, path: Path, form: RasterForm) -> Iterator[Any]:
    """Create a plain GeoTIFF, in which parts may be written in any order."""
    alpha = {} if form.is_float else {"alpha": "YES"}
    profile = {
        "driver": "GTiff",
        "tiled": True,
        "blockxsize": _BLOCK_PX,
        "blockysize": _BLOCK_PX,
        "compress": "DEFLATE",
        "bigtiff": "IF_SAFER",
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
