"""Lay rasters on the ground: the lattice of a run, and the tiles in which views are collected."""

from __future__ import annotations

import math
import tempfile
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import zstandard

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.orthorectification.ground_tiles import (
    TILE_PX,
    Floats,
    GroundTiles,
    TileKey,
)
from tirgeo_ros.core.orthorectification.orthophoto import (
    FrameView,
    LevelMatch,
    MosaicTile,
    Patch,
    level_gsd_m,
    seeds,
)
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.io.pictures.geotiff import RasterForm, RasterPart, write_cog
from tirgeo_ros.tools.export.frames import ExportFrame

#: Ground that is seen flatter than this is left out: there, 1 m of height moves it by 3.7 m.
GRAZING_DEG = 15.0
#: Sizes of pixels, times a power of ten.
_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
_LOOKED_AT = 200  # pictures from which the pixel size is derived, spread over the flight


@dataclass(frozen=True)
class RasterOptions:
    """Hold what the user may set for rasters."""

    crs: str | None = None  # None: the UTM zone of the place
    gsd_m: float | None = None  # size of a pixel; None: by the pictures' own
    grazing_deg: float = GRAZING_DEG
    nearest: bool = False  # values of the video as they are: no means, no feathering
    even: bool = False  # match the grey levels of the mosaic's pictures to each other
    #: Degrees Celsius are 16-bit values times the first plus the second; None: as they are.
    degrees: tuple[float, float] | None = None


@dataclass(frozen=True)
class RasterSetup:
    """Hold the lattice of all rasters of a run, and the options."""

    projected: Plane
    tiles: GroundTiles
    options: RasterOptions

    def view(self, frame: ExportFrame) -> FrameView:
        """Return a frame as seen from the lattice; raise MapError for degrees of 8 bits."""
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
    """Return the setup for a flight with these poses of its pictures, at least one.

    Raise MapError for an unsuitable ``crs``, and where no picture sees ground.
    """
    some = poses[:: math.ceil(len(poses) / _LOOKED_AT)]
    latitude, longitude, _ = plane.geodetic_from_ned(np.array([one.position_n for one in some]))
    projected = Plane(options.crs, np.degrees(np.stack([longitude, latitude], axis=1)))
    pixel_m = options.gsd_m
    if pixel_m is None:
        pixel_m = _rounded(_median_gsd_m(options, camera, some, plane, ground))
    return RasterSetup(projected, GroundTiles(projected, pixel_m, plane, ground), options)


def _median_gsd_m(
    options: RasterOptions,
    camera: Camera,
    poses: Sequence[CameraPose],
    plane: TangentPlane,
    ground: Ground,
) -> float:
    """Return the median ground sample distance, m, over the pictures."""
    grazing_rad = math.radians(options.grazing_deg)
    gsd_m = np.concatenate(
        [
            level_gsd_m(camera, pose, plane, seeds(camera, pose, plane, ground), grazing_rad)
            for pose in poses
        ]
    )
    known = gsd_m[np.isfinite(gsd_m)]
    if not known.size:
        raise MapError(
            f"no picture sees the ground at {options.grazing_deg:g} deg or steeper: is its height "
            "right? (--ground-height, --dem, --grazing)"
        )
    return float(np.median(known))


def _rounded(length_m: float) -> float:
    """Return the longest of _STEPS times a power of ten that is no longer."""
    power = 10.0 ** math.floor(math.log10(length_m))
    step = max(step for step in _STEPS if step * power <= length_m * (1 + 1e-9))
    return float(f"{step * power:.6g}")


#: Of tiles in memory. A picture covers some ten tiles of 3 MB.
_MOST_BYTES = 128_000_000
_QUICK = 1  # level of compression


