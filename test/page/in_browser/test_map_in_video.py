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
"""The map that the page draws on a picture, against the message that it came by."""

from __future__ import annotations

import subprocess
import sys
import zlib
from itertools import pairwise

import cv2
import numpy as np
import pytest
from page_backend import CODE_BITS, CODE_PX, HEIGHT, LAYERS, code_of
from painted_map import decoded, painted
from served_page import ServedPage, well
from shapes_writer import encoded

RED = {"name": "red", "line": "#ff0000", "width": 3, "fill": None, "fill_opacity": 0}
GREEN = {"name": "green", "line": "#00ff00", "width": 3, "fill": "#00ff00", "fill_opacity": 0.5}
THIN = {**RED, "width": 1}  # so that its distance is that of its middle
ALONG = 0
#: Lines of the page against those of the overlay: pixels of the picture.
MOST_RMS_PX = 0.7
RADII = (30, 45, 60, 75)  # px
QUARTER_PX = 0.125  # half a step of the message


def some_shapes(seed):
    """Rings, lines and marks all over the picture."""
    rng = np.random.default_rng(seed)

    def run(count):
        start = rng.uniform([0, 0], [640, 512])
        return start + np.cumsum(rng.normal(0, 6, (count, 2)), axis=0)

    rings = [
        (int(rng.integers(2)), int(k % 3 == 1), run(int(rng.integers(3, 30)))) for k in range(9)
    ]
    lines = [(int(rng.integers(2)), 1 + k % 4, run(int(rng.integers(2, 300)))) for k in range(40)]
    marks = [(1, rng.uniform([0, 0], [640, 512])) for _ in range(12)]
    return rings, lines, marks


