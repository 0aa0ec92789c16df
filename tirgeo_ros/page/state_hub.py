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
"""Send each page the newest states and targets, and the answers to its requests."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from aiohttp import WSMsgType, web

from tirgeo_ros.page.actions import FOR_VIEWERS, Actions, RequestError, read_request
from tirgeo_ros.page.connections import OPERATOR, Allowance

_REQUESTS_A_S, _REQUESTS_AT_ONCE = 50.0, 100.0  # a page that was offline sends its kept requests
_PAUSE_S = 0.1  # nothing is read after a refusal, which slows down a flood
_RUNNING = 64  # requests of a page that are being answered
_UNREAD = 100  # answers that wait; a page with more does not read them
_PERIOD_S = 0.2  # states go out at most at 5 Hz
_MOST_POINTS = 20_000  # of a track that newcomers get
_POINTS_AT_ONCE, _TARGETS_AT_ONCE = 500, 50  # so that they do not delay the state on a slow link


class StatePage:
    """Serve one page's WebSocket: states and targets out, requests in."""

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
        """Send and answer until the peer leaves."""
        self._outbox.answer(hello)
        self._hub.join(self._outbox, who)

        async def send() -> None:
            while True:
                await self._socket.send_str(await self._outbox.take())

        sending = asyncio.create_task(send())
        try:
            await self._listen()
        finally:
            self._hub.leave(self._outbox)
            sending.cancel()
            await asyncio.gather(sending, *self._running, return_exceptions=True)

    async def _listen(self) -> None:
        async for message in self._socket:
            if message.type is not WSMsgType.TEXT or len(self._outbox.answers) > _UNREAD:
                await self._socket.close(code=1008, message=b"only texts, and read the answers")
                return
            try:
                self._begin(message.data)
            except RequestError as error:
                refusal = {"type": "answer", "request": error.request, "ok": False}
                self._outbox.answer({**refusal, "reason": str(error)})
                await asyncio.sleep(_PAUSE_S)
            await asyncio.sleep(0)  # a flood must not delay the others, nor its own answers

    def _begin(self, text: str) -> None:
        """Begin to answer a request; raises RequestError."""
        name, kind, fields = read_request(text)
        now_s = time.monotonic()
        may = self._allowance.take(now_s) and self._may(now_s)
        if not may or len(self._running) >= _RUNNING:
            raise RequestError("too many requests at once: wait a moment", name)
        if self._role != OPERATOR and kind not in FOR_VIEWERS:
            raise RequestError("a viewer may not change anything", name)

        async def answer() -> None:
            """Answer; a change that is confirmed is on the disk."""
            result = await self._actions.answer(name, kind, fields)
            self._outbox.answer({"type": "answer", "request": name, **result})

        task = asyncio.create_task(answer())
        self._running.add(task)
        task.add_done_callback(self._running.discard)


class Track:
    """Hold the aircraft's track; a point keeps its index when the oldest are dropped."""

    def __init__(self) -> None:
        self.first = 0  # index of the oldest point kept
        self.points: list[Any] = []

    def add(self, points: list[Any], start: int | None) -> None:
        """Add points; the first gets the index ``start``, or the next index for None."""
        at = len(self.points) if start is None else start - self.first
        if not 0 <= at <= len(self.points):  # the node was started again
            at, self.first, self.points = 0, start or 0, []
        self.points[at:] = points
        spare = max(len(self.points) - _MOST_POINTS, 0)
        del self.points[:spare]
        self.first += spare

    def after(self, index: int) -> tuple[int, list[Any]]:
        """Return the next points from an index on, and the index of the first of them."""
        at = max(index - self.first, 0)
        return self.first + at, self.points[at : at + _POINTS_AT_ONCE]


class Outbox:
    """Hold the messages for one page: the newest by key, and every answer."""

    def __init__(self) -> None:
        self.answers: list[str] = []  # waiting
        self._newest: dict[str, Callable[[], str]] = {}
        self._has_message = asyncio.Event()
        self.track_ends: dict[str, int] = {}
        self.targets: dict[str, str] = {}  # to be sent yet, by id
        self.has_targets = False

    def answer(self, message: Mapping[str, Any]) -> None:
        """Add an answer."""
        self.answers.append(json.dumps(message))
        self._has_message.set()

    def put(self, key: str, text: Callable[[], str]) -> None:
        """Replace the message of a key; its text is made when it is sent."""
        self._newest[key] = text
        self._has_message.set()

    async def take(self) -> str:
        """Return the next text: answers first."""
        while not self.answers and not self._newest:
            self._has_message.clear()
            await self._has_message.wait()
        if self.answers:
            return self.answers.pop(0)
        return self._newest.pop(next(iter(self._newest)))()


