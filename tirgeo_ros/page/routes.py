"""Answer the page's GETs and open its WebSockets."""

from __future__ import annotations

import asyncio
import io
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from functools import partial
from typing import TypeVar

import segno
from aiohttp import web

from tirgeo_ros.core.targets.target import KINDS
from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.targets.formats import FORMATS, exported
from tirgeo_ros.io.targets.store import MOST_NAME, MOST_NOTE
from tirgeo_ros.page.access import Guard, Shares
from tirgeo_ros.page.actions import Actions, Backend
from tirgeo_ros.page.connections import OPERATOR, VIEWER
from tirgeo_ros.page.content import Content, Tiles
from tirgeo_ros.page.state_hub import StateHub, StatePage
from tirgeo_ros.page.video import VideoFeed, VideoViewer, bound_kernel_buffer

_T = TypeVar("_T")
_MESSAGE_BYTES = 64 * 1024
_HEARTBEAT_S, _CLOSING_S = 10.0, 2.0
_ASKED_A_S, _ASKED_AT_ONCE = 100.0, 200.0  # by all pages of a session, on /state
_DAY = "max-age=86400"
_QUIET = 2  # modules of light around a code; terminals add their own


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
        self._asked = Shares(_ASKED_A_S, _ASKED_AT_ONCE)
        # Exports and maps must not keep clicks waiting, nor a viewer's those of an operator.
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
            web.get("/map/{aircraft:.*}", self._map),
            web.get(r"/tiles/{z:\d{1,2}}/{x:\d{1,8}}/{y:\d{1,8}}", self._tile),
            web.get("/export/{format}", self._export),
            web.get("/targets/{id}/picture", self._picture),
            web.get("/targets/{id}/qr", self._code),
        ]

    async def close(self, _: web.Application) -> None:
        """Tell every page that the server ends."""
        closing = [one.close(code=1001, message=b"the server ends") for one in self._sockets]
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
            "most": {"name": MOST_NAME, "note": MOST_NOTE},
            "tiles": self._tiles.about if self._tiles else None,
            "now_ns": str(time.time_ns()),
        }
        async with self._opened(request, compress=True) as socket:
            may = partial(self._asked.take, role, owner)
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
        """Return the slowest of somebody's screens."""
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

        made = await self._made(request, content)
        return made.response(request) if made.body else web.Response(status=204)

    async def _tile(self, request: web.Request) -> web.Response:
        tiles = _or_404(self._tiles)
        place = (int(request.match_info[name]) for name in "zxy")
        body = await self._made(request, lambda: tiles.tile(*place))
        if body is None:
            return web.Response(status=204)
        return web.Response(
            body=body, content_type=tiles.content_type, headers={"Cache-Control": _DAY}
        )

    async def _export(self, request: web.Request) -> web.Response:
        form = request.match_info["format"]
        _or_404(FORMATS.get(form))
        store = self._backend.targets
        body = await self._made(request, lambda: exported(store.for_others(), form, store.picture))
        named = {"Content-Disposition": f'attachment; filename="targets.{form}"'}
        return web.Response(body=body, content_type="application/octet-stream", headers=named)

    async def _picture(self, request: web.Request) -> web.Response:
        picture = partial(self._backend.targets.picture, request.match_info["id"])
        body = await self._made(request, picture)
        return web.Response(body=_or_404(body), content_type="image/jpeg")

    async def _code(self, request: web.Request) -> web.Response:
        try:
            get = partial(self._backend.targets.get, request.match_info["id"])
            target = await self._made(request, get)
        except TargetError:
            raise web.HTTPNotFound from None
        out = io.BytesIO()
        uri = f"geo:{target.place.latitude_deg:.7f},{target.place.longitude_deg:.7f}"
        segno.make(uri, micro=False).save(out, kind="svg", scale=4, light="white")
        return web.Response(body=out.getvalue(), content_type="image/svg+xml")

    async def _made(self, request: web.Request, call: Callable[[], _T]) -> _T:
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
