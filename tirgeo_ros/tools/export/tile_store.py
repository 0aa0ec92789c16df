"""Hold the tiles of a mosaic: the newest in memory, the others compressed on disk."""

from __future__ import annotations

import tempfile
from collections import OrderedDict
from pathlib import Path

import numpy as np
import zstandard

from tirgeo_ros.core.orthorectification.ground_tiles import TILE_PX, TileKey
from tirgeo_ros.core.orthorectification.mosaic_tile import MosaicTile

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
