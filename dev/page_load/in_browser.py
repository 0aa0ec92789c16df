"""Measure the page with Chromium as one of three viewers: ``python -m dev.page_load.in_browser``.

First the server alone at 30 pictures a second; then the real nodes (``tirgeo demo --serial
--page``) at the flight's own rate, in the time of this computer.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

from dev.judging import Figure, in_processes, line
from dev.page_load.served import ServedPage, draw_pictures
from dev.page_load.viewer import Job, watch
from dev.shown_demo import node_pid, shown_demo
from tirgeo_ros.tools.graph import find_resource

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


def figures(flight: Path, seconds: float) -> Iterator[Figure]:
    """Yield the figures of the server alone, then of the real nodes."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        draw_pictures(flight, work, work / "pictures")
        with ServedPage(work / "pictures", work) as page, _watched(page.url) as screen:
            seen, cores = _seen(screen, page.url, seconds, page.cpu_s)
        yield from _judged("server at 30 Hz", seen, seconds)
        yield Figure("server at 30 Hz: server", cores, "cores", "<= 0.35")
    with (
        tempfile.TemporaryDirectory() as name,
        _flown(flight, Path(name)) as (url, demo),
        _watched(url) as screen,
    ):
        pid = node_pid(demo.pid, "viewer_node")
        seen, cores = _seen(screen, url, seconds, lambda: _cpu_s(pid))
    yield from _judged("real nodes", seen, seconds)
    yield Figure("real nodes: viewer_node", cores, "cores", "<= 0.35")


def _judged(what: str, seen: dict[str, Any], seconds: float) -> Iterator[Figure]:
    ages, clicks, refused = seen["ages"], seen["clicks"], sum(seen["refused"].values())
    yield Figure(f"{what}: pictures in Chromium", len(ages) / seconds, "Hz")
    yield Figure(f"{what}: stamp to screen, median", float(np.median(ages)), "ms")
    yield Figure(f"{what}: stamp to screen, 95 %", float(np.percentile(ages, 95)), "ms", "<= 120")
    yield Figure(f"{what}: clicks, refused of them", refused, f"of {len(clicks) + refused}")
    yield Figure(f"{what}: click to answer, median", float(np.median(clicks)), "ms")
    yield Figure(
        f"{what}: click to answer, 95 %", float(np.percentile(clicks, 95)), "ms", "<= 150"
    )


@contextmanager
def chromium() -> Iterator[Page]:
    """Run Chromium; yield an empty page."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as driver:
        options = ["--no-sandbox", "--disable-dev-shm-usage", "--mute-audio"]
        browser = driver.chromium.launch(executable_path=path, args=options)
        yield browser.new_page(viewport={"width": 1280, "height": 800})
        browser.close()


@contextmanager
def _watched(url: str) -> Iterator[Page]:
    """Show the page in Chromium; yield it when the video runs."""
    with chromium() as page:
        page.goto(url)
        page.locator(".stage canvas").wait_for()
        page.wait_for_timeout(_SETTLE_S * 1000)
        yield page


def _seen(
    page: Page, url: str, seconds: float, cpu_s: Callable[[], float]
) -> tuple[dict[str, Any], float]:
    """Return what Chromium measured beside two more viewers, and the server's cores."""
    jobs = [Job(url, seconds) for _ in range(_BESIDE)]
    beside = threading.Thread(target=in_processes, args=(watch, jobs, _BESIDE))
    beside.start()
    page.wait_for_timeout(_SETTLE_S * 1000)
    begun_s, used_s = time.monotonic(), cpu_s()
    seen = page.evaluate(_MEASURE, [seconds, 200])
    cores = (cpu_s() - used_s) / (time.monotonic() - begun_s)
    beside.join()
    return seen, cores


def _flown(
    flight: Path, folder: Path
) -> AbstractContextManager[tuple[str, subprocess.Popen[bytes]]]:
    """Return the demo of a flight, its aircraft speaking on a serial port."""
    files = ["--params", flight / "params.yaml", "--map", flight / "map.geojson"]
    return shown_demo(folder, "--serial", "--bag", flight / "flight.mcap", *files)


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(int(ticks) for ticks in fields[11:13]) / os.sysconf("SC_CLK_TCK")


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m dev.page_load.in_browser", description=__doc__
    )
    parser.add_argument("folder", type=Path, nargs="?", metavar="DIR", help="a simulated flight")
    parser.add_argument("--seconds", type=float, default=20.0, help="of watching")
    args = parser.parse_args(argv)
    flight = args.folder or find_resource("bags/sample")
    if flight is None:
        parser.error("no sample flight is installed: give a folder")
    sys.stdout.write(f"{flight}, {os.cpu_count()} CPUs\n")
    for figure in figures(flight, args.seconds):
        sys.stdout.write(line(figure) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
