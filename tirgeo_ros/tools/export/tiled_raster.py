"""Collect the views of frames in tiles, and write what they show as a raster."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.orthorectification.frame_view import Patch
from tirgeo_ros.core.orthorectification.ground_tiles import TILE_PX, Floats, TileKey
from tirgeo_ros.core.orthorectification.mosaic_tile import LevelMatch
from tirgeo_ros.io.pictures.cog_output import RasterForm, RasterPart, write_cog
from tirgeo_ros.tools.export.export_frame import ExportFrame
from tirgeo_ros.tools.export.raster_options import RasterSetup
from tirgeo_ros.tools.export.tile_store import TileStore


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
