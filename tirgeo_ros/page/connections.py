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
"""Accept connections, and end those that are too many, too slow or send too many bytes."""

from __future__ import annotations

import asyncio
import logging
import re
import socket
import ssl
import time
from collections import Counter
from typing import Any

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

OPERATOR, VIEWER = "operator", "viewer"
#: Most connections of a role (None: strangers, without a session), and of one owner: a session,
#: or a stranger's address, which tablets behind one router share.
MOST_OF_ADDRESS = 100
MOST = {None: (200, MOST_OF_ADDRESS), VIEWER: (100, 30), OPERATOR: (200, 100)}
#: What a page sends is small: clicks, and "shown" for each picture.
_BYTES_A_S, _BYTES_AT_ONCE = 32 * 1024, 256 * 1024
_FIRST_REQUEST_S, _KEEP_ALIVE_S, _HANDSHAKE_S = 10.0, 15.0, 10.0
_ANSWERS_S = 300.0  # limit for all answers of a connection that is no WebSocket
_BACKLOG = 1024  # during a flood, new peers wait and are not refused
_ACCEPTED_AT_ONCE = 1  # many new connections must not delay the video
#: A frame's header with a mask, up to the mask.
_MASKED = re.compile(rb".(?:[\x80-\xfd]|\xfe..|\xff.{8})", re.DOTALL)
_LOG = logging.getLogger("tirgeo.page.http")


class Allowance:
    """Allow ``rate`` units a second, and ``burst`` at once."""

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._then_s = burst, 0.0

    def take(self, now_s: float, amount: float = 1.0) -> bool:
        """Return whether ``amount`` is allowed; if so it is taken."""
        grown = self._left + (now_s - self._then_s) * self._rate
        self._left, self._then_s = min(self._burst, grown), now_s
        if self._left < amount:
            return False
        self._left -= amount
        return True


def http_runner(app: web.Application) -> web.AppRunner:
    """Return the runner of an application, with limits on requests and lines of the log."""
    _LOG.filters[:] = [OwnFaults()]
    return web.AppRunner(
        app,
        access_log=None,
        shutdown_timeout=1.0,
        keepalive_timeout=_KEEP_ALIVE_S,
        logger=_LOG,
        lingering_time=1.0,
        auto_decompress=False,  # no request of a page is compressed
        max_line_size=4096,
        max_field_size=4096,
    )


class OwnFaults(logging.Filter):
    """Log one fault of this program a minute; errors that peers cause must not fill the log."""

    def __init__(self) -> None:
        super().__init__()
        self._allowance = Allowance(1 / 60, 1)

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is logged."""
        fault = record.exc_info[1] if record.exc_info else None
        by_peer = isinstance(fault, (HttpProcessingError, ConnectionError))
        return not by_peer and self._allowance.take(time.monotonic())


class Connection(asyncio.Protocol):
    """Pass one connection's bytes to aiohttp, and end it if its peer exceeds a limit."""

    def __init__(
        self, listener: Listener, http: asyncio.Protocol, tls: ssl.SSLContext | None
    ) -> None:
        self._listener, self._http, self._tls = listener, http, tls
        self._loop = asyncio.get_running_loop()
        self._timers: tuple[asyncio.TimerHandle, ...] = ()
        self._has_request = self._is_websocket = False
        self._frames: MaskedFrames | None = None  # of a WebSocket
        self._handshake: asyncio.Task[None] | None = None
        self._bytes = Allowance(_BYTES_A_S, _BYTES_AT_ONCE)
        self._serves = False
        self._early: list[bytes] = []  # came with the end of the handshake
        self._last_bytes = b""  # the last four that came
        self.transport: Any = None  # asyncio's own classes share no base with abort

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin; limit the time to the first whole request, and the time for all answers."""
        self.transport = transport
        self._timers = (
            self._loop.call_later(_FIRST_REQUEST_S, self._end_unless, "_has_request"),
            self._loop.call_later(_ANSWERS_S, self._end_unless, "_is_websocket"),
        )
        address = transport.get_extra_info("peername")
        self._listener.opened(self, str(address[0]) if address else "")
        if self._tls is None:
            self._serve(transport)
        else:
            self.transport.pause_reading()  # the bytes are for the handshake
            self._handshake = self._loop.create_task(self._shake_hands(self._tls))

    async def _shake_hands(self, tls: ssl.SSLContext) -> None:
        try:
            encrypted = await self._loop.start_tls(
                self.transport, self, tls, server_side=True, ssl_handshake_timeout=_HANDSHAKE_S
            )
        except (OSError, asyncio.TimeoutError):
            self.abort()
            self.connection_lost(None)
            return
        if encrypted is not None:
            self._serve(encrypted)

    def _serve(self, transport: asyncio.BaseTransport) -> None:
        self.transport, self._serves = transport, True
        self._listener.served[transport] = self
        self._http.connection_made(transport)
        for data in self._early:
            self._http.data_received(data)
        self._early.clear()

    def data_received(self, data: bytes) -> None:
        """Pass bytes on; abort if they are too many, so that no later buffer can grow."""
        self._last_bytes = (self._last_bytes + data[-4:])[-4:]
        allowed = self._bytes.take(self._loop.time(), len(data))
        if not allowed or (self._frames is not None and not self._frames.take(data)):
            self.abort()
        elif self._serves:
            self._http.data_received(data)
        else:
            self._early.append(data)

    def eof_received(self) -> bool | None:
        """Pass on that the peer sends no more."""
        return self._http.eof_received() if self._serves else None

    def pause_writing(self) -> None:
        """Pass on that the peer does not read."""
        if self._serves:
            self._http.pause_writing()

    def resume_writing(self) -> None:
        """Pass on that the peer reads again."""
        if self._serves:
            self._http.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection, and pass on that it is lost."""
        for timer in self._timers:
            timer.cancel()
        self._listener.closed(self)
        if self._serves:
            self._serves = False
            self._http.connection_lost(exc)

    def requested(self, role: str | None, owner: str, *, websocket: bool) -> None:
        """Record that a whole request has come, and from whom."""
        self._has_request, self._is_websocket = True, websocket
        self._frames = MaskedFrames() if websocket else None
        if websocket and self._last_bytes != b"\r\n\r\n":  # then frames came unchecked
            self.abort()
        self._listener.requested(self, role, owner)

    def answered(self) -> None:
        """Record that the request has its answer."""
        self._frames = None

    def _end_unless(self, flag: str) -> None:
        if not getattr(self, flag):
            self.abort()

    def abort(self) -> None:
        """End the connection at once."""
        self.transport.abort()


