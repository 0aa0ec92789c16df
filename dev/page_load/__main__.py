"""Measure the operator's page: ``python -m dev.page_load``.

sockets
    Three viewers without a browser, then two beside one on a thin link.
browser
    Chromium as one of three viewers: first of the server alone at 30 pictures a second, then of
    the real nodes (``tirgeo demo --serial --page``) at the flight's own rate.
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
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, AsyncExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import aiohttp
import cv2
import numpy as np

from dev.graphs import chromium, cpu_s, node_pid, shown_demo
from dev.judging import Figure, in_processes, percentile, print_figures
from dev.page_load.floods import flood_figures
from dev.page_load.served import ServedPage, draw_pictures, pictures_in
from dev.page_load.viewers import Job, ThinLink, Watched, watch
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import MOST_TARGETS
from tirgeo_ros.io.targets.store import MOST_NOTE, TargetStore
from tirgeo_ros.tools.graph import find_resource

if TYPE_CHECKING:
    from playwright.sync_api import Page

_VIEWERS = 3
_THIN_BITS_A_S = 1e6


def socket_figures(flight: Path, seconds: float) -> Iterator[Figure]:
    """Yield the figures of three viewers alone, then of two beside one on a thin link."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        pictures = draw_pictures(flight, work, work / "pictures")
        yield from _socket_figures(pictures, work, seconds)


def _socket_figures(pictures: Path, work: Path, seconds: float) -> Iterator[Figure]:
    sizes = [len(jpeg) for jpeg in pictures_in(pictures)]
    yield Figure("pictures, mean size", float(np.mean(sizes)) / 1e3, "kB")
    with ServedPage(pictures, work) as page:
        jobs = [Job(page.url, seconds, clicks=k == 0) for k in range(_VIEWERS)]
        seen, cores = _watched(page, jobs)
        yield from _alone(seen, cores)
        port = int(page.url.rpartition(":")[2])
        with ThinLink(port, _THIN_BITS_A_S) as near:
            thin = Job(f"http://127.0.0.1:{near}", seconds)
            seen, cores = _watched(page, [*jobs[1:], thin])
        yield from _beside(seen, cores)
        yield Figure("server, memory at the end", page.memory_bytes() * 2**-20, "MiB")


def _watched(page: ServedPage, jobs: Sequence[Job]) -> tuple[list[Watched], float]:
    """Return what the viewers saw, and the server's cores meanwhile."""
    begun, used = time.monotonic(), page.cpu_s()
    seen = in_processes(watch, jobs, len(jobs))
    return seen, (page.cpu_s() - used) / (time.monotonic() - begun)


def _alone(seen: Sequence[Watched], cores: float) -> Iterator[Figure]:
    ages = [age for one in seen for age in one.ages_ms]
    clicks = seen[0].clicks_ms
    yield _lateness("three viewers", seen)
    yield Figure("three viewers: pictures a second, least", min(one.hz for one in seen), "Hz")
    yield Figure("three viewers: frame to screen, median", float(np.median(ages)), "ms")
    yield Figure("three viewers: frame to screen, 95 %", percentile(ages, 95), "ms", "<= 120")
    yield Figure("three viewers: click to answer, median", float(np.median(clicks)), "ms")
    yield Figure("three viewers: click to answer, 95 %", percentile(clicks, 95), "ms", "<= 150")
    yield Figure("three viewers: server", cores, "cores", "<= 0.35")


def _beside(seen: Sequence[Watched], cores: float) -> Iterator[Figure]:
    *others, thin = seen
    ages = [age for one in others for age in one.ages_ms]
    yield _lateness("1 Mbit/s", seen)
    yield Figure("1 Mbit/s: pictures a second", thin.hz, "Hz")
    yield Figure("1 Mbit/s: mean size", float(np.mean(thin.sizes)) / 1e3, "kB")
    yield Figure("1 Mbit/s: age, median", float(np.median(thin.ages_ms)), "ms")
    yield Figure("1 Mbit/s: age, 95 %", percentile(thin.ages_ms, 95), "ms", "<= 500")
    yield Figure("others beside it: pictures a second", min(o.hz for o in others), "Hz")
    yield Figure("others beside it: frame to screen, 95 %", percentile(ages, 95), "ms", "<= 120")
    yield Figure("others beside it: server", cores, "cores", "<= 0.35")


def _lateness(name: str, seen: Sequence[Watched]) -> Figure:
    late = [one for viewer in seen for one in viewer.late_ms]
    return Figure(f"{name}: own sleep late, 95 %", percentile(late, 95), "ms")


_SETTLE_S = 6.0
_BESIDE = 2
#: Of each picture, the time from its stamp to the first moment that it can be on the screen.
_MEASURE = """async ([seconds, clickEvery]) => {
  const { Stage } = await import("/static/js/video/stage.js");
  const { stageOf } = await import("/static/js/video/stages.js");
  const { ask } = await import("/static/js/link/state_link.js");
  const now = () => performance.timeOrigin + performance.now();
  const [ages, clicks, refused] = [[], [], {}];
  const show = Stage.prototype.show;
  Stage.prototype.show = function (frame) {
    show.call(this, frame);
    const stamp = Number(BigInt(frame.stampNs) / 1000n) / 1000;
    requestAnimationFrame(() => ages.push(now() - stamp));
  };
  const end = now() + seconds * 1000;
  while (now() < end) {
    await new Promise((go) => setTimeout(go, clickEvery));
    const [begun, stamp] = [now(), stageOf("").frame.stampNs];
    const place = { aircraft: "", stamp_ns: stamp, u: 320, v: 300, kind: "person", refine: null };
    const answer = await ask("click", place);
    if (answer.ok) clicks.push(now() - begun);
    else refused[answer.reason] = (refused[answer.reason] ?? 0) + 1;
  }
  Stage.prototype.show = show;
  return { ages, clicks, refused };
}"""


