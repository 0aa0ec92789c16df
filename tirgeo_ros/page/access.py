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
"""Decide who may use the page, and how much: name, origin, token, session, role, shares.

Each request is checked before anything answers it, and each answer gets the security headers.
"""

from __future__ import annotations

import asyncio
import base64
import hmac
import ipaddress
import json
import logging
import os
import re
import secrets
import socket
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

from aiohttp import web

from tirgeo_ros.core.config.viewer_parameters import TOKEN_SEED, ViewerConfig, address_of
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.page.connections import OPERATOR, VIEWER, Allowance, Connection, Listener

_MOST_ADDRESSES = 1000  # that are remembered
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 60.0
_ERRORS = 2  # typing errors of an honest user
_TOGETHER = 4  # shares that all viewers have together; so have all strangers
_SESSION_S = 3 * 24 * 3600
_SAME_SITE = {"", "same-origin", "none"}  # none: typed or scanned by the user
_LOOPBACK_NAMES = {"localhost", "localhost.localdomain"}
_HOST = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::([0-9]{1,5}))?", re.ASCII)
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
#: A page begins with some thirty files, a map with as many tiles.
_REQUESTS_A_S, _REQUESTS_AT_ONCE = 60.0, 400.0
_PAUSE_S = 0.5  # before the answer to each request beyond the limit
_BODY_S = 5.0
_TOKEN_BYTES = 512  # a token has 200 characters at most; JSON of more could nest too deep
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' blob: data:; font-src 'self'; connect-src 'self'{}; manifest-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_LOG = logging.getLogger("tirgeo.page")


