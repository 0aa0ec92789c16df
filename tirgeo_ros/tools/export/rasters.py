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
"""Lay frames on the ground: each as an orthophoto, and all of them as one mosaic."""

from __future__ import annotations

import math
import tempfile
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.orthorectification.orthophoto import (
    TILE_PX,
    Floats,
    FrameView,
    GroundTiles,
    MosaicTile,
    TileKey,
    level_gsd_m,
    seeds,
)
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.io.files.whole_files import made_folder
from tirgeo_ros.io.pictures.geotiff import RasterForm, RasterPart, write_cog
from tirgeo_ros.tools.export.frames import ExportFrame

#: Ground that is seen at a smaller angle is left out: there, 1 m of height moves it by 3.7 m.
GRAZING_DEG = 15.0
#: Sizes of pixels, times a power of ten.
_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
_FAR = 1 << 40  # pixels of the lattice, more than around the earth
_LOOKED_AT = 200  # pictures from which the pixel size is derived, spread over the flight
#: Of tiles in memory. A picture covers some ten tiles of 3 MB.
_MOST_BYTES = 128_000_000


@dataclass(frozen=True)
class RasterOptions:
    """Hold what the user may set for rasters."""

    crs: str | None = None  # None: the UTM zone of the place
    gsd_m: float | None = None  # size of a pixel; None: derived from the pictures
    grazing_deg: float = GRAZING_DEG
    nearest: bool = False  # values stay those of the video: no means, no feathering
    #: Degrees Celsius are 16-bit values times the first plus the second; None: no conversion.
    degrees: tuple[float, float] | None = None


@dataclass(frozen=True)
class RasterSetup:
    """Hold the lattice of all rasters of a run, and the options."""

    projected: Plane
    tiles: GroundTiles
    options: RasterOptions

    def view(self, frame: ExportFrame) -> FrameView:
        """Return a frame's view of the lattice; raise MapError for ``degrees`` of 8-bit video."""
        options = self.options
        if options.degrees is not None and frame.pixels.dtype != np.uint16:
            raise MapError(
                "--degrees is for 16-bit video; the pictures of this flight have 8 bits"
            )
        grazing_rad = math.radians(options.grazing_deg)
        place = self.tiles, frame.camera, frame.pose
        return FrameView(*place, frame.pixels, grazing_rad, nearest=options.nearest)


def raster_setup(
    options: RasterOptions,
    camera: Camera,
    poses: Sequence[CameraPose],
    plane: TangentPlane,
    ground: Ground,
) -> RasterSetup:
    """Return the setup for these poses. Raise MapError for ``crs``, or if no ground is seen."""
    some = poses[:: math.ceil(len(poses) / _LOOKED_AT)]
    latitude, longitude, _ = plane.geodetic_from_ned(np.array([pose.position_n for pose in some]))
    projected = Plane(options.crs, np.degrees(np.stack([longitude, latitude], axis=1)))
    pixel_m = options.gsd_m
    if pixel_m is None:
        grazing_rad = math.radians(options.grazing_deg)
        points = [(pose, seeds(camera, pose, plane, ground)) for pose in some]
        sizes_m = [level_gsd_m(camera, pose, plane, at_n, grazing_rad) for pose, at_n in points]
        gsd_m = np.concatenate(sizes_m)
        gsd_m = gsd_m[np.isfinite(gsd_m)]
        if not gsd_m.size:
            raise MapError(
                f"no picture sees the ground at {options.grazing_deg:g} deg or steeper: is its "
                "height right? (--ground-height, --dem, --grazing)"
            )
        pixel_m = _rounded(float(np.median(gsd_m)))
    return RasterSetup(projected, GroundTiles(projected, pixel_m, plane, ground), options)


def _rounded(length_m: float) -> float:
    """Return the longest of _STEPS times a power of ten that is no longer."""
    power = 10.0 ** math.floor(math.log10(length_m))
    step = max(step for step in _STEPS if step * power <= length_m * (1 + 1e-9))
    return float(f"{step * power:.6g}")


