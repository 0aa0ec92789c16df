"""Read background pictures of the map from an MBTiles file."""

from __future__ import annotations

import sqlite3
import threading
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import PageError

_TYPES = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_DEEPEST = 24


class Tiles:
    """Hold an MBTiles file open, for any thread. Raises PageError where it is none."""

    def __init__(self, path: Path) -> None:
        try:
            self._file = sqlite3.connect(
                f"{path.absolute().as_uri()}?mode=ro&immutable=1",
                uri=True,
                check_same_thread=False,
            )
            told = dict(self._file.execute("select name, value from metadata"))
            zooms = "select min(zoom_level), max(zoom_level) from tiles"
            least, most = self._file.execute(zooms).fetchone()
        except sqlite3.Error as error:
            raise PageError(f"tiles: {path}: {error}: give an MBTiles file") from None
        form = str(told.get("format", "png"))
        if form not in _TYPES:
            raise PageError(f"tiles: {path}: holds {form}: give one of {', '.join(_TYPES)}")
        self.content_type = _TYPES[form]
        self.about: dict[str, Any] = {
            "min": least or 0,
            "max": most or 0,
            "attribution": str(told.get("attribution", ""))[:500],
        }
        self._one_at_a_time = threading.Lock()

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return the picture at a place of the web's grid (y from the north), or None."""
        side = 1 << zoom if 0 <= zoom <= _DEEPEST else 0
        if not (0 <= x < side and 0 <= y < side):
            return None
        row = side - 1 - y  # MBTiles counts from the south
        with self._one_at_a_time:
            found = self._file.execute(
                "select tile_data from tiles where zoom_level=? and tile_column=? and tile_row=?",
                (zoom, x, row),
            ).fetchone()
        return bytes(found[0]) if found else None

    def close(self) -> None:
        """Close the file."""
        with self._one_at_a_time:
            self._file.close()
