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
"""Measure the page's drawing in Chromium without a graphics card: ``dev.page_load.drawing``.

Ten thousand vertices with labels and marks, on the canvas of a tablet. Of each frame, the script's
time to decode and to draw it, as the page itself measures it, and the time until it is painted.
"""

from __future__ import annotations

import argparse
import base64
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dev.graphs import chromium
from dev.judging import Figure, percentile, print_figures
from dev.page_load.served import ServedPage, draw_pictures
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io.messages.shapes_codec import Strokes, WrittenShapes
from tirgeo_ros.tools.graph import find_resource

_SIZE = 640, 512
_VERTICES, _IN_A_LINE, _LABELS, _MARKS, _SEED = 10_000, 25, 40, 20, 3
_COLOURS = ("#ffcc00", "#00ff88", "#ff4040", "#40a0ff")
_STOP = """async () => {
  const { store } = await import("/static/js/store.js");
  store.set({ still: true });
}"""
_MEASURE = """async ([coded, frames]) => {
  const { inflated, shapesOf } = await import("/static/js/video/shapes.js");
  const { MapPainter } = await import("/static/js/video/map_painter.js");
  const { PictureView } = await import("/static/js/video/view.js");
  const zipped = Uint8Array.from(atob(coded), (letter) => letter.charCodeAt(0));
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: 780, height: 624 });
  const context = canvas.getContext("2d", { alpha: false });
  const view = new PictureView();
  view.setBox(780, 624);
  const sheet = { context, view, ratio: 1, taken: [], skipPx: 0, ink: 1.2 };
  const wishes = { opacity: 1, layersOff: [], labelsOff: [] };
  const painter = new MapPainter();
  const seen = { script: [], painted: [] };
  for (let k = 0; k < frames; k += 1) {
    const bytes = await inflated(zipped);
    await new Promise((next) => setTimeout(next, 30));
    const begun = performance.now();
    painter.paint(sheet, shapesOf(bytes), wishes);
    seen.script.push(performance.now() - begun);
    context.getImageData(0, 0, 1, 1); // waits for it
    seen.painted.push(performance.now() - begun);
  }
  return seen;
}"""


def figures(flight: Path, frames: int) -> Iterator[Figure]:
    """Yield the figures of a full map, and of one without lines."""
    with (
        tempfile.TemporaryDirectory() as name,
        chromium() as screen,
        ServedPage(draw_pictures(flight, Path(name)), Path(name)) as page,
    ):
        screen.goto(page.url)
        screen.locator(".stage canvas").first.wait_for()
        screen.evaluate(_STOP)
        for vertices, wanted in ((_VERTICES, "<= 4"), (0, "")):
            data = made_shapes(vertices).to_bytes()
            seen = screen.evaluate(_MEASURE, [base64.b64encode(data).decode(), frames])
            yield from _judged(f"{vertices} vertices", data, seen, wanted)


def _judged(what: str, data: bytes, seen: dict[str, Any], wanted: str) -> Iterator[Figure]:
    yield Figure(f"{what}: shapes", len(data) / 1e3, "kB")
    yield Figure(f"{what}: script, median", float(np.median(seen["script"])), "ms")
    yield Figure(f"{what}: script, 95 %", percentile(seen["script"], 95), "ms", wanted)
    yield Figure(f"{what}: painted, median", float(np.median(seen["painted"])), "ms")


def made_shapes(vertices: int) -> WrittenShapes:
    """Return winding lines of four layers all over the picture, every tenth one an area."""
    rng = np.random.default_rng(_SEED)
    count = vertices // _IN_A_LINE
    steps = rng.normal(0, 4, (count, _IN_A_LINE, 2))
    steps[:, 0] = rng.uniform((0, 0), _SIZE, (count, 2))
    runs = np.cumsum(steps, axis=1)
    marks = rng.uniform((0, 0), _SIZE, (_MARKS, 1, 2))
    places = rng.uniform((0, 0), _SIZE, (_LABELS, 2)).round(1).tolist()
    layers: list[dict[str, Any]] = [
        {"name": f"layer {k}", "line": line, "width": 2, "fill": line, "fill_opacity": 0.3}
        for k, line in enumerate(_COLOURS)
    ]
    words: dict[str, Any] = {
        "v": 1,
        "size": _SIZE,
        "grey": True,
        "celsius": None,
        "layers": layers,
        "labels": [[f"name {k}", *at, k % 4, k % 3, 20, 10, False] for k, at in enumerate(places)],
        **{key: [] for key in ("ellipses", "targets", "notices", "status")},
        "bar": [12, 112, 480, 10],
        "heading_deg": 40,
    }
    return WrittenShapes(words, _strokes(runs[::10], 0), _strokes(runs, 4), _strokes(marks, 0))


def _strokes(runs: Array, extra: int) -> Strokes:
    """Return runs (N, V, 2), px, of the layers in turn."""
    count, each = runs.shape[:2]
    points = np.rint(4 * runs.reshape(-1, 2)).astype(np.int64).T
    layer = np.arange(count) % len(_COLOURS)
    return Strokes(points, np.arange(count + 1) * each, layer, np.full(count, extra))


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m dev.page_load.drawing")
    parser.add_argument("--frames", type=int, default=200)
    args = parser.parse_args(argv)
    flight = find_resource("bags/sample")
    if flight is None:
        parser.error("no sample flight is installed")
    print_figures(figures(flight, args.frames))
    return 0


if __name__ == "__main__":
    sys.exit(main())