def browser_figures(flight: Path, seconds: float) -> Iterator[Figure]:
    """Yield the figures of the server alone, then of the real nodes."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        draw_pictures(flight, work, work / "pictures")
        with ServedPage(work / "pictures", work) as page, _shown_page(page.url) as screen:
            seen, cores = _seen(screen, page.url, seconds, page.cpu_s)
        yield from _judged("server at 30 Hz", seen, seconds)
        yield Figure("server at 30 Hz: server", cores, "cores", "<= 0.35")
    with (
        tempfile.TemporaryDirectory() as name,
        _flown(flight, Path(name)) as (url, demo),
        _shown_page(url) as screen,
    ):
        pid = node_pid(demo.pid, "viewer_node")
        seen, cores = _seen(screen, url, seconds, lambda: cpu_s(pid))
    yield from _judged("real nodes", seen, seconds)
    yield Figure("real nodes: viewer_node", cores, "cores", "<= 0.35")


def _judged(what: str, seen: dict[str, Any], seconds: float) -> Iterator[Figure]:
    ages, clicks, refused = seen["ages"], seen["clicks"], sum(seen["refused"].values())
    yield Figure(f"{what}: pictures in Chromium", len(ages) / seconds, "Hz")
    yield Figure(f"{what}: stamp to screen, median", float(np.median(ages)), "ms")
    yield Figure(f"{what}: stamp to screen, 95 %", percentile(ages, 95), "ms", "<= 120")
    yield Figure(f"{what}: clicks, refused of them", refused, f"of {len(clicks) + refused}")
    yield Figure(f"{what}: click to answer, median", float(np.median(clicks)), "ms")
    yield Figure(f"{what}: click to answer, 95 %", percentile(clicks, 95), "ms", "<= 150")


@contextmanager
def _shown_page(url: str) -> Iterator[Page]:
    """Show the page in Chromium; yield it when the video runs."""
    with chromium() as page:
        page.goto(url)
        page.locator(".stage canvas").wait_for()
        page.wait_for_timeout(_SETTLE_S * 1000)
        yield page


def _seen(
    page: Page, url: str, seconds: float, used: Callable[[], float]
) -> tuple[dict[str, Any], float]:
    """Return what Chromium measured beside two more viewers, and the server's cores."""
    jobs = [Job(url, seconds) for _ in range(_BESIDE)]
    beside = threading.Thread(target=in_processes, args=(watch, jobs, _BESIDE))
    beside.start()
    page.wait_for_timeout(_SETTLE_S * 1000)
    begun_s, used_s = time.monotonic(), used()
    seen = page.evaluate(_MEASURE, [seconds, 200])
    cores = (used() - used_s) / (time.monotonic() - begun_s)
    beside.join()
    return seen, cores


def _flown(
    flight: Path, folder: Path
) -> AbstractContextManager[tuple[str, subprocess.Popen[bytes]]]:
    """Return the demo of a flight, its aircraft speaking on a serial port."""
    files = ["--params", flight / "params.yaml", "--map", flight / "map.geojson"]
    return shown_demo(folder, "--serial", "--bag", flight / "flight.mcap", *files)


_EDITS, _EVERY_S, _LIMIT_S = 30, 0.5, 60.0
_GREY = cv2.imencode(".jpg", np.full((512, 640), 99, np.uint8))[1].tobytes()
_COVARIANCE = (0.1, 0, 0, 0, 0.1, 0, 0, 0, 0.1)


def target_figures(targets: int, lookers: int) -> Iterator[Figure]:
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
    yield Figure(f"{what}: edit to answer, 95 %", percentile(answered_ms, 95), "ms")
    yield Figure(f"{what}: edit to last looker, 95 %", percentile(seen_ms, 95), "ms", "<= 150")
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
    parser = argparse.ArgumentParser(prog="python -m dev.page_load", description=__doc__)
    parser.add_argument("what", nargs="?", choices=_MEASURES, default="sockets")
    parser.add_argument("--flight", type=Path, metavar="DIR", help="a simulated flight")
    parser.add_argument("--seconds", type=float, default=20.0, help="of watching or flooding")
    parser.add_argument("--targets", type=int, default=MOST_TARGETS, help="in the file")
    parser.add_argument("--lookers", type=int, default=10, help="pages beside the operator's")
    args = parser.parse_args(argv)
    args.flight = args.flight or find_resource("bags/sample")
    if args.flight is None:
        parser.error("no sample flight is installed: give a folder")
    sys.stdout.write(f"{args.flight}, {os.cpu_count()} CPUs\n")
    print_figures(_MEASURES[args.what](args))
    return 0


_MEASURES: dict[str, Callable[[argparse.Namespace], Iterator[Figure]]] = {
    "sockets": lambda args: socket_figures(args.flight, args.seconds),
    "browser": lambda args: browser_figures(args.flight, args.seconds),
    "targets": lambda args: target_figures(args.targets, args.lookers),
    "floods": lambda args: flood_figures(args.seconds),
}


if __name__ == "__main__":
    sys.exit(main())
