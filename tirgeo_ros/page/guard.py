"""Look at each request before anything answers it, and mark each answer."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import Awaitable, Callable

from aiohttp import web

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.page.access import (
    OPERATOR,
    Access,
    Allowance,
    Shares,
    WrongTokens,
    is_websocket,
    plain_host,
)
from tirgeo_ros.page.connections import Connection, Listener

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
#: A page begins with some thirty files, a map with as many tiles.
_REQUESTS_A_S, _REQUESTS_AT_ONCE = 60.0, 400.0
_PAUSE_S = 0.5  # before the answer to each that is too much
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


class Guard:
    """Refuse requests from elsewhere, too many of them, and those without a session."""

    def __init__(self, access: Access, listener: Listener) -> None:
        self._access, self._listener = access, listener
        self._requests = Shares(_REQUESTS_A_S, _REQUESTS_AT_ONCE)
        self._wrong = WrongTokens()
        self._lines, self._unlogged = Allowance(1 / 60, 1), 0  # lines of the log

    @web.middleware
    async def middleware(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answer a request, as aiohttp calls it around each handler."""
        connection = self._listener.served.get(request.transport)
        try:
            refused = await self._refused(request, connection)
            # Not "or": an answer counts as false where aiohttp has it as an empty mapping.
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
            connection.asked(role, owner, websocket=is_websocket(request))
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
        """Answer ``POST /enter`` with a session for a right token; a wrong one costs time."""
        token = await _token(request)
        # Nothing waits from here on: the next token meets the wait that this one has earned.
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
                return refusal(400, "the body is no token")
            return refusal(403, "wrong token: scan the code again")
        if role == OPERATOR:  # a viewer would have no wait while he guesses the other token
            self._wrong.forget(address)
        response = web.json_response({"role": role})
        self._access.admit(response, request, role)
        return response


def refusal(status: int, words: str) -> web.Response:
    """Return an answer that says why not."""
    return web.json_response({"reason": words}, status=status)


async def mark(request: web.Request, response: web.StreamResponse) -> None:
    """Give each answer the headers that tell the browser what the page may do."""
    host = plain_host(request)  # for browsers to which 'self' is no WebSocket, as before 2022
    sockets = f" ws://{host} wss://{host}" if host else ""
    for name, value in HEADERS.items():
        response.headers.setdefault(name, value.format(sockets))
    response.headers.setdefault("Cache-Control", "no-store")
    response.headers["Server"] = "tirgeo"


async def _token(request: web.Request) -> str | None:
    """Return the token that a body gives, empty if it gives none; None for a body too long."""
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
