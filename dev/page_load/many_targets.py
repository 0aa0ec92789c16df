"""Measure edits among many targets: ``python -m dev.page_load.many_targets``.

Each has the longest note. An edit lasts until its operator has the answer, and until the last
looker has the new name.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path

import aiohttp
import cv2
import numpy as np

from dev.judging import Figure, line
from dev.page_load.served import ServedPage
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import MOST_TARGETS
from tirgeo_ros.io.targets.store import MOST_NOTE, TargetStore

_EDITS, _EVERY_S, _LIMIT_S = 30, 0.5, 60.0
_GREY = cv2.imencode(".jpg", np.full((512, 640), 99, np.uint8))[1].tobytes()
_COVARIANCE = (0.1, 0, 0, 0, 0.1, 0, 0, 0, 0.1)


def figures(targets: int, lookers: int) -> Iterator[Figure]:
    """Yield the figures of edits of one target among many."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        edited = _fill(work / "targets.gpkg", targets)
        (work / "pictures").mkdir()
        (work / "pictures" / "grey.jpg").write_bytes(_GREY)
        with ServedPage(work / "pictures", work) as page:
            answered_ms, seen_ms = asyncio.run(_edit(page.url, edited, targets, lookers))
            peak = page.most_memory_bytes()
    what = f"{targets} targets, {lookers} lookers"
    yield Figure(f"{what}: edit to answer, 95 %", float(np.percentile(answered_ms, 95)), "ms")
    last_ms = float(np.percentile(seen_ms, 95))
    yield Figure(f"{what}: edit to last looker, 95 %", last_ms, "ms", "<= 150")
    yield Figure(f"{what}: server, most memory", peak * 2**-20, "MiB", "<= 381")


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


async def _edit(
    url: str, edited: str, targets: int, lookers: int
) -> tuple[list[float], list[float]]:
    """Return how long each edit took, ms: to its answer, and to the last looker."""
    answered_ms, seen_ms, was = [], [], f"target {targets // 2}"
    async with AsyncExitStack() as opened:
        session = await opened.enter_async_context(aiohttp.ClientSession(headers={"Origin": url}))
        connect = partial(session.ws_connect, f"{url}/state", max_msg_size=0)
        operator, *others = [
            await opened.enter_async_context(connect()) for _ in range(lookers + 1)
        ]
        await asyncio.gather(*(_seen_s(one, f"target {targets - 1}") for one in others))
        for k in range(_EDITS):
            name, request, begun_s = f"edit {k}", f"request {k}", time.monotonic()
            edit = {"type": "edit", "id": edited, "was": {"name": was}, "name": name}
            await operator.send_str(json.dumps(edit | {"request": request}))
            answer = asyncio.create_task(_seen_s(operator, request))
            last_s = max(await asyncio.gather(*(_seen_s(one, name) for one in others)))
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
    parser = argparse.ArgumentParser(
        prog="python -m dev.page_load.many_targets", description=__doc__
    )
    parser.add_argument("--targets", type=int, default=MOST_TARGETS, help="in the file")
    parser.add_argument("--lookers", type=int, default=10, help="pages beside the operator's")
    args = parser.parse_args(argv)
    sys.stdout.write(f"{os.cpu_count()} CPUs\n")
    for figure in figures(args.targets, args.lookers):
        sys.stdout.write(line(figure) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