class TileStore:
    """Keep tiles of ``bands`` bands by their keys; a new tile is empty.

    Tiles beyond 128 MB are kept in a hidden folder below ``folder``, which ``clear`` removes, at
    the latest the end of the program.
    """

    def __init__(self, folder: Path, bands: int) -> None:
        self._folder, self.bands = folder, bands
        self._most = max(_MOST_BYTES // (4 * TILE_PX * TILE_PX * (bands + 2)), 1)
        self._tiles: OrderedDict[TileKey, MosaicTile] = OrderedDict()
        self.keys: set[TileKey] = set()
        self._disk: tempfile.TemporaryDirectory[str] | None = None

    def tile(self, key: TileKey) -> MosaicTile:
        """Return a tile for reading or adding; it is valid until the next call."""
        tile = self._tiles.pop(key, None)
        if tile is None and key in self.keys:
            with np.load(self._path(key)) as arrays:
                tile = MosaicTile(**arrays)
        self.keys.add(key)
        self._tiles[key] = tile or MosaicTile.empty(self.bands)
        if len(self._tiles) > self._most:
            oldest, layers = self._tiles.popitem(last=False)
            np.savez(self._path(oldest), **vars(layers))
        return self._tiles[key]

    def clear(self) -> None:
        """Forget all tiles, and remove their files."""
        self._tiles.clear()
        if self._disk is not None:
            self._disk.cleanup()

    def _path(self, key: TileKey) -> Path:
        if self._disk is None:
            self._disk = tempfile.TemporaryDirectory(dir=self._folder, prefix=".tiles-")
        return Path(self._disk.name) / f"{key[0]}_{key[1]}.npz"


class TiledRaster:
    """Collect views; ``hard``: the best view alone counts, and values stay as they are."""

    def __init__(self, setup: RasterSetup, folder: Path, *, hard: bool) -> None:
        self._setup, self._folder, self._hard = setup, folder, hard
        self._store: TileStore | None = None
        #: Column and row on the lattice of the first pixel seen, and of the one after the last.
        self._first, self._end = np.full(2, _FAR), np.full(2, -_FAR)
        self._dtype = np.dtype(np.uint8)

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height in pixels; zero if nothing was seen."""
        width, height = np.maximum(self._end - self._first, 0).tolist()
        return width, height

    def add(self, frame: ExportFrame) -> None:
        """Add what a frame shows of the ground; all frames have values of the same kind."""
        if self._store is None:
            self._dtype = frame.pixels.dtype
            self._store = TileStore(self._folder, 3 if frame.pixels.ndim == 3 else 1)
        for key, patch in self._setup.view(frame).patches():
            self._store.tile(key).add(patch, hard=self._hard)
            columns, rows = (np.flatnonzero(patch.seen.any(axis=axis)) for axis in (0, 1))
            left = key[0] * TILE_PX + patch.columns.start
            top = key[1] * TILE_PX + patch.rows.start
            self._first = np.minimum(self._first, [left + columns[0], top + rows[0]])
            self._end = np.maximum(self._end, [left + columns[-1] + 1, top + rows[-1] + 1])

    def write(self, path: Path, tags: Mapping[str, str]) -> None:
        """Write the seen pixels, if any, as a Cloud-Optimised GeoTIFF. Raise MapError."""
        if self._store is None or not self.size[0]:
            return
        pixel_m, celsius = self._setup.tiles.pixel_m, self._setup.options.degrees is not None
        left, top = self._first.tolist()
        form = RasterForm(
            self._setup.projected.system.to_wkt(),
            pixel_m,
            left * pixel_m,
            -top * pixel_m,
            *self.size,
            self._store.bands,
            "float32" if celsius else self._dtype.name,
            "degC" if celsius else "",
            tags,
        )
        write_cog(path, form, self._parts(self._store))
        self._store.clear()

    def _parts(self, store: TileStore) -> Iterator[RasterPart]:
        """Yield the tiles from north to south and west to east, cut to the seen pixels."""
        width, height = self.size
        for key in sorted(store.keys, key=lambda key: key[::-1]):
            values, seen = store.tile(key).values()
            left, top = (np.array(key) * TILE_PX - self._first).tolist()
            columns = slice(max(-left, 0), min(width - left, TILE_PX))
            rows = slice(max(-top, 0), min(height - top, TILE_PX))
            part = self._file_values(values[rows, columns]), seen[rows, columns]
            yield RasterPart(left + columns.start, top + rows.start, *part)

    def _file_values(self, values: Floats) -> npt.NDArray[Any]:
        """Return values (h, w, bands) for the file: red first, or degrees."""
        degrees = self._setup.options.degrees
        if degrees is not None:
            return values.astype(float) * degrees[0] + degrees[1]
        most = np.iinfo(self._dtype).max
        return np.clip(np.rint(values), 0, most).astype(self._dtype)[..., ::-1]


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


class Mosaic:
    """Write ``mosaic.tif``; a Product."""

    def __init__(self, folder: Path, setup: RasterSetup) -> None:
        self._folder = folder
        self._raster = TiledRaster(setup, folder, hard=setup.options.nearest)
        self._first_ns = self._last_ns = 0

    def take(self, frame: ExportFrame) -> None:
        """Blend a frame in."""
        self._raster.add(frame)
        self._first_ns = self._first_ns or frame.pose.stamp_ns
        self._last_ns = frame.pose.stamp_ns

    def finish(self) -> dict[str, object]:
        """Write the file if a frame shows ground; raise MapError."""
        width, height = self._raster.size
        if not width:
            return {"width": 0, "height": 0}
        path = self._folder / "mosaic.tif"
        first, last = _utc(self._first_ns), _utc(self._last_ns)
        tags = {
            "TIFFTAG_DATETIME": f"{first:%Y:%m:%d %H:%M:%S}",
            "EXPOSURES": f"{first.isoformat()}/{last.isoformat()}",
        }
        self._raster.write(path, tags)
        return {"file": str(path), "width": width, "height": height}


def _utc(stamp_ns: int) -> datetime:
    return datetime.fromtimestamp(stamp_ns * 1e-9, timezone.utc)