class StateHub:
    """Give states and targets to every page.

    ``latency_ms(aircraft, who)`` returns the time from taking a picture of an aircraft to showing
    it on that user's screen.
    """

    def __init__(self, latency_ms: Callable[[str, str], float | None]) -> None:
        self._latency_ms = latency_ms
        self._pages: dict[Outbox, str] = {}
        self._states: dict[str, dict[str, Any]] = {}
        self._tracks: dict[str, Track] = {}
        self._waiting: dict[str, asyncio.TimerHandle] = {}
        self._sent_s: dict[str, float] = {}
        self._targets: dict[str, str] | None = None  # None: the file is not read yet

    def join(self, outbox: Outbox, who: str) -> None:
        """Give a page all states and targets, and from now on each change."""
        self._pages[outbox] = who
        if self._targets is not None:
            self._put_targets(outbox, self._targets)
        for aircraft in self._states:
            self._put(outbox, who, aircraft)

    def leave(self, outbox: Outbox) -> None:
        """Give a page nothing more."""
        self._pages.pop(outbox, None)

    def change_targets(self, texts: Mapping[str, str]) -> None:
        """Give all pages the targets that have changed, JSON by id; "" for one that is gone."""
        if texts or self._targets is None:
            now = {**(self._targets or {}), **texts}
            self._targets = {id_: text for id_, text in now.items() if text}
            for outbox in self._pages:
                self._put_targets(outbox, texts)

    def report(self, aircraft: str, state: dict[str, Any]) -> None:
        """Give all pages a state, now or when the last is 0.2 s old; ``track`` has new points."""
        start = state.pop("track_from", None)
        self._tracks.setdefault(aircraft, Track()).add(state.pop("track", None) or [], start)
        for outbox in self._pages if start is not None else ():  # points from there are replaced
            outbox.track_ends[aircraft] = min(outbox.track_ends.get(aircraft, 0), start)
        self._states[aircraft] = {"type": "state", "aircraft": aircraft, **state}
        if aircraft in self._waiting:
            return
        loop = asyncio.get_running_loop()
        wait_s = self._sent_s.get(aircraft, -math.inf) + _PERIOD_S - loop.time()
        self._waiting[aircraft] = loop.call_later(max(wait_s, 0), self._send, aircraft)

    def _send(self, aircraft: str) -> None:
        del self._waiting[aircraft]
        self._sent_s[aircraft] = asyncio.get_running_loop().time()
        for outbox, who in self._pages.items():
            self._put(outbox, who, aircraft)

    def _put(self, outbox: Outbox, who: str, aircraft: str) -> None:
        outbox.put(f"state {aircraft}", lambda: self._state_text(outbox, who, aircraft))

    def _put_targets(self, outbox: Outbox, texts: Mapping[str, str]) -> None:
        outbox.targets.update(texts)
        outbox.put("targets", lambda: self._targets_text(outbox))

    def _targets_text(self, outbox: Outbox) -> str:
        part = {id_: outbox.targets.pop(id_) for id_ in [*outbox.targets][:_TARGETS_AT_ONCE]}
        if outbox.targets:
            self._put_targets(outbox, {})
        gone = [id_ for id_, text in part.items() if not text]
        own = {"whole": not outbox.has_targets, "more": bool(outbox.targets), "gone": gone}
        outbox.has_targets = True
        texts = ", ".join(filter(None, part.values()))
        return f'{json.dumps({"type": "targets"} | own)[:-1]}, "targets": [{texts}]}}'

    def _state_text(self, outbox: Outbox, who: str, aircraft: str) -> str:
        start, points = self._tracks[aircraft].after(outbox.track_ends.get(aircraft, 0))
        outbox.track_ends[aircraft] = start + len(points)
        own = {"track_from": start, "track": points}
        own["latency_ms"] = self._latency_ms(aircraft, who)
        return json.dumps(self._states[aircraft] | own)


def plain(value: Any) -> Any:
    """Return a value for JSON: non-finite numbers as None, no tuples; raise TypeError."""
    if isinstance(value, np.generic):
        return plain(value.item())
    if value is None or isinstance(value, (str, bool)):
        return value
    if isinstance(value, (int, float)):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    raise TypeError(f"{type(value).__name__} has no JSON")
