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
"""Measure the operator's page: ``python -m dev.page_load``.

sockets
    Three viewers without a browser, of which one clicks.
targets
    Edits among many targets, each with the longest note. An edit lasts until its operator has the
    answer, and until the last looker has the new name.
floods
    What is left for honest users while strangers flood the page.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from statistics import fmean

import aiohttp
import cv2
import numpy as np

from dev.judging import Figure, in_processes, percentile, print_figures
from dev.page_load.floods import flood_figures
from dev.page_load.served import Job, ServedPage, draw_pictures, pictures_in, watch
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import MOST_TARGETS
from tirgeo_ros.io.targets.store import MOST_NOTE, TargetStore
from tirgeo_ros.tools.graph import find_resource

_VIEWERS = 3


def socket_figures(work: Path, seconds: float) -> Iterator[Figure]:
    """Yield the figures of three viewers, of which one clicks."""
    flight = find_resource("bags/sample")
    assert flight is not None
    pictures = draw_pictures(flight, work)
    sizes = [(len(jpeg), len(shapes)) for jpeg, shapes in pictures_in(pictures)]
    for name, column in zip(("pictures", "shapes"), zip(*sizes, strict=True), strict=True):
        yield Figure(f"{name}, mean size", fmean(column) / 1e3, "kB")
    with ServedPage(pictures, work) as page:
        jobs = [Job(page.url, seconds, clicks=k == 0) for k in range(_VIEWERS)]
        begun_s, used_s = time.monotonic(), page.cpu_s()
        observed = in_processes(watch, jobs, len(jobs))
        cores = (page.cpu_s() - used_s) / (time.monotonic() - begun_s)
        memory_mib = page.memory_mib("VmRSS")
    late = [item for viewer in observed for item in viewer.late_ms]
    ages = [age for item in observed for age in item.ages_ms]
    yield Figure("own sleep late, 95 %", percentile(late, 95), "ms")
    yield Figure("pictures a second, least", min(item.hz for item in observed), "Hz")
    yield Figure("frame to screen, 95 %", percentile(ages, 95), "ms", "<= 120")
    yield Figure("click to answer, 95 %", percentile(observed[0].clicks_ms, 95), "ms", "<= 150")
    yield Figure("server", cores, "cores", "<= 0.35")
    yield Figure("server, memory at the end", memory_mib, "MiB")


_LOOKERS, _EDITS, _EVERY_S, _LIMIT_S = 10, 30, 0.5, 60.0
_GREY = cv2.imencode(".jpg", np.full((512, 640), 99, np.uint8))[1].tobytes()
_COVARIANCE = (0.1, 0, 0, 0, 0.1, 0, 0, 0, 0.1)


def target_figures(work: Path, _: float) -> Iterator[Figure]:
    """Yield the figures of edits of one target among many."""
    edited = _fill(work / "targets.gpkg", MOST_TARGETS)
    (work / "pictures").mkdir()
    (work / "pictures" / "grey.jpg").write_bytes(_GREY)
    with ServedPage(work / "pictures", work) as page:
        answered_ms, seen_ms = asyncio.run(_edit(page.url, edited))
        peak_mib = page.memory_mib("VmHWM")
    what = f"{MOST_TARGETS} targets, {_LOOKERS} lookers"
    yield Figure(f"{what}: edit to answer, 95 %", percentile(answered_ms, 95), "ms")
    yield Figure(f"{what}: edit to last looker, 95 %", percentile(seen_ms, 95), "ms", "<= 150")
    yield Figure(f"{what}: server, most memory", peak_mib, "MiB", "<= 381")


def _fill(path: Path, count: int) -> str:
    """Write a file of targets; return the id of one in its middle."""
    store = TargetStore(path)
    store._db.execute("PRAGMA synchronous = OFF")  # noqa: SLF001  this file is not to last
    for k in range(count):
        click = Located(k, 39.85 + k * 1e-6, 116.7, 30.0, _COVARIANCE)
        added = store.add(click, name=f"target {k}", now_ns=time.time_ns())
        store.edit(added.id, time.time_ns(), note="\u00e4" * MOST_NOTE)
    middle = store.all()[count // 2].id
    store.close()
    return middle


async def _edit(url: str, edited: str) -> tuple[list[float], list[float]]:
    """Return how long each edit took, ms: to its answer, and to the last looker."""
    answered_ms, seen_ms, was = [], [], f"target {MOST_TARGETS // 2}"
    async with AsyncExitStack() as opened:
        session = await opened.enter_async_context(aiohttp.ClientSession(headers={"Origin": url}))
        connect = partial(session.ws_connect, f"{url}/state", max_msg_size=0)
        operator, *others = [
            await opened.enter_async_context(connect()) for _ in range(_LOOKERS + 1)
        ]
        await asyncio.gather(*(_seen_s(item, f"target {MOST_TARGETS - 1}") for item in others))
        for k in range(_EDITS):
            name, request, begun_s = f"edit {k}", f"request {k}", time.monotonic()
            edit = {"type": "edit", "id": edited, "was": {"name": was}, "name": name}
            await operator.send_str(json.dumps(edit | {"request": request}))
            answer = asyncio.create_task(_seen_s(operator, request))
            last_s = max(await asyncio.gather(*(_seen_s(item, name) for item in others)))
            seen_ms.append((last_s - begun_s) * 1e3)
            answered_ms.append((await answer - begun_s) * 1e3)
            was = name
            await asyncio.sleep(_EVERY_S)
    return answered_ms, seen_ms


async def _seen_s(socket: aiohttp.ClientWebSocketResponse, words: str) -> float:
    """Return when a message that holds the words has come."""
    while f'"{words}"' not in str((await socket.receive(_LIMIT_S)).data):
        pass
    return time.monotonic()


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m dev.page_load", description=__doc__)
    parser.add_argument("what", nargs="?", choices=_MEASURES, default="sockets")
    parser.add_argument("--seconds", type=float, default=20.0, help="of watching or flooding")
    args = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        print_figures(_MEASURES[args.what](Path(folder), args.seconds))
    return 0


_MEASURES: dict[str, Callable[[Path, float], Iterator[Figure]]] = {
    "sockets": socket_figures,
    "targets": target_figures,
    "floods": flood_figures,
}


if __name__ == "__main__":
    sys.exit(main())
