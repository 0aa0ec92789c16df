"""View a page from a process of its own."""

from __future__ import annotations

import asyncio
import json
import struct
import time
from typing import Any, NamedTuple

import aiohttp
import cv2
import numpy as np

_HEADER = struct.Struct("<QQIHH")
_SETTLE_S = 4.0  # not counted: the link is found out
_CLICK_EVERY_S = 0.5
_SLEEP_S = 0.05


class Job(NamedTuple):
    """Say what a viewer does."""

    url: str
    seconds: float
    clicks: bool = False


class Watched(NamedTuple):
    """Hold what a viewer saw."""

    ages_ms: list[float]  # of each picture when it is decoded
    clicks_ms: list[float]  # from click to answer
    late_ms: list[float]  # of a short sleep: what a busy machine alone does to all of these
    seconds: float

    @property
    def hz(self) -> float:
        """Return pictures a second."""
        return len(self.ages_ms) / self.seconds


def watch(job: Job) -> Watched:
    """Watch for a time."""
    return asyncio.run(_Viewer(job).watch())


def click_text(request: str, stamp_ns: int) -> str:
    """Return a click on the middle of a picture, as the page sends it."""
    click = {"type": "click", "request": request, "aircraft": "", "kind": "person"}
    place = {"stamp_ns": str(stamp_ns), "u": 320.0, "v": 256.0, "refine": None}
    return json.dumps(click | place)


async def oversleep(late_ms: list[float]) -> None:
    """Note how late short sleeps end, for ever: what a busy machine alone does to all figures."""
    while True:
        begun = time.monotonic()
        await asyncio.sleep(_SLEEP_S)
        late_ms.append((time.monotonic() - begun - _SLEEP_S) * 1e3)


class _Viewer:
    def __init__(self, job: Job) -> None:
        self._job = job
        self._stamp_ns = 0
        self._clicked: dict[str, float] = {}
        self._watched = Watched([], [], [], job.seconds)

    async def watch(self) -> Watched:
        origin = {"Origin": self._job.url}
        async with (
            aiohttp.ClientSession(headers=origin) as session,
            session.ws_connect(f"{self._job.url}/state") as state,
            session.ws_connect(f"{self._job.url}/video/") as video,
        ):
            work = (self._look(video), self._read(state), oversleep(self._watched.late_ms))
            tasks = [asyncio.create_task(part) for part in work]
            if self._job.clicks:
                tasks.append(asyncio.create_task(self._click(state)))
            await asyncio.sleep(_SETTLE_S + self._job.seconds)
            for task in tasks:
                task.cancel()
        return self._watched

    async def _look(self, video: aiohttp.ClientWebSocketResponse) -> None:
        begun = time.monotonic()
        async for message in video:
            self._stamp_ns, _, number, _, _ = _HEADER.unpack_from(message.data)
            jpeg = np.frombuffer(message.data, np.uint8, offset=_HEADER.size)
            assert cv2.imdecode(jpeg, cv2.IMREAD_COLOR) is not None
            await video.send_str(f"shown {number}")
            if time.monotonic() - begun > _SETTLE_S:
                self._watched.ages_ms.append((time.time_ns() - self._stamp_ns) * 1e-6)

    async def _read(self, state: aiohttp.ClientWebSocketResponse) -> None:
        async for message in state:
            answer: dict[str, Any] = json.loads(message.data)
            if answer["type"] == "answer":
                assert answer["ok"], answer
                clicked_s = self._clicked.pop(answer["request"])
                self._watched.clicks_ms.append((time.monotonic() - clicked_s) * 1e3)

    async def _click(self, state: aiohttp.ClientWebSocketResponse) -> None:
        while True:
            await asyncio.sleep(_CLICK_EVERY_S)
            name = f"r{time.monotonic_ns()}"
            self._clicked[name] = time.monotonic()
            await state.send_str(click_text(name, self._stamp_ns))