class TileStore:
    """Give tiles by their keys, new ones empty; ``bands`` of values each.

    Files are in a folder of their own below ``folder``, made when it is needed. It goes with the
    store: with ``clear``, at the latest when the program ends.
    """

    def __init__(self, folder: Path, bands: int) -> None:
        self._folder, self.bands = folder, bands
        self._most = max(_MOST_BYTES // (4 * TILE_PX * TILE_PX * (bands + 2)), 1)
        self._tiles: OrderedDict[TileKey, MosaicTile] = OrderedDict()
        self._keys: set[TileKey] = set()
        self._disk: tempfile.TemporaryDirectory[str] | None = None

    def __contains__(self, key: TileKey) -> bool:
        """Return whether a tile was asked for before."""
        return key in self._keys

    def sorted_keys(self) -> list[TileKey]:
        """Return the keys of all tiles, from north to south and west to east."""
        return sorted(self._keys, key=lambda key: key[::-1])

    def tile(self, key: TileKey) -> MosaicTile:
        """Return a tile to look at or to add to, until the next one is asked for."""
        tile = self._tiles.pop(key, None)
        if tile is None:
            tile = self._read(key) if key in self._keys else MosaicTile.empty(self.bands)
        self._keys.add(key)
        self._tiles[key] = tile
        if len(self._tiles) > self._most:
            self._write(*self._tiles.popitem(last=False))
        return tile

    def clear(self) -> None:
        """Forget all tiles, and remove their files."""
        self._tiles.clear()
        self._keys.clear()
        if self._disk is not None:
            self._disk.cleanup()
            self._disk = None

    def _path(self, key: TileKey) -> Path:
        if self._disk is None:
            self._disk = tempfile.TemporaryDirectory(dir=self._folder, prefix=".tiles-")
        return Path(self._disk.name) / f"{key[0]}_{key[1]}"

    def _write(self, key: TileKey, tile: MosaicTile) -> None:
        layers = np.dstack([tile.total, tile.weight, tile.best])
        packed = zstandard.ZstdCompressor(level=_QUICK).compress(layers.tobytes())
        self._path(key).write_bytes(packed)

    def _read(self, key: TileKey) -> MosaicTile:
        data = zstandard.ZstdDecompressor().decompress(self._path(key).read_bytes())
        layers = np.frombuffer(data, np.float32).reshape(TILE_PX, TILE_PX, -1)
        total, weight, best = np.split(layers, [self.bands, self.bands + 1], axis=2)
        return MosaicTile(total.copy(), weight[..., 0].copy(), best[..., 0].copy())


class Box(NamedTuple):
    """Hold columns and rows of the lattice, from ``left``, ``top`` up to ``right``, ``bottom``."""

    left: int
    top: int
    right: int
    bottom: int

    @classmethod
    def of(cls, key: TileKey, patch: Patch) -> Box:
        """Return the box of what is seen of a tile."""
        left, top = key[0] * TILE_PX + patch.columns.start, key[1] * TILE_PX + patch.rows.start
        columns, rows = (np.flatnonzero(patch.seen.any(axis=axis)) for axis in (0, 1))
        first, last = (int(columns[0]), int(rows[0])), (int(columns[-1]), int(rows[-1]))
        return cls(left + first[0], top + first[1], left + last[0] + 1, top + last[1] + 1)

    def with_(self, other: Box) -> Box:
        """Return the box around both."""
        return Box(*map(min, self[:2], other[:2]), *map(max, self[2:], other[2:]))


class TiledRaster:
    """Collect views; ``hard``: the best view alone counts, and values stay as they are.

    ``even``: the grey levels of each view are matched to those of the views before.
    """

    def __init__(
        self, setup: RasterSetup, folder: Path, *, hard: bool, even: bool = False
    ) -> None:
        self._setup, self._folder, self._hard, self._even = setup, folder, hard, even
        self._store: TileStore | None = None
        self._box: Box | None = None
        self._dtype = np.dtype(np.uint8)

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height in pixels; zero if nothing was seen."""
        box = self._box or Box(0, 0, 0, 0)
        return box.right - box.left, box.bottom - box.top

    def add(self, frame: ExportFrame) -> None:
        """Add what a frame shows; all frames have values of the same kind."""
        if self._store is None:
            self._dtype = frame.pixels.dtype
            self._store = TileStore(self._folder, 3 if frame.pixels.ndim == 3 else 1)
        patches = self._setup.view(frame).patches()
        for key, patch in self._evened(list(patches), self._store) if self._even else patches:
            self._store.tile(key).add(patch, hard=self._hard)
            seen = Box.of(key, patch)
            self._box = seen if self._box is None else self._box.with_(seen)

    @staticmethod
    def _evened(
        patches: list[tuple[TileKey, Patch]], store: TileStore
    ) -> list[tuple[TileKey, Patch]]:
        """Return views with the grey levels of the mosaic that they overlap."""
        match = LevelMatch()
        for key, patch in patches:
            if key in store:
                match.add(*store.tile(key).common(patch))
        return [(key, one._replace(values=match.matched(one.values))) for key, one in patches]

    def write(self, path: Path, tags: Mapping[str, str]) -> None:
        """Write the raster as a Cloud-Optimised GeoTIFF and forget it; nothing if none is seen.

        Raise MapError.
        """
        if self._store is None or self._box is None:
            return
        write_cog(path, self._form(self._box, self._store.bands, tags), self._parts())
        self.close()

    def close(self) -> None:
        """Forget what was collected."""
        if self._store is not None:
            self._store.clear()

    def _form(self, box: Box, bands: int, tags: Mapping[str, str]) -> RasterForm:
        pixel_m, celsius = self._setup.tiles.pixel_m, self._setup.options.degrees is not None
        return RasterForm(
            self._setup.projected.system.to_wkt(),
            pixel_m,
            box.left * pixel_m,
            -box.top * pixel_m,
            *self.size,
            bands,
            "float32" if celsius else self._dtype.name,
            "degC" if celsius else "",
            tags,
        )

    def _parts(self) -> Iterator[RasterPart]:
        """Yield the tiles, cut to the box."""
        assert self._store is not None
        assert self._box is not None
        box, (width, height) = self._box, self.size
        for key in self._store.sorted_keys():
            values, seen = self._store.tile(key).values()
            left, top = key[0] * TILE_PX - box.left, key[1] * TILE_PX - box.top
            columns = slice(max(-left, 0), min(width - left, TILE_PX))
            rows = slice(max(-top, 0), min(height - top, TILE_PX))
            yield RasterPart(
                left + columns.start,
                top + rows.start,
                self._written(values[rows, columns]),
                seen[rows, columns],
            )

    def _written(self, values: Floats) -> npt.NDArray[Any]:
        """Return values (h, w, bands) as they stand in the file: red first, or degrees."""
        degrees = self._setup.options.degrees
        if degrees is not None:
            return values.astype(float) * degrees[0] + degrees[1]
        most = np.iinfo(self._dtype).max
        return np.clip(np.rint(values), 0, most).astype(self._dtype)[..., ::-1]