def test_the_page_reads_what_was_written(screen):
    rings, lines, marks = some_shapes(1)
    head = {"layers": [RED, GREEN], "labels": [["שלום <b>", 3.5, 4.25, 1, ALONG, 0, 0, True]]}
    read = decoded(screen, encoded(head, rings, lines, marks))
    assert read["labels"] == head["labels"]
    assert read["layers"] == head["layers"]
    for name, runs in (("rings", rings), ("lines", lines), ("marks", marks)):
        assert read[name]["layers"] == [run[0] for run in runs]
        points = np.vstack([np.reshape(run[-1], (-1, 2)) for run in runs])
        starts = np.cumsum([0, *(np.size(run[-1]) // 2 for run in runs)])
        assert read[name]["starts"] == starts.tolist()
        assert np.abs(np.reshape(read[name]["points"], (-1, 2)) - points).max() <= QUARTER_PX
    assert read["rings"]["values"] == [run[1] for run in rings]
    assert read["lines"]["values"] == [run[1] for run in lines]


@pytest.mark.parametrize("wrong", ["cut off", "another version", "too many"])
def test_damaged_shapes_are_refused(screen, wrong):
    whole = zlib.decompress(
        encoded({"v": 2} if wrong == "another version" else {}, *some_shapes(2))
    )
    damaged = {"cut off": whole[:-3], "another version": whole}.get(
        wrong, whole[:4] + whole[4:].split(b"}")[0] + b"}" + b"\xff\xff\xff\xff\x0f"
    )
    with pytest.raises(Exception, match="RangeError: shapes"):
        decoded(screen, zlib.compress(damaged))


def from_lines(pixels, lines, step_px=0.05):
    """Return how far places (N, 2) are from the nearest point of lines."""
    dense = []
    for line in lines:
        for start, end in pairwise(line):
            count = max(int(np.hypot(*(end - start)) / step_px), 2)
            dense.append(np.linspace(start, end, count))
    tree = cv2.flann_Index(np.vstack(dense).astype(np.float32), {"algorithm": 1, "trees": 1})
    _, squares = tree.knnSearch(pixels.astype(np.float32), 1, params={"checks": 256})
    return np.sqrt(squares.ravel())


@pytest.mark.parametrize(("scale", "ratio"), [(0.6, 2.0), (1.25, 1.0), (2.0, 1.0)])
def test_lines_are_where_the_message_has_them(screen, scale, ratio):
    turn = np.linspace(0, 2 * np.pi, 90)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    centres = np.array([[90.3, 90.8], [480.6, 110.4], [120.9, 380.2], [500.1, 390.5]])
    lines = [centre + radius * circle for centre, radius in zip(centres, RADII, strict=True)]
    image = painted(
        screen, encoded({"layers": [THIN]}, (), [(0, 4, line) for line in lines]), scale, ratio
    )
    rows, columns = np.nonzero(image[:, :, 2] > 127)
    inked = (np.column_stack([columns, rows]) + 0.5) / (scale * ratio) - 0.5
    assert np.sqrt(np.mean(from_lines(inked, lines) ** 2)) <= MOST_RMS_PX
    assert from_lines(np.vstack(lines), [inked[[k, k]] for k in range(len(inked))]).max() <= 1.0
    # Half a pixel aside would be within the limit above: a whole circle shows it.
    out = inked - centres[nearest := np.argmin(np.abs(reach(inked, centres) - RADII), axis=1)]
    away = np.hypot(*out.T)
    aside = 2 * np.mean((away - np.take(RADII, nearest))[:, None] * out / away[:, None], axis=0)
    assert np.abs(aside).max() < 0.1


def reach(pixels, centres):
    """Return the distance of each pixel (N, 2) from each centre (C, 2)."""
    return np.hypot(*np.moveaxis(pixels[:, None] - centres, 2, 0))


def test_upper_layers_are_over_lower_ones_and_each_can_be_off(screen):
    across = [(0, 4, [[100, 200], [300, 200]]), (1, 4, [[200, 100], [200, 300]])]
    shapes = encoded({"layers": [RED, GREEN]}, (), across)
    image = painted(screen, shapes, 2.0)
    red, green = image[401, 401][2:0:-1]
    assert (red < 50, green > 200) == (True, True), "the green line is the upper one"
    image = painted(screen, shapes, 2.0, layersOff=["green"])
    assert image[401, 401][2] > 200
    assert not (image[:, :, 1] > 100).any()
    faint = painted(screen, shapes, 2.0, opacity=0.25)
    assert 30 < faint[401, 401][1] < 100


def test_areas_cover_once_and_have_holes(screen):
    def square(left, top, side, turned=False):
        ring = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float) * side + [left, top]
        return ring[::-1] if turned else ring

    rings = [
        *((0, 0, square(50, 50, 60)), (0, 0, square(80, 80, 60, turned=True))),
        *((0, 0, square(300, 50, 100)), (0, 1, square(330, 80, 30))),
    ]
    image = painted(screen, encoded({"layers": [GREEN]}, rings), 1.0)[:, :, 1]
    half = pytest.approx(128, abs=2)
    assert image[60, 60] == half
    assert image[100, 100] == half, "two overlap here"
    assert image[60, 310] == half
    assert image[95, 345] == 0, "a hole"


def test_opacity_of_a_line_is_in_quarters(screen):
    lines = [(0, step, [[50, 100 * step], [300, 100 * step]]) for step in (1, 2, 3, 4)]
    image = painted(screen, encoded({"layers": [RED]}, (), lines), 2.0)
    light = [int(image[200 * step + 1, 301][2]) for step in (1, 2, 3, 4)]
    assert light == pytest.approx([64, 128, 191, 255], abs=12)


def labels_of(image):
    """Return the boxes of what is written in white."""
    ink = cv2.dilate((image.min(axis=2) > 128).astype(np.uint8), np.ones((5, 13), np.uint8))
    return cv2.connectedComponentsWithStats(ink)[2][1:]


def test_labels_do_not_meet_and_all_are_written_that_have_room(screen):
    labels = [[f"name {k}", 320 + k, 256, 0, ALONG, 0, 0, False] for k in range(30)]
    few = labels_of(painted(screen, encoded({"layers": [RED], "labels": labels}), 1.0))
    assert len(few) == 1
    apart = [
        [f"name {k}", 60 + 110 * (k % 5), 40 + 60 * (k // 5), 0, ALONG, 0, 0, False]
        for k in range(30)
    ]
    shapes = encoded({"layers": [RED], "labels": apart})
    assert len(labels_of(painted(screen, shapes, 2.0))) == 30
    assert not len(labels_of(painted(screen, shapes, 2.0, labelsOff=["red"])))


def test_letters_of_all_scripts_are_written(screen):
    texts = ["שלום", "مرحبا", "消防栓", "Straße", "🚒 3", "<b>x</b>"]
    labels = [[text, 100, 60 + 70 * k, 0, ALONG, 0, 0, False] for k, text in enumerate(texts)]
    image = painted(screen, encoded({"layers": [RED], "labels": labels}), 2.0)
    for k in range(len(texts)):
        assert image[2 * (20 + 70 * k) : 2 * (60 + 70 * k)].max() > 200


def watched(screen, count):
    """Look at frames on the screen: the picture has its stamp's code in it, the map its stamp."""
    places = [[(bit + 0.5) * CODE_PX, HEIGHT - CODE_PX / 2] for bit in range(CODE_BITS)]
    seen = screen.page.evaluate(_SEEN, [places, count])
    for stamp, code, words in seen:
        assert code == code_of(int(stamp))
        assert words == stamp
    return {stamp for stamp, _, _ in seen}


def test_the_map_on_the_screen_is_of_the_frame_on_the_screen(serve, tablet, monkeypatch):
    well(monkeypatch)
    screen = tablet(serve().url)
    screen.await_picture()
    assert len(watched(screen, 40)) == 40


@pytest.mark.slow
@pytest.mark.long
def test_no_map_is_of_another_frame_in_ten_thousand(serve, tablet, monkeypatch):
    """At 30 Hz beside a busy program; every 250 frames the connection is lost."""
    well(monkeypatch)
    monkeypatch.setattr(ServedPage, "hz", 30.0)
    screen = tablet(serve().url)
    screen.await_picture()
    stamps = set()
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as beside:
        try:
            for _ in range(40):
                stamps |= watched(screen, 250)
                screen.page.evaluate(_LOSE)
        finally:
            beside.kill()
    assert len(stamps) == 10_000


_LOSE = """async () => {
  const { stageOf } = await import("/static/js/video/stages.js");
  stageOf("").feed.socket.restart();
}"""
_SEEN = """async ([places, count]) => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { painter, wordsOfMap } = stageOf("");
  const seen = [];
  const paint = painter.paint.bind(painter);
  await new Promise((done) => {
    painter.paint = (frame, ms) => {
      paint(frame, ms);
      const bits = places.map(([u, v]) => (painter.picture.greyAt(frame, u, v) > 128 ? 1 : 0));
      const code = bits.reduce((sum, bit, k) => sum + bit * 2 ** k, 0);
      seen.push([frame.stampNs, code, wordsOfMap.status.lastChild.textContent]);
      if (seen.length === count) done();
    };
  });
  return seen.slice(0, count);
}"""


def test_a_layer_that_is_off_is_remembered(serve, tablet, monkeypatch):
    well(monkeypatch)
    screen = tablet(serve().url)
    screen.await_picture()
    screen.tap_on("#look-button")
    name = LAYERS[0]["name"]
    screen.tap_on(f"#look .switch[aria-label={name}]")
    screen.tap_on("#look .switch[aria-label='Labels of hydrants']")
    off = "#look .layer-row .switch[aria-checked=false]"
    screen.shows(off, 2)
    screen.reload()
    screen.tap_on("#look-button")
    screen.shows(off, 2)
    found = screen.page.locator(off).all()
    assert [one.get_attribute("aria-label") for one in found] == [name, "Labels of hydrants"]


def test_a_map_that_the_operator_has_hidden_says_so(serve, tablet, monkeypatch):
    """It looked as if there were none, also days later: this is remembered."""
    well(monkeypatch)
    screen = tablet(serve().url)
    screen.await_picture()
    words = screen.page.locator(".status-line", has_text="layers are off")
    screen.set(layersOff=[LAYERS[0]["name"]])
    assert words.count() == 0
    screen.set(layersOff=[layer["name"] for layer in LAYERS])
    words.wait_for()
    screen.set(layersOff=[])
    words.wait_for(state="detached")
    screen.tap_on("#look-button")
    screen.one("#look [aria-label=Map]").press("Home")
    words.wait_for()


def test_a_label_stays_where_it_is_while_its_feature_moves(screen):
    """Another label comes near, and goes: only then may the first move."""
    boxes = screen.page.evaluate(_MOVED)
    offsets = [
        [round(at - place) for at, place in zip(box[:2], frame, strict=True)]
        for box, frame in boxes
    ]
    assert len({tuple(offset) for offset in offsets}) == 1


_MOVED = """async () => {
  const { BESIDE, LabelPlaces } = await import("/static/js/video/label_places.js");
  const places = new LabelPlaces();
  const seen = [];
  for (let k = 0; k < 60; k += 1) {
    const at = [300 + 2 * k, 200 + k];
    places.begin([0, 0, 640, 512], [], k > 20 ? [[at[0] + 40, at[1]]] : []);
    seen.push([places.place("one", at, [60, 20], BESIDE, [7, 7]), at]);
    places.place("two", [at[0] + 30 - k, at[1] + 40], [60, 20], BESIDE, [7, 7]);
  }
  return seen;
}"""


@pytest.mark.parametrize("size", [(1280, 720), (480, 640)])
def test_a_picture_of_another_form_leaves_no_strip_beside_it(screen, size):
    """As the camera's other lens; the screen is zoomed in at a corner."""
    assert screen.page.evaluate(_CORNER_AFTER, [*size]) == [0, 0]


_CORNER_AFTER = """async (size) => {
  const { PictureView } = await import("/static/js/video/view.js");
  const view = new PictureView();
  view.setBox(1000, 800);
  view.zoomAt(2, 0, 0);
  view.setPicture(...size);
  const { left, top } = view.rectangle;
  return [left, top];
}"""


def test_a_slow_screen_draws_coarser_and_a_quick_one_all_again(screen):
    levels = screen.page.evaluate(_DETAIL)
    assert levels == {"few": 0, "quick": 0, "busy": 0, "slow": [1, 2, 4], "again": 0}


_DETAIL = """async () => {
  const { Detail } = await import("/static/js/video/detail.js");
  const after = (detail, frames, ms, vertices) => {
    for (let k = 0; k < frames; k += 1) detail.took(k % 10 ? ms / 2 : ms, vertices);
    return detail.skipPx;
  };
  const detail = new Detail();
  const few = after(detail, 400, 9, 900);
  const quick = after(detail, 400, 3.9, 10000);
  for (let k = 0; k < 400; k += 1) detail.took(k % 5 ? 1.5 : 30, 10000); // others are at work
  const busy = detail.skipPx;
  const slow = [40, 40, 40].map((frames) => after(detail, frames, 4.1, 10000));
  return { few, quick, busy, slow, again: after(detail, 400, 1, 10000) };
}"""


def test_coarser_lines_are_near_the_fine_ones(screen):
    turn = np.linspace(0, 40, 4000)
    spiral = np.array([320, 256]) + (5 * turn * np.array([np.cos(turn), np.sin(turn)])).T
    shapes = encoded({"layers": [THIN]}, (), [(0, 4, spiral)])
    image = painted(screen, shapes, 2.0, skip_px=4)
    rows, columns = np.nonzero(image[:, :, 2] > 127)
    inked = (np.column_stack([columns, rows]) + 0.5) / 2 - 0.5
    assert from_lines(inked, [spiral]).max() < 2.0