class Shares:
    """Hold an allowance for each owner, a session or an address; forget the longest unused.

    All viewers together have one too, however many sessions one of them opens. So have strangers:
    requests without a session.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._allowances: OrderedDict[str, Allowance] = OrderedDict()
        together = _TOGETHER * rate, _TOGETHER * burst
        self._common = {role: Allowance(*together) for role in (None, VIEWER)}

    def take(self, role: str | None, owner: str, now_s: float) -> bool:
        """Return whether the owner may make one more request."""
        allowance = self._allowances.setdefault(owner, Allowance(self._rate, self._burst))
        _keep(self._allowances, owner)
        common = self._common.get(role)
        return allowance.take(now_s) and (common is None or common.take(now_s))


class WrongTokens:
    """Make an address wait longer after each wrong token, up to a minute.

    While many addresses guess, the minute comes after _ERRORS wrong tokens.
    """

    def __init__(self) -> None:
        self._waits: OrderedDict[str, tuple[int, float]] = OrderedDict()
        self._all = Allowance(5.0, 50.0)  # of all addresses: one guesser may have many

    def wait_s(self, address: str, now_s: float) -> float:
        """Return how long the address must wait before its next token is checked."""
        return max(0.0, self._waits.get(address, (0, 0.0))[1] - now_s)

    def add(self, address: str, now_s: float) -> None:
        """Count a wrong token."""
        count = self._waits.get(address, (0, 0.0))[0]
        wait_s = min(_FIRST_WAIT_S * 2.0 ** min(count, 20), _LONGEST_WAIT_S)
        if not self._all.take(now_s) and count >= _ERRORS:
            wait_s = _LONGEST_WAIT_S
        self._waits[address] = count + 1, now_s + wait_s
        _keep(self._waits, address)

    def forget(self, address: str) -> None:
        """Forget the wrong tokens of an address that gave a right one."""
        self._waits.pop(address, None)


def _keep(table: OrderedDict[str, Any], address: str) -> None:
    table.move_to_end(address)
    while len(table) > _MOST_ADDRESSES:
        table.popitem(last=False)


class Access:
    """Check names, tokens and sessions of one server.

    A session is role, end and a random number, signed with the role's token: it outlives a
    restart with the same tokens, takes no memory, and reveals nothing of the other role's token.
    """

    def __init__(self, config: ViewerConfig) -> None:
        host, _ = address_of(config.listen)
        self.open = is_loopback(host) and not (config.token or config.viewer_token)
        seed = (os.environ.get(TOKEN_SEED) or secrets.token_urlsafe()).encode()
        self.tokens = {OPERATOR: config.token, VIEWER: config.viewer_token}
        for role, token in self.tokens.items():
            derived = hmac.digest(seed, role.encode(), "sha256")[:18]
            self.tokens[role] = token or base64.urlsafe_b64encode(derived).decode()
        self.scheme = "https" if config.certificate else "http"
        self._names = {*_LOOPBACK_NAMES, host.lower()}
        self._steady_s = time.time() - time.monotonic()  # a clock that is set ends no session
        if not is_loopback(host):
            name = socket.gethostname().lower()
            self._names |= {name, f"{name.partition('.')[0]}.local"}

    def refusal(self, request: web.Request) -> str:
        """Return why a request's host or origin is refused; empty if it is allowed."""
        host = request.headers.get("Host", "")
        if not (self._is_own(host) and request.raw_path.startswith("/")):
            return "the server does not have this name: open the page by its IP address"
        origin = request.headers.get("Origin")
        if origin is None:
            if request.method not in {"GET", "HEAD"} or is_websocket(request):
                return "the request names no origin"
            site = request.headers.get("Sec-Fetch-Site", "")
            is_foreign = request.path != "/" and site not in _SAME_SITE
        else:
            is_foreign = origin != f"{self.scheme}://{host}"
        return "the request comes from another site" if is_foreign else ""

    def _is_own(self, host: str) -> bool:
        """Return whether a Host header is an address or a name of this server.

        An attacker's name server may let any other name lead here (DNS rebinding).
        """
        match = _HOST.fullmatch(host)
        if match is None or int(match[2] or 0) > 65535:
            return False
        name = match[1].strip("[]").lower()
        return name in self._names or _address(name) is not None

    def role(self, request: web.Request) -> str | None:
        """Return the role of a request's sender; None without a valid session."""
        if self.open:
            return OPERATOR
        session = request.cookies.get(self.cookie(request), "")
        role, _, _ = session.partition(".")
        signed, _, signature = session.rpartition(".")
        if role not in self.tokens or not _same(self._signature(role, signed), signature):
            return None
        end = signed.split(".")[1]  # signed by this server, so of its form
        return role if int(end) > time.monotonic() + self._steady_s else None

    def user(self, request: web.Request) -> tuple[str | None, str]:
        """Return the role of a request's sender, and its share's owner: session or address."""
        role = self.role(request)
        if role is None or self.open:
            return role, request.remote or ""
        return role, request.cookies[self.cookie(request)]

    def role_of_token(self, token: str) -> str | None:
        """Return the role that a token opens, in the same time for every token."""
        fits = [role for role, own in self.tokens.items() if _same(own, token)]
        return fits[0] if fits else None

    def admit(self, response: web.Response, request: web.Request, role: str) -> None:
        """Give the browser a session."""
        end_s = int(time.monotonic() + self._steady_s) + _SESSION_S
        signed = f"{role}.{end_s}.{secrets.token_urlsafe(18)}"
        response.set_cookie(
            self.cookie(request),
            f"{signed}.{self._signature(role, signed)}",
            max_age=_SESSION_S,
            path="/",
            httponly=True,
            samesite="Strict",
            secure=self.scheme == "https",
        )

    @staticmethod
    def cookie(request: web.Request) -> str:
        """Return the cookie's name, with the port: a browser sends a cookie to all of a host."""
        match = _HOST.fullmatch(request.headers.get("Host", ""))
        return f"tirgeo_{(match and match[2]) or ''}"

    def _signature(self, role: str, signed: str) -> str:
        key = b"tirgeo session " + self.tokens[role].encode()
        return hmac.digest(key, _bytes(signed), "sha256").hex()


def is_websocket(request: web.Request) -> bool:
    """Return whether a request wants to become a WebSocket."""
    return request.headers.get("Upgrade", "").lower() == "websocket"


def is_loopback(host: str) -> bool:
    """Return whether only this computer can reach a host."""
    address = _address(host)
    return host in _LOOPBACK_NAMES or (address is not None and address.is_loopback)


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Return the IP address that a host is written as; None for a name."""
    with suppress(ValueError):
        return ipaddress.ip_address(host)
    return None


def _same(own: str, offered: str) -> bool:
    return hmac.compare_digest(_bytes(own), _bytes(offered))


def _bytes(text: str) -> bytes:
    """Return a text's bytes; a request may hold characters that UTF-8 cannot encode."""
    return text.encode(errors="replace")


