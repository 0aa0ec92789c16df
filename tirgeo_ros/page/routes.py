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
"""Answer the page's GET requests (files, tiles, exports), and open its WebSockets."""

from __future__ import annotations

import asyncio
import gzip
import hashlib
import io
import logging
import os
import sqlite3
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import segno
from aiohttp import web

from tirgeo_ros.core.targets.target import COLOURS, KINDS, STATUSES
from tirgeo_ros.core.types.errors import PageError, TargetError
from tirgeo_ros.io.targets.formats import FORMATS, exported
from tirgeo_ros.io.targets.store import MOST_NAME, MOST_NOTE
from tirgeo_ros.page.access import Guard, Shares
from tirgeo_ros.page.actions import Actions, Backend
from tirgeo_ros.page.connections import OPERATOR, VIEWER
from tirgeo_ros.page.state_hub import StateHub, StatePage
from tirgeo_ros.page.video import (
    Sizes,
    VideoFeed,
    VideoViewer,
    bound_kernel_buffer,
    message_of,
)

_T = TypeVar("_T")
_MESSAGE_BYTES = 64 * 1024
_HEARTBEAT_S, _CLOSING_S = 10.0, 2.0
_REQUESTS_A_S, _REQUESTS_AT_ONCE = 100.0, 200.0  # of all pages of a session, on /state
_DAY = "max-age=86400"
_NOT_KEPT = {"Cache-Control": "no-store"}  # by the browser
_QUIET = 2  # light modules around a QR code; terminals add their own margin
_TILE_TYPES = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_DEEPEST = 24
_MOST_BYTES = 1 << 22  # of a tile
#: Time limits, which SQLite checks every _STEPS of its steps: a table may be an endless view.
_OPEN_S, _FIND_S, _STEPS = 10.0, 0.5, 10_000
_METADATA = "select name, value from metadata where name in ('format', 'attribution') limit 9"
_ZOOM = "select {}(zoom_level) from tiles where zoom_level between 0 and 24"  # each by the index
_TILE = "select tile_data from tiles where zoom_level=? and tile_column=? and tile_row=? limit 1"
_ENDLESS = "its tables take too long to read"
_LOG = logging.getLogger("tirgeo.page")
#: Suffixes of the files that are served, with their types; no others (sources, notes) are.
_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
_GZIP_FROM = 500  # bytes


class Tiles:
    """Hold an MBTiles file open, for any thread. Raises PageError if it is not one."""

    def __init__(self, path: Path) -> None:
        self._path, self._one_at_a_time, self._fault = path, threading.Lock(), ""
        if not (path.is_file() and os.access(path, os.R_OK)):
            raise PageError(f"tiles: {path}: cannot be read: give an MBTiles file")
        address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
        self._file = sqlite3.connect(address, uri=True, check_same_thread=False)
        if sys.version_info >= (3, 11):
            self._file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MOST_BYTES)
        metadata = dict(self._read(_OPEN_S, _METADATA))
        least, most = (self._read(_OPEN_S, _ZOOM.format(end))[0][0] for end in ("min", "max"))
        form = str(metadata.get("format", "png"))[:20]
        if form not in _TILE_TYPES:
            raise PageError(f"tiles: {path}: holds {form}: give tiles of {', '.join(_TILE_TYPES)}")
        self.content_type = _TILE_TYPES[form]
        self.about: dict[str, Any] = {
            "min": least or 0,
            "max": most or 0,
            "attribution": str(metadata.get("attribution", ""))[:500],
        }

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """Return the tile at a place of the web map's grid (y from the north), or None."""
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
        """Return a tile's data; log a fault once, and stop reading an endless table."""
        if _ENDLESS in self._fault:
            return None
        try:
            rows = self._read(_FIND_S, _TILE, *place)
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


@dataclass(frozen=True, slots=True)
class Content:
    """Hold the answer to a GET: its bytes, also compressed if that is smaller."""

    body: bytes
    content_type: str
    zipped: bytes | None
    etag: str

    @classmethod
    def of(cls, body: bytes, content_type: str) -> Content:
        """Compress a body; call it in a thread for a large one."""
        tag = hashlib.sha256(body).hexdigest()[:24]
        zipped = gzip.compress(body, 6, mtime=0) if len(body) >= _GZIP_FROM else body
        return cls(body, content_type, zipped if len(zipped) < len(body) else None, f'"{tag}"')

    def response(self, request: web.Request) -> web.Response:
        """Return the answer, or status 304 if the browser has it already."""
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


