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
"""Serve the operator's page from a thread of its own."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import ssl
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from aiohttp import web

from tirgeo_ros.core.config.viewer_parameters import ViewerConfig, address_of
from tirgeo_ros.core.types.errors import PageError, TargetError
from tirgeo_ros.page.access import Access, Guard, add_headers
from tirgeo_ros.page.actions import Actions, Backend, Sent, changed_targets
from tirgeo_ros.page.connections import OPERATOR, VIEWER, Listener, http_runner, listening_socket
from tirgeo_ros.page.routes import Routes, Tiles, read_static
from tirgeo_ros.page.state_hub import plain
from tirgeo_ros.page.video import VideoFeed

STATIC = Path(__file__).parent / "static"
_BODY_BYTES = 2048
_ENDING_S = 5.0
_LOG = logging.getLogger("tirgeo.page")


class PageServer:
    """Serve the page. ``show``, ``report`` and ``targets_changed`` may be called by any thread.

    ``aircraft`` holds names by id; the id of an only one is "".
    """

    def __init__(
        self, backend: Backend, config: ViewerConfig, aircraft: Mapping[str, str]
    ) -> None:
        self._backend, self._config, self._aircraft = backend, config, dict(aircraft)
        self._access = Access(config)
        self._workers = ThreadPoolExecutor(1, "page pictures")
        kept_bytes = round(config.rewind_mb * 1e6)
        self._feeds = {id_: VideoFeed(self._workers, kept_bytes) for id_ in self._aircraft}
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)
        self._started: Future[asyncio.AbstractEventLoop] = Future()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stale, self._ending = asyncio.Event(), asyncio.Event()
        self._port = 0
        self._listener = Listener()

    def start(self) -> None:
        """Start the thread, and wait until the page can be opened; raises PageError."""
        try:
            self._socket = listening_socket(*address_of(self._config.listen))
        except OSError as error:
            reason = str(error.strerror or error).partition(" (while")[0]
            raise PageError(
                f"listen: {self._config.listen}: {reason}: is another page "
                "running? Choose an address of this computer and a free port"
            ) from None
        self._port = self._socket.getsockname()[1]
        self._thread.start()
        self._loop = self._started.result()

    def stop(self) -> None:
        """End all connections and the thread."""
        self._call(self._ending.set)
        self._thread.join(_ENDING_S)
        self._workers.shutdown(wait=False)
        self._loop = None
        for feed in self._feeds.values():
            feed.kept.close()

    @property
    def operator_url(self) -> str:
        """Return where an operator opens the page, with the token if one is needed."""
        return self._url(OPERATOR)

    @property
    def viewer_url(self) -> str:
        """Return where a viewer opens the page; empty where all are operators."""
        return "" if self._access.open else self._url(VIEWER)

    @property
    def counts(self) -> dict[str, int]:
        """Return counts of the page, for diagnostics."""
        return {
            "connections": len(self._listener.owners),
            "connections refused": self._listener.refused,
            "damaged pictures": sum(feed.damaged for feed in self._feeds.values()),
        }

    def show(
        self,
        aircraft: str,
        stamp_ns: int,
        jpeg: bytes,
        begun_ns: int | None = None,
        shapes: bytes = b"",
    ) -> None:
        """Show the newest picture, with the shapes that are drawn on it.

        ``begun_ns`` is this computer's time when the picture was taken, by default its stamp. For
        a stamp in sim time, pass the time of its arrival.
        """
        begun_ns = stamp_ns if begun_ns is None else begun_ns
        feed = self._feeds[aircraft]
        self._call(lambda: feed.show(stamp_ns, begun_ns, jpeg, shapes))

    def report(self, aircraft: str, state: Mapping[str, Any]) -> None:
        """Show a state; non-finite numbers become null; ``track`` holds only new points."""
        fields = {str(key): plain(value) for key, value in state.items()}
        self._call(lambda: self._routes.hub.report(aircraft, fields))

    def targets_changed(self) -> None:
        """Show the targets as they are now in the store."""
        self._call(self._stale.set)

    def _call(self, call: Callable[[], object]) -> None:
        """Call a function on the server's event loop, while it runs."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # it has just ended
                self._loop.call_soon_threadsafe(call)

    def _url(self, role: str) -> str:
        host = _reachable(address_of(self._config.listen)[0])
        host = f"[{host}]" if ":" in host else host
        token = "" if self._access.open else f"?token={self._access.tokens[role]}"
        return f"{self._access.scheme}://{host}:{self._port}/{token}"

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:
            if self._started.done():
                raise
            self._started.set_exception(error)
        finally:
            self._socket.close()

    async def _serve(self) -> None:
        tls = tls_context(self._config)
        tiles = Tiles(Path(self._config.tiles)) if self._config.tiles else None
        runner = await self._runner(tiles)
        server = runner.server
        assert server is not None
        accepting = await self._listener.open(self._socket, server, tls)
        targets = asyncio.create_task(self._keep_targets())
        self._stale.set()
        self._started.set_result(asyncio.get_running_loop())
        try:
            await self._ending.wait()
        finally:
            accepting.close()
            targets.cancel()
            await runner.cleanup()
            self._listener.close()
            if tiles:
                tiles.close()

    async def _runner(self, tiles: Tiles | None) -> web.AppRunner:
        guard = Guard(self._access, self._listener)
        static = read_static(STATIC)
        self._routes = Routes(
            self._backend, self._aircraft, self._feeds, static, tiles, self._access.user
        )
        undulation_m = self._config.geoid_undulation_m
        actions = Actions(self._backend, self._feeds, undulation_m, self._stale.set)
        app = web.Application(middlewares=[guard.middleware], client_max_size=_BODY_BYTES)
        app.add_routes(self._routes.table(guard, actions))
        app.on_response_prepare.append(add_headers)
        app.on_shutdown.append(self._routes.close)
        runner = http_runner(app)
        await runner.setup()
        return runner

    async def _keep_targets(self) -> None:
        """Send the targets that have changed; changes during a reading are sent together."""
        source, sent = (self._backend.targets, self._config.geoid_undulation_m), Sent()
        while True:
            await self._stale.wait()
            self._stale.clear()
            try:
                changed = await asyncio.to_thread(changed_targets, *source, sent)
                self._routes.hub.change_targets(changed)
            except TargetError as error:
                _LOG.warning("the pages do not get the targets: %s", error)


def tls_context(config: ViewerConfig) -> ssl.SSLContext | None:
    """Return the TLS context of https; None without a certificate. Raises PageError."""
    if not config.certificate:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(config.certificate, config.key or None)
    except (OSError, ssl.SSLError) as error:
        raise PageError(
            f"certificate: {config.certificate}, key: {config.key}: {error}: give PEM files that "
            "belong together"
        ) from None
    return context


def _reachable(host: str) -> str:
    """Return a host that others can reach; for "all addresses", the default route's."""
    if host not in {"0.0.0.0", "::"}:  # noqa: S104 compared, not listened on
        return host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing: asks for the route
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()
