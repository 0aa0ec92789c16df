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
"""Flood a page on this computer, for a bounded time, and measure what is left for honest users.

Five addresses hold idle connections and ask without end; eighty guess tokens; a viewer asks to
measure without end; the operator's own address holds, asks and has that viewer too.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import multiprocessing
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import aiohttp
import cv2
import numpy as np

from dev.judging import Figure, percentile
from dev.page_load.served import ServedPage, click_text, oversleep
from tirgeo_ros.core.config.viewer_parameters import ViewerConfig

_OPERATOR, _VIEWER = "operator-of-a-flood", "viewer-of-a-flood"
_CONFIG = replace(ViewerConfig(), listen="127.0.0.1:0", token=_OPERATOR, viewer_token=_VIEWER)
_OWN, _FLOODING = "127.0.0.1", [f"127.0.0.{11 + k}" for k in range(5)]
_GUESSING = [f"127.0.1.{1 + k}" for k in range(80)]
_NEW = [f"127.0.2.{1 + k}" for k in range(10)]
_IDLE, _ASKING, _SOCKETS = 120, 10, 10  # connections of one address; sockets of the viewer
_PAUSE_S = 0.01  # between two requests of one connection: a bound, not a courtesy
_CHANGES, _MOST_TRIES, _GIVE_UP_S = 40, 20, 5.0
_CALM_S, _SETTLE_S, _LONGEST_S = 4.0, 3.0, 60.0


def flood_figures(work: Path, seconds: float) -> Iterator[Figure]:
    """Yield the figures of a page under all floods at once."""
    pictures = work / "pictures"
    pictures.mkdir()
    noise = np.random.default_rng(1).integers(0, 90, (512, 640), np.uint8)
    cv2.imwrite(str(pictures / "0.jpg"), noise)
    with ServedPage(pictures, work, _CONFIG) as page:
        yield from asyncio.run(_measured(page, min(seconds, _LONGEST_S)))


async def _measured(page: ServedPage, seconds: float) -> list[Figure]:
    async with _session(page.url, _OWN) as session:
        await _entered(session, page.url, _OPERATOR)
        async with session.ws_connect(f"{page.url}/state") as state:
            before_ms = await _press(state, _CALM_S / _CHANGES)
            flood = multiprocessing.get_context("spawn").Process(
                target=_flood, args=(page.url, seconds + _SETTLE_S), daemon=True
            )
            flood.start()
            await asyncio.sleep(_SETTLE_S)
            begun_s, used_s = time.monotonic(), page.cpu_s()
            late_ms: list[float] = []
            sleeping = asyncio.create_task(oversleep(late_ms))
            answers_ms, answered, tries, beside, mistyped_s = await asyncio.gather(
                _press(state, seconds / _CHANGES),
                _ask_anew(session, page.url, seconds / _CHANGES),
                _come(page.url, seconds / len(_NEW), _NEW),
                _come(page.url, seconds / len(_NEW), [_FLOODING[0]] * len(_NEW)),
                _mistype(page.url),
            )
            sleeping.cancel()
            cores = (page.cpu_s() - used_s) / (time.monotonic() - begun_s)
            flood.join(seconds)
            flood.terminate()
    return [
        Figure("own sleep late, 95 %", percentile(late_ms, 95), "ms"),
        Figure("press to answer before the floods, 95 %", percentile(before_ms, 95), "ms"),
        Figure("operator's changes", len(answers_ms), f"of {_CHANGES}", "= 40"),
        Figure("press to answer, median", percentile(answers_ms, 50), "ms"),
        Figure("press to answer, 95 %", percentile(answers_ms, 95), "ms", "<= 300"),
        Figure("operator's GETs on new connections", answered, f"of {_CHANGES}", "= 40"),
        Figure("new honest user in after, most", max(tries), "tries", "<= 3"),
        Figure("the same at a flooding address, most", max(beside), "tries", "<= 3"),
        Figure("in after one typing error", mistyped_s, "s", "<= 5"),
        Figure("server", cores, "cores"),
    ]


async def _press(state: aiohttp.ClientWebSocketResponse, every_s: float) -> list[float]:
    """Press, and return the times of good answers (ms)."""
    answers_ms = []
    for k in range(_CHANGES):
        name, begun_s = f"press {k}", time.monotonic()
        with contextlib.suppress(OSError, asyncio.TimeoutError, TypeError, aiohttp.ClientError):
            await state.send_str(click_text(name, time.time_ns()))
            if await asyncio.wait_for(_is_good(state, name), _GIVE_UP_S):
                answers_ms.append((time.monotonic() - begun_s) * 1e3)
        await asyncio.sleep(max(0.0, begun_s + every_s - time.monotonic()))
    return answers_ms


async def _is_good(state: aiohttp.ClientWebSocketResponse, name: str) -> bool:
    while True:
        answer = json.loads((await state.receive()).data)
        if answer.get("request") == name:
            return bool(answer["ok"])


async def _ask_anew(session: aiohttp.ClientSession, url: str, every_s: float) -> int:
    """GET on a new connection each time, and return how many were answered."""
    cookies = {cookie.key: cookie.value for cookie in session.cookie_jar}
    answered = 0
    for _ in range(_CHANGES):
        begun_s = time.monotonic()
        with contextlib.suppress(OSError, asyncio.TimeoutError, aiohttp.ClientError):
            async with _session(url, _OWN, cookies) as own, own.get(f"{url}/map/") as answer:
                answered += answer.status == 200
        await asyncio.sleep(max(0.0, begun_s + every_s - time.monotonic()))
    return answered


async def _come(url: str, every_s: float, addresses: Sequence[str]) -> list[int]:
    """Open the page and enter, from each address; return how many tries each took."""
    tries = []
    for address in addresses:
        begun_s, count = time.monotonic(), 1
        while count < _MOST_TRIES and not await _is_in(url, address):
            count += 1
        tries.append(count)
        await asyncio.sleep(max(0.0, begun_s + every_s - time.monotonic()))
    return tries


async def _is_in(url: str, address: str) -> bool:
    with contextlib.suppress(OSError, asyncio.TimeoutError, aiohttp.ClientError):
        async with _session(url, address) as session:
            async with session.get(f"{url}/") as answer:
                if answer.status != 200:
                    return False
            return await _entered(session, url, _OPERATOR)
    return False


async def _mistype(url: str) -> float:
    """Enter a wrong token, then the right one until it is taken; return the time (s)."""
    begun_s = time.monotonic()
    async with _session(url, "127.0.2.200") as session:
        for token in ("mistyped-token", *[_OPERATOR] * 200):
            with contextlib.suppress(OSError, asyncio.TimeoutError, aiohttp.ClientError):
                if await _entered(session, url, token):
                    return time.monotonic() - begun_s
            await asyncio.sleep(0.5)
    return float("inf")


def _session(
    url: str, address: str, cookies: dict[str, str] | None = None
) -> aiohttp.ClientSession:
    return aiohttp.ClientSession(
        connector=aiohttp.TCPConnector(local_addr=(address, 0)),
        cookie_jar=aiohttp.CookieJar(unsafe=True),
        cookies=cookies,
        headers={"Origin": url},
        timeout=aiohttp.ClientTimeout(_GIVE_UP_S),
    )


async def _entered(session: aiohttp.ClientSession, url: str, token: str) -> bool:
    async with session.post(f"{url}/enter", json={"token": token}) as answer:
        return answer.status == 200


def _flood(url: str, seconds: float) -> None:
    with contextlib.suppress(asyncio.TimeoutError):
        asyncio.run(asyncio.wait_for(_flood_all(url), seconds))


async def _flood_all(url: str) -> None:
    host = url.partition("//")[2]
    head = f"Host: {host}\r\nOrigin: {url}\r\n"
    get = f"GET / HTTP/1.1\r\n{head}\r\n".encode()
    token = json.dumps({"token": "guessed-token"})
    post = f"POST /enter HTTP/1.1\r\n{head}Content-Length: {len(token)}\r\n\r\n{token}".encode()
    port = urlsplit(url).port or 0
    viewer = await _viewer(url)
    work: list[Coroutine[Any, Any, None]] = [_measure(viewer, url) for _ in range(_SOCKETS)]
    for address in (_OWN, *_FLOODING):
        work += [_again(lambda a=address: _hold(port, a)) for _ in range(_IDLE)]  # type: ignore[misc]
        work += [_again(lambda a=address: _ask(port, a, get)) for _ in range(_ASKING)]  # type: ignore[misc]
    work += [_again(lambda a=address: _ask(port, a, post)) for address in _GUESSING]  # type: ignore[misc]
    async with viewer:
        await asyncio.gather(*work)


async def _again(attack: Callable[[], Coroutine[Any, Any, None]]) -> None:
    while True:
        with contextlib.suppress(OSError):
            await attack()
        await asyncio.sleep(_PAUSE_S * 10)


async def _hold(port: int, address: str) -> None:
    reader, writer = await asyncio.open_connection(_OWN, port, local_addr=(address, 0))
    await reader.read()
    writer.close()


async def _ask(port: int, address: str, request: bytes) -> None:
    reader, writer = await asyncio.open_connection(_OWN, port, local_addr=(address, 0))
    try:
        while True:
            writer.write(request)
            if not await reader.read(65536):
                return
            await asyncio.sleep(_PAUSE_S)
    finally:
        writer.close()


async def _viewer(url: str) -> aiohttp.ClientSession:
    session = _session(url, _OWN)
    for _ in range(_MOST_TRIES):
        if await _entered(session, url, _VIEWER):
            break
    return session


async def _measure(session: aiohttp.ClientSession, url: str) -> None:
    """Ask to measure, twenty at once, and read the answers."""
    text = json.dumps({"type": "measure", "request": "m", "from": [48, 16], "to": [48, 17]})
    while True:
        with contextlib.suppress(OSError, aiohttp.ClientError, asyncio.TimeoutError):
            async with session.ws_connect(f"{url}/state") as state:
                while not state.closed:
                    for _ in range(20):
                        await state.send_str(text)
                    await state.receive()
                    await asyncio.sleep(_PAUSE_S)
        await asyncio.sleep(_PAUSE_S * 10)
