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
"""Measure the page in Chromium: ``python -m dev.page_load.in_browser``.

The server alone at 30 Hz beside two more viewers, the same over a link of 1 Mbit/s and 200 ms, and
``tirgeo demo --page`` with the real nodes. Of each picture, the time from its stamp to the first
moment that it can be on the screen; of each press, the time to its answer.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page

from dev.graphs import chromium, node_pid, shown_demo
from dev.judging import Figure, in_processes, percentile, print_figures
from dev.page_load.served import Job, ServedPage, draw_pictures, watch
from dev.page_load.thin_link import ThinLink
from tirgeo_ros.tools.graph import find_resource

_SETTLE_S, _BESIDE, _PRESS_MS = 6.0, 2, 400
_LINK_BITS, _LINK_S = 1e6, 0.1  # each way
_MEASURE = """async ([seconds, every]) => {
  const { Stage } = await import("/static/js/video/stage.js");
  const { stageOf } = await import("/static/js/video/stages.js");
  const { ask } = await import("/static/js/link/state_link.js");
  const now = () => performance.timeOrigin + performance.now();
  const seen = { ages: [], clicks: [], refused: 0, widths: [] };
  const show = Stage.prototype.show;
  Stage.prototype.show = function (frame) {
    show.call(this, frame);
    const stamp = Number(BigInt(frame.stampNs) / 1000n) / 1000;
    seen.widths.push(frame.bitmap?.width ?? 0);
    requestAnimationFrame(() => seen.ages.push(now() - stamp));
  };
  const end = now() + seconds * 1000;
  while (now() < end) {
    await new Promise((go) => setTimeout(go, every));
    const [begun, stamp] = [now(), stageOf("").frame.stampNs];
    const place = { aircraft: "", stamp_ns: stamp, u: 320, v: 300, kind: "person", refine: null };
    const answer = await ask("click", place);
    if (answer.ok) seen.clicks.push(now() - begun);
    else seen.refused += 1;
  }
  Stage.prototype.show = show;
  return seen;
}"""


def figures(flight: Path, seconds: float) -> Iterator[Figure]:
    """Yield the figures of the server alone, over a thin link, and with the real nodes."""
    with tempfile.TemporaryDirectory() as name, chromium() as screen:
        pictures = draw_pictures(flight, Path(name))
        with ServedPage(pictures, Path(name)) as page:
            with _beside(page.url, seconds):
                seen, cores = _seen(screen, page.url, seconds, page.cpu_s)
            yield from _judged("server at 30 Hz", seen, seconds, "<= 65", "<= 72")
            yield Figure("server at 30 Hz: server", cores, "cores")
            port = int(page.url.rpartition(":")[2])
            with ThinLink(port, _LINK_BITS, _LINK_S) as near:
                seen, _ = _seen(screen, f"http://127.0.0.1:{near}", seconds, page.cpu_s)
        yield from _judged("1 Mbit/s, 200 ms", seen, seconds, "", "<= 700")
        yield Figure("1 Mbit/s, 200 ms: least width", float(min(seen["widths"])), "px", ">= 320")
    files = "--params", flight / "params.yaml", "--map", flight / "map.geojson"
    with (
        tempfile.TemporaryDirectory() as name,
        shown_demo(Path(name), "--serial", "--bag", flight / "flight.mcap", *files) as (url, demo),
        chromium() as screen,
    ):
        pid = node_pid(demo.pid, "viewer_node")
        overlay = node_pid(demo.pid, "overlay_node")
        used_s = _cpu_s(overlay)
        seen, cores = _seen(screen, url, seconds, lambda: _cpu_s(pid))
        painting_s = (_cpu_s(overlay) - used_s) / (seconds + 2 * _SETTLE_S)
    yield from _judged("real nodes", seen, seconds, "<= 100", "<= 100")
    yield Figure("real nodes: viewer_node", cores, "cores", "<= 0.20")
    yield Figure("real nodes: overlay_node", painting_s, "cores")


def _judged(
    what: str, seen: dict[str, Any], seconds: float, age: str, press: str
) -> Iterator[Figure]:
    yield Figure(f"{what}: pictures in Chromium", len(seen["ages"]) / seconds, "Hz")
    yield Figure(f"{what}: stamp to screen, median", float(np.median(seen["ages"])), "ms")
    yield Figure(f"{what}: stamp to screen, 95 %", percentile(seen["ages"], 95), "ms", age)
    total = len(seen["clicks"]) + seen["refused"]
    yield Figure(f"{what}: presses refused", seen["refused"], f"of {total}")
    yield Figure(f"{what}: press to answer, 95 %", percentile(seen["clicks"], 95), "ms", press)


@contextmanager
def _beside(url: str, seconds: float) -> Iterator[None]:
    """Let two more viewers watch."""
    jobs = [Job(url, seconds + _SETTLE_S) for _ in range(_BESIDE)]
    watching = threading.Thread(target=in_processes, args=(watch, jobs, _BESIDE))
    watching.start()
    yield
    watching.join()


def _seen(screen: Page, url: str, seconds: float, cpu_s: Any) -> tuple[dict[str, Any], float]:
    """Return what Chromium measured, and the cores of a process of this CPU time."""
    screen.goto(url)
    screen.locator(".stage canvas").first.wait_for()
    screen.wait_for_timeout(_SETTLE_S * 1000)
    used_s = cpu_s()
    seen = screen.evaluate(_MEASURE, [seconds, _PRESS_MS])
    return seen, (cpu_s() - used_s) / seconds


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(int(ticks) for ticks in fields[11:13]) / os.sysconf("SC_CLK_TCK")


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m dev.page_load.in_browser")
    parser.add_argument("folder", type=Path, nargs="?", metavar="DIR", help="a simulated flight")
    parser.add_argument("--seconds", type=float, default=20.0, help="of watching")
    args = parser.parse_args(argv)
    flight = args.folder or find_resource("bags/sample")
    if flight is None:
        parser.error("no sample flight is installed: give a folder")
    print_figures(figures(flight, args.seconds))
    return 0


if __name__ == "__main__":
    sys.exit(main())