class Routes:
    """Answer the page's requests with what the server holds."""

    def __init__(
        self,
        backend: Backend,
        aircraft: Mapping[str, str],
        feeds: Mapping[str, VideoFeed],
        static: Mapping[str, Content],
        tiles: Tiles | None,
        user: Callable[[web.Request], tuple[str | None, str]],
    ) -> None:
        self._backend, self._aircraft, self._feeds = backend, aircraft, feeds
        self._static, self._tiles, self._user = static, tiles, user
        self._viewers: set[tuple[str, VideoViewer]] = set()
        self._sockets: set[web.WebSocketResponse] = set()
        self._maps: dict[str, Content] = {}
        self._shares = Shares(_REQUESTS_A_S, _REQUESTS_AT_ONCE)
        # Exports and maps must not delay clicks, nor a viewer's delay an operator's.
        self._large = {OPERATOR: asyncio.Semaphore(2), VIEWER: asyncio.Semaphore(1)}
        self.hub = StateHub(self._latency_ms)

    def table(self, guard: Guard, actions: Actions) -> list[web.RouteDef]:
        """Return the paths with their handlers."""
        return [
            web.get("/", self._static_file),
            web.get("/static/{name:.*}", self._static_file),
            web.get("/enter", guard.role),
            web.post("/enter", guard.enter),
            web.get("/state", partial(self._state, actions=actions)),
            web.get("/video/{aircraft:.*}", self._video),
            web.get("/frames/{aircraft:.*}", self._frames),
            web.get(r"/frame/{aircraft:.*}/{stamp:\d{1,19}}", self._frame),
            web.get("/map/{aircraft:.*}", self._map),
            web.get(r"/tiles/{z:\d{1,2}}/{x:\d{1,8}}/{y:\d{1,8}}", self._tile),
            web.get("/export/{format}", self._export),
            web.get("/targets/{id}/picture", self._picture),
            web.get("/targets/{id}/qr", self._code),
        ]

    async def close(self, _: web.Application) -> None:
        """Tell every page that the server ends."""
        closing = [s.close(code=1001, message=b"the server ends") for s in self._sockets]
        await asyncio.gather(*closing, return_exceptions=True)

    async def _static_file(self, request: web.Request) -> web.Response:
        name = request.match_info.get("name", "index.html")
        return _or_404(self._static.get(name)).response(request)

    async def _state(self, request: web.Request, actions: Actions) -> web.StreamResponse:
        role, owner = self._user(request)
        hello = {
            "type": "hello",
            "role": role,
            "aircraft": [{"id": id_, "name": name} for id_, name in self._aircraft.items()],
            "kinds": KINDS,
            "colours": COLOURS,
            "statuses": STATUSES,
            "most": {"name": MOST_NAME, "note": MOST_NOTE},
            "tiles": self._tiles.about if self._tiles else None,
            "now_ns": str(time.time_ns()),
        }
        async with self._opened(request, compress=True) as socket:
            may = partial(self._shares.take, role, owner)
            page = StatePage(socket, role or VIEWER, actions, self.hub, may)
            await page.run(hello, _who(request))
        return socket

    async def _video(self, request: web.Request) -> web.StreamResponse:
        aircraft = request.match_info["aircraft"]
        feed = _or_404(self._feeds.get(aircraft))
        async with self._opened(request, compress=False) as socket:
            bound_kernel_buffer(request)
            viewer = aircraft, VideoViewer(feed, socket, _who(request))
            self._viewers.add(viewer)
            try:
                await viewer[1].run()
            finally:
                self._viewers.discard(viewer)
        return socket

    async def _frames(self, request: web.Request) -> web.Response:
        """Answer which pictures one can go back to."""
        feed = _or_404(self._feeds.get(request.match_info["aircraft"]))
        stamps = {"stamps_ns": [str(stamp) for stamp in feed.stamps_ns()]}
        answer = web.json_response(stamps, headers=_NOT_KEPT)
        answer.enable_compression()
        return answer

    async def _frame(self, request: web.Request) -> web.Response:
        """Answer one of them, at full size: the message that ``/video`` has."""
        feed = _or_404(self._feeds.get(request.match_info["aircraft"]))
        picture = _or_404(feed.kept.get(int(request.match_info["stamp"])))
        body = message_of(picture, Sizes(picture.shapes, picture.jpeg))
        return web.Response(body=body, content_type="application/octet-stream", headers=_NOT_KEPT)

    @asynccontextmanager
    async def _opened(
        self, request: web.Request, *, compress: bool
    ) -> AsyncIterator[web.WebSocketResponse]:
        socket = web.WebSocketResponse(
            timeout=_CLOSING_S,
            heartbeat=_HEARTBEAT_S,
            compress=compress,
            max_msg_size=_MESSAGE_BYTES,
        )
        await socket.prepare(request)
        self._sockets.add(socket)
        try:
            yield socket
        finally:
            self._sockets.discard(socket)

    def _latency_ms(self, aircraft: str, who: str) -> float | None:
        """Return the latency of a user's slowest screen; None without one."""
        screens = (v for of, v in self._viewers if of == aircraft and v.who == who)
        latencies_ms = [viewer.latency_ms for viewer in screens if viewer.latency_ms is not None]
        return round(max(latencies_ms), 1) if latencies_ms else None

    async def _map(self, request: web.Request) -> web.Response:
        aircraft = request.match_info["aircraft"]
        _or_404(self._feeds.get(aircraft))

        def content() -> Content:
            body, before = self._backend.vector_map(aircraft), self._maps.get(aircraft)
            if before is None or before.body != body:
                self._maps[aircraft] = Content.of(body, "application/geo+json")
            return self._maps[aircraft]

        answer = await self._run(request, content)
        return answer.response(request) if answer.body else web.Response(status=204)

    async def _tile(self, request: web.Request) -> web.Response:
        tiles = _or_404(self._tiles)
        place = (int(request.match_info[name]) for name in "zxy")
        body = await self._run(request, lambda: tiles.tile(*place))
        if body is None:
            return web.Response(status=204)
        return web.Response(
            body=body, content_type=tiles.content_type, headers={"Cache-Control": _DAY}
        )

    async def _export(self, request: web.Request) -> web.Response:
        form = request.match_info["format"]
        _or_404(FORMATS.get(form))
        store = self._backend.targets
        body = await self._run(request, lambda: exported(store.for_others(), form, store.picture))
        named = {"Content-Disposition": f'attachment; filename="targets.{form}"'}
        return web.Response(body=body, content_type="application/octet-stream", headers=named)

    async def _picture(self, request: web.Request) -> web.Response:
        picture = partial(self._backend.targets.picture, request.match_info["id"])
        body = await self._run(request, picture)
        return web.Response(body=_or_404(body), content_type="image/jpeg")

    async def _code(self, request: web.Request) -> web.Response:
        def code() -> bytes:
            place = self._backend.targets.get(request.match_info["id"]).place
            uri, out = f"geo:{place.latitude_deg:.7f},{place.longitude_deg:.7f}", io.BytesIO()
            segno.make(uri, micro=False).save(out, kind="svg", scale=4, light="white")
            return out.getvalue()

        try:
            body = await self._run(request, code)
        except TargetError:
            raise web.HTTPNotFound from None
        return web.Response(body=body, content_type="image/svg+xml")

    async def _run(self, request: web.Request, call: Callable[[], _T]) -> _T:
        async with self._large[self._user(request)[0] or VIEWER]:
            return await asyncio.to_thread(call)


def _or_404(value: _T | None) -> _T:
    if value is None:
        raise web.HTTPNotFound
    return value


def _who(request: web.Request) -> str:
    """Return address, cookie and browser, which the sockets of one screen share."""
    headers = (request.headers.get(name, "") for name in ("Cookie", "User-Agent"))
    return " ".join((request.remote or "", *headers))


def invitation(url: str) -> str:
    """Return a URL as a QR code of half-block characters, light on dark, and as text below it."""
    out = io.StringIO()
    segno.make(url, error="l", micro=False).terminal(out, border=_QUIET, compact=True)
    return f"{out.getvalue().rstrip()}\n{url}"
