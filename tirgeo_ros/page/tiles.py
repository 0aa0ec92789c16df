"""Read background pictures of the map from an MBTiles file, whoever made it."""

from __future__ import annotations

import logging
import sqlite3
import sys
import threading
import time
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import PageError

_TYPES = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_DEEPEST = 24
_MOST_BYTES = 1 << 22  # of a tile
#: A table may be a view without an end: SQLite looks at the clock after so many of its steps.
_OPENED_S, _FOUND_S, _STEPS = 10.0, 0.5, 10_000
_TOLD = "select name, value from metadata where name in ('format', 'attribution') limit 9"
_ZOOM = "select {}(zoom_level) from tiles where zoom_level between 0 and 24"  # each by the index
_TILE = "select tile_data from tiles where zoom_level=? and tile_column=? and tile_row=? limit 1"
_ENDLESS = "its tables take too long to read"
_LOG = logging.getLogger("tirgeo.page")


class Tiles:
    """Hold an MBTiles file open, for any thread. Raises PageError where it is none."""

    def __init__(self, path: Path) -> None:
        self._path, self._one_at_a_time = path, threading.Lock()
        self._end_s, self._fault = 0.0, ""
        try:
            self._file = _opened(path)
            self._file.set_progress_handler(self._is_late, _STEPS)
            told = dict(self._read(_OPENED_S, _TOLD))
            least, most = (
                self._read(_OPENED_S, _ZOOM.format(end))[0][0] for end in ("min", "max")
            )
        except sqlite3.Error as error:
            raise PageError(f"tiles: {path}: {self._words(error)}: give an MBTiles file") from None
        form = str(told.get("format", "png"))[:20]
        if form not in _TYPES:
            raise PageError(f"tiles: {path}: holds {form}: give one of {', '.join(_TYPES)}")
        self.content_type = _TYPES[form]
        self.about: dict[str, Any] = {
            "min": least or 0,
            "max": most or 0,
            "attribution": str(told.get("attribution", ""))[:500],
        }

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return the picture at a place of the web's grid (y from the north), or None."""
        side = 1 << zoom if 0 <= zoom <= _DEEPEST else 0
        if not (0 <= x < side and 0 <= y < side):
            return None
        row = side - 1 - y  # MBTiles counts from the south
        with self._one_at_a_time:
            found = self._found(zoom, x, row)
        return found if isinstance(found, bytes) and len(found) <= _MOST_BYTES else None

    def close(self) -> None:
        """Close the file."""
        with self._one_at_a_time:
            self._file.close()

    def _found(self, *place: int) -> Any:
        """Return what is at a place. The first fault is said; an endless one is the last."""
        if self._fault == _ENDLESS:  # it would keep threads from changes of targets
            return None
        try:
            rows = self._read(_FOUND_S, _TILE, *place)
        except sqlite3.Error as error:
            if not self._fault or self._is_late():
                self._fault = self._words(error)
                _LOG.warning("tiles: %s: %s: the map lacks tiles", self._path, self._fault)
            return None
        return rows[0][0] if rows else None

    def _read(self, within_s: float, query: str, *values: int) -> list[Any]:
        self._end_s = time.monotonic() + within_s
        return self._file.execute(query, values).fetchall()

    def _is_late(self) -> bool:
        return time.monotonic() > self._end_s

    def _words(self, error: sqlite3.Error) -> str:
        return _ENDLESS if self._is_late() else str(error)


def _opened(path: Path) -> sqlite3.Connection:
    if not path.is_file():
        raise PageError(f"tiles: {path}: there is no such file: give an MBTiles file")
    address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    file = sqlite3.connect(address, uri=True, check_same_thread=False)
    if sys.version_info >= (3, 11):
        file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MOST_BYTES)
    return file
