"""Hold what GETs answer: the page's files, in memory, and the map's background (MBTiles)."""

from __future__ import annotations

import gzip
import hashlib
import logging
import os
import sqlite3
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aiohttp import web

from tirgeo_ros.core.types.errors import PageError

_TILE_TYPES = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_DEEPEST = 24
_MOST_BYTES = 1 << 22  # of a tile
#: A table may be a view without an end: SQLite looks at the clock after so many of its steps.
_OPENED_S, _FOUND_S, _STEPS = 10.0, 0.5, 10_000
_METADATA = "select name, value from metadata where name in ('format', 'attribution') limit 9"
_ZOOM = "select {}(zoom_level) from tiles where zoom_level between 0 and 24"  # each by the index
_TILE = "select tile_data from tiles where zoom_level=? and tile_column=? and tile_row=? limit 1"
_ENDLESS = "its tables take too long to read"
_LOG = logging.getLogger("tirgeo.page")


class Tiles:
    """Hold an MBTiles file open, for any thread. Raises PageError where it is none."""

    def __init__(self, path: Path) -> None:
        self._path, self._one_at_a_time, self._fault = path, threading.Lock(), ""
        if not (path.is_file() and os.access(path, os.R_OK)):
            raise PageError(f"tiles: {path}: no file that can be read: give an MBTiles file")
        address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
        self._file = sqlite3.connect(address, uri=True, check_same_thread=False)
        if sys.version_info >= (3, 11):
            self._file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MOST_BYTES)
        metadata = dict(self._read(_OPENED_S, _METADATA))
        least, most = (self._read(_OPENED_S, _ZOOM.format(end))[0][0] for end in ("min", "max"))
        form = str(metadata.get("format", "png"))[:20]
        if form not in _TILE_TYPES:
            raise PageError(f"tiles: {path}: holds {form}: give one of {', '.join(_TILE_TYPES)}")
        self.content_type = _TILE_TYPES[form]
        self.about: dict[str, Any] = {
            "min": least or 0,
            "max": most or 0,
            "attribution": str(metadata.get("attribution", ""))[:500],
        }

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return the picture at a place of the web's grid (y from the north), or None."""
        side = 1 << zoom if 0 <= zoom <= _DEEPEST else 0
        if not (0 <= x < side and 0 <= y < side):
            return None
        with self._one_at_a_time:
            data = self._data_at(zoom, x, side - 1 - y)  # MBTiles counts from the south
        return data if isinstance(data, bytes) and len(data) <= _MOST_BYTES else None

    def close(self) -> None:
        """Close the file."""
        with self._one_at_a_time:
            self._file.close()

    def _data_at(self, *place: int) -> Any:
        """Return a tile's data; log a fault once, and read a table without an end no more."""
        if _ENDLESS in self._fault:
            return None
        try:
            rows = self._read(_FOUND_S, _TILE, *place)
        except PageError as error:
            if not self._fault or _ENDLESS in str(error):
                self._fault = str(error)
                _LOG.warning("the map lacks tiles: %s", error)
            return None
        return rows[0][0] if rows else None

    def _read(self, within_s: float, query: str, *values: int) -> list[Any]:
        end_s = time.monotonic() + within_s
        self._file.set_progress_handler(lambda: time.monotonic() > end_s, _STEPS)
        try:
            return self._file.execute(query, values).fetchall()
        except sqlite3.Error as error:
            words = _ENDLESS if time.monotonic() > end_s else error
            raise PageError(f"tiles: {self._path}: {words}: give an MBTiles file") from None


#: The mark of a file that is sent; others (sources, notes) stay on the disk.
_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
_GZIP_FROM = 500  # bytes


@dataclass(frozen=True, slots=True)
class Content:
    """Hold what a GET answers: bytes, also compressed if that is smaller."""

    body: bytes
    content_type: str
    zipped: bytes | None
    etag: str

    @classmethod
    def of(cls, body: bytes, content_type: str) -> Content:
        """Compress a body; calls with large ones belong in a thread."""
        tag = hashlib.sha256(body).hexdigest()[:24]
        zipped = gzip.compress(body, 6, mtime=0) if len(body) >= _GZIP_FROM else body
        return cls(body, content_type, zipped if len(zipped) < len(body) else None, f'"{tag}"')

    def response(self, request: web.Request) -> web.Response:
        """Return the answer, or that the browser has it already."""
        headers = {"ETag": self.etag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
        if request.headers.get("If-None-Match", "") == self.etag:
            return web.Response(status=304, headers=headers)
        body = self.body
        if self.zipped is not None and "gzip" in request.headers.get("Accept-Encoding", ""):
            body, headers["Content-Encoding"] = self.zipped, "gzip"
        charset = "utf-8" if self.content_type.startswith("text/") else None
        return web.Response(
            body=body, content_type=self.content_type, charset=charset, headers=headers
        )


def read_static(folder: Path) -> dict[str, Content]:
    """Return the page's files by their names below ``folder``; raise PageError without a page."""
    files = {
        path.relative_to(folder).as_posix(): Content.of(path.read_bytes(), _TYPES[path.suffix])
        for path in sorted(folder.rglob("*"))
        if path.suffix in _TYPES and path.is_file()
    }
    if "index.html" not in files:
        raise PageError(f"{folder}: index.html is absent: install tirgeo again")
    return files
