"""Write each frame as an orthophoto, and all of them as one mosaic."""

from __future__ import annotations

import importlib
import os
from datetime import datetime, timezone
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import BoolArray, Pixels
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.files.bounded_reading import imported_rasterio
from tirgeo_ros.io.files.whole_files import PathLike, made_folder, write_files
from tirgeo_ros.io.pictures.geotiff import CACHE_MB
from tirgeo_ros.tools.export.frames import ExportFrame
from tirgeo_ros.tools.export.rasters import RasterSetup, TiledRaster

#: Longest side of the picture: Google Earth shrinks larger ones to what the graphics card holds.
MOST_PX = 4096
_DEGREES = "EPSG:4326"
_KML = "http://www.opengis.net/kml/2.2"
#: Percentiles shown as black and white, where a raster has more than 8 bits.
_ENDS = (1.0, 99.0)


def write_ground_overlay(raster: PathLike, png: PathLike, kml: PathLike) -> None:
    """Write a raster as PNG in EPSG:4326, unknown places transparent, and the KML that places it.

    Raise MapError where rasterio is not installed, or a file cannot be read or written.
    """
    rasterio = imported_rasterio(f"{os.fspath(raster)}: to read it needs", MapError)
    try:
        values, known, bounds = _in_degrees(rasterio, raster)
    except rasterio.errors.RasterioError as error:
        first = str(error).partition("\n")[0]
        raise MapError(f"{os.fspath(raster)}: cannot be read: {first}") from None
    shown = np.empty((*known.shape, 4), np.uint8)
    shown[..., :3] = _bytes(values, known)[..., ::-1]  # blue first; grey three times
    shown[..., 3] = known * np.uint8(255)
    _, packed = cv2.imencode(".png", shown)
    text = _overlay(Path(kml).stem, os.path.relpath(png, Path(kml).parent), bounds)
    write_files({png: packed.tobytes(), kml: text}, MapError)


def _in_degrees(
    rasterio: Any, raster: PathLike
) -> tuple[npt.NDArray[Any], BoolArray, tuple[float, float, float, float]]:
    """Return values (h, w, bands), which are known (h, w), and west, south, east, north, deg.

    The raster's last band is alpha, unless its values are floats, nan where unknown.
    """
    warp = importlib.import_module("rasterio.warp")
    with rasterio.Env(GDAL_CACHEMAX=CACHE_MB), rasterio.open(raster) as source:
        place = source.crs, _DEGREES, source.width, source.height
        transform, width, height = warp.calculate_default_transform(*place, *source.bounds)
        shrink = max(width / MOST_PX, height / MOST_PX, 1.0)
        transform *= rasterio.Affine.scale(shrink)
        shape = max(int(height / shrink), 1), max(int(width / shrink), 1)
        is_float = source.dtypes[0].startswith("float")
        unknown = {"src_nodata": np.nan, "dst_nodata": np.nan}
        alpha = {"src_alpha": source.count, "dst_alpha": source.count}
        found = np.zeros((source.count, *shape), source.dtypes[0])
        warp.reproject(
            rasterio.band(source, source.indexes),
            found,
            dst_transform=transform,
            dst_crs=_DEGREES,
            resampling=warp.Resampling.bilinear,
            warp_mem_limit=CACHE_MB,
            **(unknown if is_float else alpha),
        )
    bounds = rasterio.transform.array_bounds(*shape, transform)
    if is_float:
        return np.moveaxis(found, 0, 2), np.isfinite(found[0]), bounds
    return np.moveaxis(found[:-1], 0, 2), found[-1] > 0, bounds


def _bytes(values: npt.NDArray[Any], known: BoolArray) -> Pixels:
    """Return values stretched to 8 bits, unless they are of 8 bits; 0 where unknown."""
    if values.dtype != np.uint8 and known.any():
        low, high = np.percentile(values[known], _ENDS).tolist()
        grey = (np.where(known[..., None], values, low) - low) * (255.0 / max(high - low, 1e-9))
        values = np.rint(np.clip(grey, 0, 255))
    return np.asarray(np.where(known[..., None], values, 0), np.uint8)


def _overlay(name: str, picture: str, bounds: tuple[float, float, float, float]) -> str:
    root = ET.Element("kml", xmlns=_KML)
    overlay = ET.SubElement(root, "GroundOverlay")
    ET.SubElement(overlay, "name").text = name
    ET.SubElement(ET.SubElement(overlay, "Icon"), "href").text = Path(picture).as_posix()
    box = ET.SubElement(overlay, "LatLonBox")
    west, south, east, north = bounds
    for side, degrees in {"north": north, "south": south, "east": east, "west": west}.items():
        ET.SubElement(box, side).text = f"{degrees:.9f}"
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


class Orthophotos:
    """Write ``NNNNNN.tif`` into a folder for each frame, by its number; a Product."""

    def __init__(self, folder: Path, setup: RasterSetup) -> None:
        self._folder, self._setup = made_folder(folder, MapError), setup
        self._files = self._blank = 0

    def take(self, frame: ExportFrame) -> None:
        """Write the orthophoto of a frame; raise MapError."""
        raster = TiledRaster(self._setup, self._folder, hard=True)
        raster.add(frame)
        if not raster.size[0]:
            self._blank += 1
            return
        tags = {
            "TIFFTAG_DATETIME": f"{_utc(frame.pose.stamp_ns):%Y:%m:%d %H:%M:%S}",
            "EXPOSURE": _utc(frame.pose.stamp_ns).isoformat(),
            "PICTURE": str(frame.number),
            "STAMP_NS": str(frame.stamp_ns),
        }
        raster.write(self._folder / f"{frame.number:06d}.tif", tags)
        self._files += 1

    def finish(self) -> dict[str, object]:
        """Return the number of files, and of frames that see no ground."""
        return {"folder": str(self._folder), "files": self._files, "without_ground": self._blank}

    def close(self) -> None:
        """Leave the orthophotos: each is complete."""


class Mosaic:
    """Write ``mosaic.tif`` and, for Google Earth, ``mosaic.png`` and ``mosaic.kml``; a Product."""

    def __init__(self, folder: Path, setup: RasterSetup) -> None:
        self._folder = folder
        options = setup.options
        self._raster = TiledRaster(setup, folder, hard=options.nearest, even=options.even)
        self._first_ns = self._last_ns = 0

    def take(self, frame: ExportFrame) -> None:
        """Blend a frame in."""
        self._raster.add(frame)
        self._first_ns = self._first_ns or frame.pose.stamp_ns
        self._last_ns = frame.pose.stamp_ns

    def finish(self) -> dict[str, object]:
        """Write the files; raise MapError. Without a frame that sees ground there are none."""
        width, height = self._raster.size
        if not width:
            return {"width": 0, "height": 0}
        path = self._folder / "mosaic.tif"
        self._raster.write(
            path,
            {
                "TIFFTAG_DATETIME": f"{_utc(self._first_ns):%Y:%m:%d %H:%M:%S}",
                "EXPOSURES": "/".join(
                    _utc(ns).isoformat() for ns in (self._first_ns, self._last_ns)
                ),
            },
        )
        write_ground_overlay(path, path.with_suffix(".png"), path.with_suffix(".kml"))
        return {"file": str(path), "width": width, "height": height}

    def close(self) -> None:
        """Remove the tiles."""
        self._raster.close()


def _utc(stamp_ns: int) -> datetime:
    return datetime.fromtimestamp(stamp_ns * 1e-9, timezone.utc)