class Guard:
    """Refuse requests from other sites, too many requests, and those without a session."""

    def __init__(self, access: Access, listener: Listener) -> None:
        self._access, self._listener = access, listener
        self._requests = Shares(_REQUESTS_A_S, _REQUESTS_AT_ONCE)
        self._wrong = WrongTokens()
        self._lines, self._unlogged = Allowance(1 / 60, 1), 0  # lines of the log

    @web.middleware
    async def middleware(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Check and answer a request; aiohttp calls this around each handler."""
        connection = self._listener.served.get(request.transport)
        try:
            refused = await self._refused(request, connection)
            # Not "or": aiohttp's answer is a mapping, and counts as false if that is empty.
            return await handler(request) if refused is None else refused
        except web.HTTPException as error:
            return refusal(error.status, error.reason.lower())
        except TirgeoError as error:
            return refusal(500, str(error))
        finally:
            if connection is not None:
                connection.answered()

    async def _refused(
        self, request: web.Request, connection: Connection | None
    ) -> web.Response | None:
        role, owner = self._access.user(request)
        if connection is not None:
            connection.requested(role, owner, websocket=is_websocket(request))
        if not self._requests.take(role, owner, time.monotonic()):
            await asyncio.sleep(_PAUSE_S)
            if role is not None:  # a stranger may share a flood's address: he only has to wait
                return refusal(429, "too many requests: wait a moment")
        words = self._access.refusal(request)
        if words:
            return refusal(403, words)
        # The page itself, which holds no data, needs no session.
        is_open = request.path in {"/", "/enter"} or request.path.startswith("/static/")
        if role is None and not is_open:
            return refusal(401, "open the page by the address or the code that the terminal shows")
        return None

    async def role(self, request: web.Request) -> web.Response:
        """Answer ``GET /enter``: the role; 401 says that a token is needed."""
        role = self._access.role(request)
        return web.json_response({"role": role}) if role else refusal(401, "a token is needed")

    async def enter(self, request: web.Request) -> web.Response:
        """Answer ``POST /enter``: a right token gets a session, a wrong one a wait."""
        token = await _token(request)
        # No await before ``add``: the next token must meet the wait that this one causes.
        address, now_s = request.remote or "", time.monotonic()
        wait_s = self._wrong.wait_s(address, now_s)
        if wait_s > 0:
            await asyncio.sleep(_PAUSE_S)
            answer = refusal(429, f"too many wrong tokens: wait {wait_s:.0f} s")
            answer.headers["Retry-After"] = str(round(wait_s) + 1)
            return answer
        role = self._access.role_of_token(token or "")
        if role is None:
            self._wrong.add(address, now_s)
            self._unlogged += 1
            if self._lines.take(now_s):
                _LOG.warning("wrong tokens: %d, the last from %s", self._unlogged, address)
                self._unlogged = 0
            if token is None:
                return refusal(400, "the body is too long for a token")
            return refusal(403, "wrong token: scan the code again")
        if role == OPERATOR:  # a viewer would lose the wait while guessing the other token
            self._wrong.forget(address)
        response = web.json_response({"role": role})
        self._access.admit(response, request, role)
        return response


def refusal(status: int, words: str) -> web.Response:
    """Return an answer with the reason of a refusal."""
    return web.json_response({"reason": words}, status=status)


async def add_headers(request: web.Request, response: web.StreamResponse) -> None:
    """Add to an answer the headers that tell the browser what the page may do."""
    host = request.headers.get("Host", "")
    # For browsers before 2022, to which 'self' did not include WebSockets.
    sockets = f" ws://{host} wss://{host}" if _HOST.fullmatch(host) else ""
    for name, value in HEADERS.items():
        response.headers.setdefault(name, value.format(sockets))
    response.headers.setdefault("Cache-Control", "no-store")
    response.headers["Server"] = "tirgeo"


async def _token(request: web.Request) -> str | None:
    """Return the token in a body, empty if there is none; None if the body is too long."""
    try:
        body = await asyncio.wait_for(request.read(), _BODY_S)
    except asyncio.TimeoutError:
        raise web.HTTPRequestTimeout from None
    if len(body) > _TOKEN_BYTES:
        return None
    try:
        document = json.loads(body)
    except ValueError:
        document = None
    token = document.get("token") if isinstance(document, dict) else None
    return token if isinstance(token, str) else ""