class MaskedFrames:
    """Check that each frame of a WebSocket has a mask, as RFC 6455, 5.1, demands."""

    def __init__(self) -> None:
        self._head, self._rest = b"", 0  # bytes of a frame's header so far; number still to come

    def take(self, data: bytes) -> bool:
        """Take bytes; return False at a frame without a mask."""
        left = memoryview(data)
        while left:
            passed = min(self._rest, len(left)) or 1
            if self._rest:
                self._rest -= passed
            else:
                self._head += left[:1]
                if len(self._head) > 1 and self._head[1] < 128:
                    return False
            if _MASKED.fullmatch(self._head):
                length = int.from_bytes(self._head[2:] or bytes([self._head[1] & 127]), "big")
                self._head, self._rest = b"", length + 4
            left = left[passed:]
        return True


class Listener:
    """Accept connections on one socket; each is a stranger's until a request has a session."""

    def __init__(self) -> None:
        #: Role and owner of each, the oldest first.
        self.owners: dict[Connection, tuple[str | None, str]] = {}
        self._idle: set[Connection] = set()  # those without a whole request
        self.served: dict[Any, Connection] = {}  # by transport, after any handshake
        self.refused = 0

    async def open(
        self, listening: socket.socket, http: web.Server, tls: ssl.SSLContext | None
    ) -> asyncio.Server:
        """Begin to accept; close the returned server to end it."""
        accepting = await asyncio.get_running_loop().create_server(
            lambda: Connection(self, http(), tls), sock=listening, backlog=_ACCEPTED_AT_ONCE
        )
        listening.listen(_BACKLOG)  # asyncio takes its backlog for both
        return accepting

    def close(self) -> None:
        """End all connections."""
        for connection in [*self.owners]:
            connection.abort()

    def opened(self, connection: Connection, address: str) -> None:
        """Count a connection that has just come."""
        self._idle.add(connection)
        self._assign(connection, None, address)

    def requested(self, connection: Connection, role: str | None, owner: str) -> None:
        """Record that a connection's whole request has come, and whose it is."""
        self._idle.discard(connection)
        self._assign(connection, role, owner)

    def closed(self, connection: Connection) -> None:
        """Forget a connection."""
        self.owners.pop(connection, None)
        self._idle.discard(connection)
        self.served.pop(connection.transport, None)

    def _assign(self, connection: Connection, role: str | None, owner: str) -> None:
        """Count a connection as its owner's; if there are too many, end one.

        It is a connection of this owner if he has too many, else of the role's owner with most:
        the oldest one without a request, else the oldest.
        """
        own = role, owner
        if self.owners.get(connection) == own:
            return
        self.owners.pop(connection, None)
        self.owners[connection] = own
        most, most_of_one = MOST[role]
        counts = Counter(holder for holder in self.owners.values() if holder[0] == role)
        largest = own if counts[own] > most_of_one else max(counts, key=counts.__getitem__)
        if counts.total() > most or counts[largest] > most_of_one:
            theirs = [other for other, holder in self.owners.items() if holder == largest]
            ended = next((other for other in theirs[:-1] if other in self._idle), theirs[0])
            ended.abort()
            self.owners.pop(ended, None)
            self._idle.discard(ended)
            self.refused += 1


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens; raises OSError."""
    family, *_, address = socket.getaddrinfo(
        host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    dual = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
    listening = socket.create_server(address, family=family, backlog=_BACKLOG, dualstack_ipv6=dual)
    listening.setblocking(False)
    return listening
