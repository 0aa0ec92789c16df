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
"""Measure the page's map in Chromium: ``python -m dev.page_load.panning``.

A town of 100,000 buildings and 500 targets, on the large map of a desk. Of each pan and zoom, the
longest time that a script kept the page from answering, by the browser's own trace.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from playwright.sync_api import Page

from dev.bench.overlay import PLANE, town
from dev.graphs import chromium
from dev.judging import Figure, percentile, print_figures
from dev.page_load.served import MAP_NAME, ServedPage
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.io.maps.map_process import page_map
from tirgeo_ros.io.targets.store import TargetStore

_TARGETS, _TOWN_VERTICES, _SEED, _ROUNDS = 500, 670_000, 3, 3
_COVARIANCE = (0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.1)
_ROUND = ("pan", "in", "pan", "in", "pan", "out", "pan", "out", "out", "pan", "out", "in", "in")
_TRACED = ["devtools.timeline", "disabled-by-default-devtools.timeline"]
_SCRIPTS = ("FunctionCall", "TimerFire", "FireAnimationFrame", "EventDispatch", "RunMicrotasks")
_LARGE_MAP = """async () => {
  const { store } = await import("/static/js/store.js");
  store.set({ large: "map" });
}"""
_ZOOM = "(k) => document.querySelectorAll('.map-tools button')[k].click()"
_SETTLE_MS, _BETWEEN_MS = 5000, 900


def figures() -> Iterator[Figure]:
    """Yield the longest scripts of pans and of zooms."""
    with tempfile.TemporaryDirectory() as name, chromium() as screen:
        work = Path(name)
        (work / "pictures").mkdir()
        grey = cv2.imencode(".jpg", np.full((512, 640), 99, np.uint8))[1].tobytes()
        (work / "pictures" / "grey.jpg").write_bytes(grey)
        (work / MAP_NAME).write_bytes(page_map(town(_TOWN_VERTICES, PLANE)))
        _fill(work / "targets.gpkg")
        with ServedPage(work / "pictures", work) as page:
            screen.set_viewport_size({"width": 1920, "height": 1080})
            screen.goto(page.url)
            screen.locator("#map canvas").first.wait_for()
            screen.evaluate(_LARGE_MAP)
            screen.wait_for_timeout(_SETTLE_MS)
            longest = _traced(screen)
    for what in ("pan", "zoom"):
        values = [ms for act, ms in longest if (act == "pan") == (what == "pan")]
        yield Figure(f"{what}: longest script, 95 %", percentile(values, 95), "ms", "<= 50")


def _fill(path: Path) -> None:
    store, rng = TargetStore(path), np.random.default_rng(_SEED)
    for k, (north, east) in enumerate(rng.uniform(-600, 600, (_TARGETS, 2)).tolist()):
        place = PLANE.geodetic_from_ned(np.array([north, east, 0.0]))
        latitude, longitude = (float(np.degrees(angle)) for angle in place[:2])
        click = Located(k, latitude, longitude, 11.5, _COVARIANCE)
        store.add(click, name=f"target {k}", now_ns=time.time_ns())
    store.close()


def _traced(screen: Page) -> list[tuple[str, float]]:
    """Return each act, and the longest script in it, ms of processor time."""
    events, done = list[Any](), list[Any]()
    session = screen.context.new_cdp_session(screen)
    session.on("Tracing.dataCollected", lambda part: events.extend(part["value"]))
    session.on("Tracing.tracingComplete", lambda _: done.append(True))
    config = {"includedCategories": _TRACED, "excludedCategories": ["*"]}
    session.send("Tracing.start", {"transferMode": "ReportEvents", "traceConfig": config})
    rng = np.random.default_rng(_SEED)
    for act in _ROUND * _ROUNDS:
        screen.evaluate(f"console.timeStamp('act {act}')")
        if act == "pan":
            _pan(screen, *rng.uniform(-200, 200, 2).tolist())
        else:
            screen.evaluate(_ZOOM, 0 if act == "in" else 1)
        screen.wait_for_timeout(_BETWEEN_MS)
    screen.evaluate("console.timeStamp('act end')")
    session.send("Tracing.end")
    while not done:
        screen.wait_for_timeout(100)
    return _longest(events)


def _pan(screen: Page, right: float, down: float) -> None:
    box = screen.locator("#map").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2 - 60, box["y"] + box["height"] / 2
    screen.mouse.move(x, y)
    screen.mouse.down()
    for k in range(1, 9):
        screen.mouse.move(x + right * k / 8, y + down * k / 8)
    screen.mouse.up()


def _longest(events: Sequence[Any]) -> list[tuple[str, float]]:
    """Return the longest script of each act; scripts inside others count with them."""
    words = [(e["ts"], e["args"]["data"]["message"]) for e in events if e["name"] == "TimeStamp"]
    acts = sorted((ts, word[4:]) for ts, word in words if word.startswith("act "))
    scripts = [e for e in events if e["name"] in _SCRIPTS and "tdur" in e]
    result = []
    for (begin, act), (end, _) in pairwise(acts):
        own = [e["tdur"] for e in scripts if begin <= e["ts"] < end]
        result.append((act, max(own, default=0) / 1e3))
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    argparse.ArgumentParser(prog="python -m dev.page_load.panning").parse_args(argv)
    print_figures(figures())
    return 0


if __name__ == "__main__":
    sys.exit(main())
