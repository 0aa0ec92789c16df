"""Accept connections, and end those that ask too much: too many, too slow or too many bytes."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import ssl
from collections import Counter
from collections.abc import Callable
from typing import Any

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from tirgeo_ros.page.limits import Allowance

#: Tablets behind one router have one address.
MOST, MOST_OF_ADDRESS = 400, 100
#: What a page sends is small: clicks, and "shown" for each picture.
_BYTES_A_S, _BYTES_AT_ONCE = 32 * 1024, 256 * 1024
_FIRST_REQUEST_S, _KEEP_ALIVE_S, _HANDSHAKE_S = 10.0, 15.0, 10.0
_ANSWERS_S = 300.0  # that a connection has for its answers, if it is no WebSocket
_BACKLOG = 128
_LOG = logging.getLogger("tirgeo.page")


class Connection(web.RequestHandler):
    """Be one connection's HTTP, and end it where its peer overdoes it."""

    __slots__ = ("_asked", "_bytes", "_lasts", "_timers", "ended")
    _faults = Allowance(1 / 60, 1)  # of all connections

    def __init__(self, server: web.Server, ended: asyncio.Future[None]) -> None:
        super().__init__(
            server,
            loop=ended.get_loop(),
            keepalive_timeout=_KEEP_ALIVE_S,
            access_log=None,  # type: ignore[arg-type]  # aiohttp's own way to have none
            logger=_LOG,
            lingering_time=1.0,
            auto_decompress=False,  # no request of a page is compressed
            max_line_size=4096,
            max_field_size=4096,
        )
        self.ended = ended
        self._timers: tuple[asyncio.TimerHandle, ...] = ()
        self._asked = self._lasts = False
        self._bytes = Allowance(_BYTES_A_S, _BYTES_AT_ONCE)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin, with limits on the time to the first whole request, and to take all answers."""
        super().connection_made(transport)
        loop = self.ended.get_loop()
        self._timers = (
            loop.call_later(_FIRST_REQUEST_S, self._end_unless, lambda: self._asked),
            loop.call_later(_ANSWERS_S, self._end_unless, lambda: self._lasts),
        )

    def data_received(self, data: bytes) -> None:
        """Take bytes, if there are not too many: no buffer further on can then grow."""
        if self._bytes.take(self.ended.get_loop().time(), len(data)):
            super().data_received(data)
        else:
            self._abort()

    def connection_lost(self, exc: BaseException | None) -> None:
        """End."""
        super().connection_lost(exc)
        for timer in self._timers:
            timer.cancel()
        if not self.ended.done():
            self.ended.set_result(None)

    def log_exception(self, *args: Any, **kw: Any) -> None:
        """Log a fault of ours, one a minute; what a peer sends must not fill the log."""
        theirs = isinstance(kw.get("exc_info"), HttpProcessingError)
        if not theirs and self._faults.take(self.ended.get_loop().time()):
            super().log_exception(*args, **kw)

    def asked(self, *, websocket: bool) -> None:
        """Note that a whole request has come."""
        self._asked = True
        self._lasts = websocket

    def _end_unless(self, good: Callable[[], bool]) -> None:
        if not good():
            self._abort()

    def _abort(self) -> None:
        if isinstance(self.transport, asyncio.Transport):
            self.transport.abort()


class Door:
    """Accept connections on one socket, before any memory is spent on them."""

    def __init__(
        self, listening: socket.socket, server: web.Server, tls: ssl.SSLContext | None
    ) -> None:
        self._listening, self._server, self._tls = listening, server, tls
        self._addresses: Counter[str] = Counter()
        self._tasks: set[asyncio.Task[None]] = set()
        self.refused = 0

    @property
    def connections(self) -> int:
        """Return how many there are now."""
        return len(self._tasks)

    async def accept(self) -> None:
        """Accept until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, peer = await loop.sock_accept(self._listening)
            except OSError:  # the peer has gone, or this process has no more files
                await asyncio.sleep(0.05)
                continue
            address = str(peer[0])
            if self._is_full(address):
                self.refused += 1
                accepted.close()
            else:
                self._addresses[address] += 1
                task = loop.create_task(self._serve(accepted, address))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
            await asyncio.sleep(0)  # many that come at once must not hold up the video

    def _is_full(self, address: str) -> bool:
        return len(self._tasks) >= MOST or self._addresses[address] >= MOST_OF_ADDRESS

    async def _serve(self, accepted: socket.socket, address: str) -> None:
        """Hold a connection's place until it ends."""
        loop = asyncio.get_running_loop()
        ended = loop.create_future()
        handshake: dict[str, Any] = {"ssl_handshake_timeout": _HANDSHAKE_S} if self._tls else {}
        try:
            accepted.setblocking(False)
            accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with contextlib.suppress(OSError, asyncio.TimeoutError):
                await loop.connect_accepted_socket(
                    lambda: Connection(self._server, ended), accepted, ssl=self._tls, **handshake
                )
                await ended
        finally:
            accepted.close()
            self._addresses[address] -= 1
            if not self._addresses[address]:
                del self._addresses[address]


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens; raises OSError."""
    family, kind, protocol, _, address = socket.getaddrinfo(
        host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    listening = socket.socket(family, kind, protocol)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen(_BACKLOG)
        listening.setblocking(False)
    except OSError:
        listening.close()
        raise
    return listening
