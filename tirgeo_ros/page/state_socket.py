"""Talk with one page: states and targets out, requests in, an answer to each."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

from aiohttp import WSMsgType, web

from tirgeo_ros.page.access import OPERATOR
from tirgeo_ros.page.actions import Actions
from tirgeo_ros.page.limits import Allowance
from tirgeo_ros.page.requests import FOR_VIEWERS, RequestError, read_request
from tirgeo_ros.page.state_hub import Outbox, StateHub

_REQUESTS_A_S, _REQUESTS_AT_ONCE = 50.0, 100.0  # a page that was offline sends what it kept
_PAUSE_S = 0.1  # after a refusal nothing is read: a flood stays in its own network
_RUNNING = 64  # requests of a page that are being answered
_UNREAD = 100  # answers that a page has not taken: it does not read


class StatePage:
    """Be one page's WebSocket."""

    def __init__(
        self,
        socket: web.WebSocketResponse,
        role: str,
        actions: Actions,
        hub: StateHub,
        may: Callable[[float], bool],
    ) -> None:
        self._socket, self._role, self._may = socket, role, may
        self._actions, self._hub = actions, hub
        self._outbox = Outbox()
        self._running: set[asyncio.Task[None]] = set()
        self._allowance = Allowance(_REQUESTS_A_S, _REQUESTS_AT_ONCE)

    async def run(self, hello: dict[str, Any], who: str) -> None:
        """Talk until the peer leaves."""
        self._outbox.answer(hello)
        self._hub.join(self._outbox, who)
        sending = asyncio.create_task(self._send())
        try:
            await self._listen()
        finally:
            self._hub.leave(self._outbox)
            sending.cancel()
            await asyncio.gather(sending, *self._running, return_exceptions=True)

    async def _send(self) -> None:
        while True:
            await self._socket.send_str(await self._outbox.take())

    async def _listen(self) -> None:
        async for message in self._socket:
            if message.type is not WSMsgType.TEXT or self._outbox.answers > _UNREAD:
                await self._socket.close(code=1008, message=b"texts alone, and read the answers")
                return
            try:
                self._begin(message.data)
            except RequestError as error:
                refusal = {"type": "answer", "request": error.request, "ok": False}
                self._outbox.answer({**refusal, "reason": str(error)})
                await asyncio.sleep(_PAUSE_S)
            await asyncio.sleep(0)  # a flood must not hold up the others, nor its own answers

    def _begin(self, text: str) -> None:
        """Begin to answer a request; raises RequestError."""
        name, kind, fields = read_request(text)
        now_s = time.monotonic()
        may = self._allowance.take(now_s) and self._may(now_s)
        if not may or len(self._running) >= _RUNNING:
            raise RequestError("too many requests at once: wait a moment", name)
        if self._role != OPERATOR and kind not in FOR_VIEWERS:
            raise RequestError("you may look on, not change anything", name)
        task = asyncio.create_task(self._answer(name, kind, fields))
        self._running.add(task)
        task.add_done_callback(self._running.discard)

    async def _answer(self, name: str, kind: str, fields: dict[str, Any]) -> None:
        """Answer; a confirmed change is then on the disk."""
        found = await self._actions.answer(name, kind, fields)
        self._outbox.answer({"type": "answer", "request": name, **found})
