"""Hold the page's files in memory: no path of a request reaches the disk."""

from __future__ import annotations

import gzip
import hashlib
from dataclasses import dataclass
from pathlib import Path

from aiohttp import web

from tirgeo_ros.core.types.errors import PageError

#: The mark of a file that is sent; others (sources, notes) stay on the disk.
_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".mjs": "text/javascript",
    ".css": "text/css",
    ".json": "application/json",
    ".webmanifest": "application/manifest+json",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".ico": "image/x-icon",
    ".woff2": "font/woff2",
    ".txt": "text/plain",
    ".md": "text/plain",
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
    """Return the page's files by their names below ``folder``, with / between folders.

    Raises PageError where the page itself, index.html, is absent.
    """
    found = {
        path.relative_to(folder).as_posix(): Content.of(path.read_bytes(), _TYPES[path.suffix])
        for path in sorted(folder.rglob("*"))
        if path.suffix in _TYPES and path.is_file()
    }
    if "index.html" not in found:
        raise PageError(f"{folder}: index.html is absent: install tirgeo again")
    return found
