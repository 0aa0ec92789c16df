"""Accept connections, and end those that ask too much: too many, too slow or too many bytes."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import socket
import ssl
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from tirgeo_ros.page.access import OPERATOR, VIEWER
from tirgeo_ros.page.limits import Allowance

#: Most connections by role, None: strangers'; and most of one owner: a session, or a stranger's
#: address, which tablets behind one router share.
MOST_OF_ADDRESS = 100
MOST = {None: (200, MOST_OF_ADDRESS), VIEWER: (100, 30), OPERATOR: (200, 100)}
#: What a page sends is small: clicks, and "shown" for each picture.
_BYTES_A_S, _BYTES_AT_ONCE = 32 * 1024, 256 * 1024
_FIRST_REQUEST_S, _KEEP_ALIVE_S, _HANDSHAKE_S = 10.0, 15.0, 10.0
_ANSWERS_S = 300.0  # that a connection has for its answers, if it is no WebSocket
_BACKLOG = 1024  # whoever is new waits behind a flood, and is not turned away
#: A frame's header with a mask, up to the mask.
_MASKED = re.compile(rb".(?:[\x80-\xfd]|\xfe..|\xff.{8})", re.DOTALL)
_LOG = logging.getLogger("tirgeo.page")
_Move = Callable[[str | None, str], None]  # takes the role and the owner of a connection


class Connection(web.RequestHandler):
    """Be one connection's HTTP, and end it where its peer overdoes it."""

    __slots__ = ("_asked", "_bytes", "_lasts", "_move", "_timers", "ended")
    _faults = Allowance(1 / 60, 1)  # of all connections

    def __init__(self, server: web.Server, ended: asyncio.Future[None], move: _Move) -> None:
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
        self._move = move
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
            self.abort()

    def connection_lost(self, exc: BaseException | None) -> None:
        """End."""
        super().connection_lost(exc)
        for timer in self._timers:
            timer.cancel()
        if not self.ended.done():
            self.ended.set_result(None)

    def set_parser(self, parser: Any, *args: Any, **kw: Any) -> None:
        """Become a WebSocket."""
        super().set_parser(MaskedFrames(parser, self.abort), *args, **kw)  # type: ignore[arg-type]

    def log_exception(self, *args: Any, **kw: Any) -> None:
        """Log a fault of ours, one a minute; what a peer does must not fill the log."""
        theirs = isinstance(kw.get("exc_info"), (HttpProcessingError, ConnectionError))
        if not theirs and self._faults.take(self.ended.get_loop().time()):
            super().log_exception(*args, **kw)

    def asked(self, role: str | None, owner: str, *, websocket: bool) -> None:
        """Note that a whole request has come, and from whom."""
        self._asked = True
        self._lasts = websocket
        self._move(role, owner)

    def _end_unless(self, good: Callable[[], bool]) -> None:
        if not good():
            self.abort()

    def abort(self) -> None:
        """End at once; nothing happens if there is no connection any more."""
        if isinstance(self.transport, asyncio.Transport):
            self.transport.abort()


class MaskedFrames:
    """Give a WebSocket's bytes to aiohttp's parser, which also takes frames without a mask.

    Such a frame ends the connection: RFC 6455, 5.1.
    """

    def __init__(self, parser: Any, abort: Callable[[], None]) -> None:
        self._parser, self._abort = parser, abort
        self.feed_eof = parser.feed_eof
        self._head, self._rest = b"", 0  # of a frame's header so far; bytes of the frame to come

    def feed_data(self, data: bytes) -> tuple[bool, bytes]:
        """Take bytes."""
        left = memoryview(data)
        while left:
            passed = min(self._rest, len(left)) or 1
            if self._rest:
                self._rest -= passed
            else:
                self._head += left[:1]
                if len(self._head) > 1 and self._head[1] < 128:
                    self._abort()
                    return True, b""
            if _MASKED.fullmatch(self._head):
                length = int.from_bytes(self._head[2:] or bytes([self._head[1] & 127]), "big")
                self._head, self._rest = b"", length + 4
            left = left[passed:]
        eof, tail = self._parser.feed_data(data)
        return eof, tail


class Door:
    """Accept connections on one socket; each is a stranger's until it shows a session."""

    def __init__(
        self, listening: socket.socket, server: web.Server, tls: ssl.SSLContext | None
    ) -> None:
        self._listening, self._server, self._tls = listening, server, tls
        #: Role and owner of each, the oldest first.
        self._seated: dict[asyncio.Task[None], tuple[str | None, str]] = {}
        self._idle: set[asyncio.Task[None]] = set()  # those without a whole request
        self.refused = 0

    @property
    def connections(self) -> int:
        """Return how many there are now."""
        return len(self._seated)

    async def accept(self) -> None:
        """Accept until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, peer = await loop.sock_accept(self._listening)
            except OSError:  # the peer has gone, or this process has no more files
                await asyncio.sleep(0.05)
                continue
            task = loop.create_task(self._serve(accepted))
            task.add_done_callback(self._leave)
            self._come(task, str(peer[0]))
            await asyncio.sleep(0)  # many that come at once must not hold up the video

    def _seat(self, task: asyncio.Task[None], role: str | None, owner: str) -> None:
        """Count a connection as its owner's; where there are too many, end one.

        That is one of who has too many, or in a full house of whoever has most: the oldest that
        has asked nothing, else the oldest.
        """
        own = role, owner
        if self._seated.get(task) == own:
            return
        self._seated.pop(task, None)
        self._seated[task] = own
        most, most_of_one = MOST[role]
        held = Counter(seat for seat in self._seated.values() if seat[0] == role)
        crowd = own if held[own] > most_of_one else max(held, key=held.__getitem__)
        if held.total() > most or held[crowd] > most_of_one:
            theirs = [one for one, seat in self._seated.items() if seat == crowd]
            ended = next((one for one in theirs[:-1] if one in self._idle), theirs[0])
            ended.cancel()
            self._leave(ended)
            self.refused += 1

    def _leave(self, task: asyncio.Task[None]) -> None:
        self._seated.pop(task, None)
        self._idle.discard(task)

    def _come(self, task: asyncio.Task[None], address: str) -> None:
        """Count a connection that has just come."""
        self._idle.add(task)
        self._seat(task, None, address)

    def _hear(self, task: asyncio.Task[None], role: str | None, owner: str) -> None:
        """Note that a connection's whole request has come, and whose it is."""
        self._idle.discard(task)
        self._seat(task, role, owner)

    async def _serve(self, accepted: socket.socket) -> None:
        """Hold a connection until it ends, or is cancelled."""
        loop = asyncio.get_running_loop()
        task = asyncio.current_task()
        assert task is not None
        connection = Connection(self._server, loop.create_future(), partial(self._hear, task))
        handshake: dict[str, Any] = {"ssl_handshake_timeout": _HANDSHAKE_S} if self._tls else {}
        try:
            accepted.setblocking(False)
            accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with contextlib.suppress(OSError, asyncio.TimeoutError):
                await loop.connect_accepted_socket(
                    lambda: connection, accepted, ssl=self._tls, **handshake
                )
                await connection.ended
        finally:
            connection.abort()
            accepted.close()


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
