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
"""What is drawn on a picture, as bytes for the browser: nothing is lost, and it can be coarser."""

from __future__ import annotations

import contextlib
import dataclasses
import zlib

import numpy as np
import pytest
from hypothesis import given, strategies as st
from overlays import PLANE, START, geo, pose_at
from scenes import camera_pose

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.map.vector_map import LayerStyle, MapLayer
from tirgeo_ros.core.overlay.clicks import Marker
from tirgeo_ros.core.overlay.frame_shapes import DrawingVerdict, FrameShaper, Unpainted
from tirgeo_ros.core.overlay.written_text import LONGEST
from tirgeo_ros.core.types.errors import MessageError, cut
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.io.messages.cdr import Cdr
from tirgeo_ros.io.messages.shapes_codec import (
    WrittenShapes,
    coarser,
    read_shapes,
    written_shapes,
)

GREY = np.zeros((XT2.height, XT2.width), np.uint8)
#: Root mean square of a rounding to quarters of a pixel, in both directions.
ROUNDED_PX = 0.25 / np.sqrt(6)
FILLED = LayerStyle((0, 80, 255), 3, (10, 20, 30), 0.4)


def town(count, size=1.0, corners=4):
    """Outlines anyhow on the ground ahead, each with a name."""
    rng = np.random.default_rng(2)
    turn = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    ring_n = size * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(corners)])
    middles = np.column_stack([rng.uniform(25, 60, count), rng.uniform(-20, 20, count)])
    return [geo(ring_n + np.append(middle, 0), f"house {k}") for k, middle in enumerate(middles)]


def seen(layers, pose=None, markers=(), **changes):
    shaper = FrameShaper(OverlayConfig(ground_height_m=25.0), layers, None)
    shaper.set_plane(PLANE)
    shaper.set_camera(XT2)
    verdict = DrawingVerdict(Severity.STOP, "NO GO: <b>gimbal</b>")
    own = START, GREY, XT2, pose or pose_at(START), None, "", 0.0, tuple(markers), verdict
    picture = Unpainted(*own, status=None, age_s=0.01, rate_hz=30.0, replaced=0)
    return shaper.shapes(dataclasses.replace(picture, **changes))


def written(*args, picture=GREY, celsius=None, **options):
    return written_shapes(seen(*args, **options), picture, celsius)


def test_what_is_read_is_what_was_drawn():
    layers = [
        MapLayer("areas", town(9, 4.0), FILLED),
        MapLayer("ways", [geo([[30, -5, 0], [50, 9, 0]], "Weg \u05e9\u05d1\u05d9\u05dc")]),
        MapLayer("hydrants", [geo([[35, k, 0]], f"H{k}") for k in range(-5, 5)]),
    ]
    shapes = seen(layers, markers=[Marker(np.array([40.0, 0, 0]), "1 fire", np.eye(3), "ab" * 16)])
    result = read_shapes(written_shapes(shapes, GREY, (-10.0, 90.0)).to_bytes())
    for strokes, lines in (
        (result.lines, shapes.map.marked.lines),
        (result.marks, shapes.map.marks),
    ):
        order = np.argsort(shapes.map.map.layer[lines.owner], kind="stable")
        ordered = lines.select(order)
        assert strokes.layer.tolist() == shapes.map.map.layer[ordered.owner].tolist()
        off = strokes.points / 4 - ordered.points[:2]
        assert np.sqrt((off**2).sum(axis=0).mean()) < 1.2 * ROUNDED_PX
        assert np.array_equal(strokes.starts, ordered.starts)
    assert len(result.rings.layer) == len(shapes.map.areas)
    assert len(result.marks.layer) == 10
    words = result.words
    assert words["size"] == [640, 512]
    assert words["celsius"] == [-10.0, 90.0]
    assert words["layers"][0] == {
        "name": "areas",
        "line": "#ff5000",
        "width": 3,
        "fill": "#1e140a",
        "fill_opacity": 0.4,
    }
    assert ["NO GO: <b>gimbal</b>", 2] in words["notices"]
    assert any(label[0] == "Weg \u05e9\u05d1\u05d9\u05dc" for label in words["labels"])
    (target,) = words["targets"]
    assert target[:2] == ["ab" * 16, "1 fire"]


def test_half_an_emoji_in_a_name_costs_that_letter_alone():
    """Of a target of another program, which cut its name in UTF-16."""
    marker = Marker(np.array([40.0, 0, 0]), "1 fire: hut \ud83d", np.eye(3), "ab" * 16)
    data = written([MapLayer("", town(3))], markers=[marker]).to_bytes()
    assert read_shapes(data).words["targets"][0][1] == "1 fire: hut ?"


def test_a_label_is_as_long_as_in_the_painted_picture():
    """A note of two pages in the labels' field would fill a thin link, and the picture."""
    house = geo([[30, -6, 0], [30, 6, 0], [42, 6, 0], [42, -6, 0]], "a long note " * 300)
    ((text, *_),) = written([MapLayer("houses", [house])]).words["labels"]
    assert text == cut("a long note " * 6, LONGEST)


def test_the_rings_of_an_area_stay_together():
    """Two houses, of which one has a court; what is left of them when they are coarser, too."""
    house = [geo([[30, -6, 0], [30, 6, 0], [42, 6, 0], [42, -6, 0]])] * 2
    court = geo([[33, -3, 0], [33, 3, 0], [39, 3, 0], [39, -3, 0]])
    parts = [dataclasses.replace(each, group=k) for each, k in ((house[0], 0), (court, 0))]
    layer = MapLayer("houses", [*parts, house[1]], FILLED)
    result = written([layer])
    assert result.rings.extra.tolist() == [0, 1, 0]
    assert read_shapes(coarser(result.to_bytes(), 1)).rings.extra.tolist() == [0, 1, 0]


def test_a_court_stays_free_where_the_picture_cuts_its_house():
    """The whole rings come before those that are cut: a house was between court and house."""
    house = geo([[26, -60, 0], [26, 6, 0], [42, 6, 0], [42, -60, 0]])
    court = geo([[30, -4, 0], [30, 4, 0], [38, 4, 0], [38, -4, 0]])
    parts = [dataclasses.replace(each, group=0) for each in (house, court)]
    other = geo([[30, 8, 0], [30, 9, 0], [33, 9, 0], [33, 8, 0]])
    result = written([MapLayer("houses", [*parts, other], FILLED)])
    assert result.rings.extra.tolist() == [0, 1, 0]


def test_ellipses_that_are_large_on_a_zoomed_picture_are_sent():
    """From 100 m up a tenth of a metre is a pixel, and 17 on a large screen that is zoomed in."""
    hydrants = [geo([[3 * k, 3 * k, 0]], f"H{k}") for k in range(-5, 6)]
    pose = camera_pose([0, 0, -100.0], 0, -90, 0, 1e-7)
    ellipses = written([MapLayer("", hydrants)], pose=pose).words["ellipses"]
    assert len(ellipses) == len(hydrants)
    assert 1 < max(major for _, _, major, *_ in ellipses) < 3


def test_marks_have_their_ellipses_beside_many_named_houses():
    """Forty names of houses had left none for the hydrants."""
    hydrants = [geo([[30 + 2 * k, k, 0]], f"H{k}") for k in range(8)]
    layers = [MapLayer("hydrants", hydrants), MapLayer("houses", town(80))]
    assert len(written(layers).words["ellipses"]) == len(hydrants)


def test_without_a_pose_there_are_words_alone():
    result = written([MapLayer("", town(3))], picture=GREY, pose=None, notice="NO MAP: x")
    assert result.vertices > 0
    shaper = dataclasses.replace(seen([MapLayer("", town(3))]), map=None, notice="NO MAP: x")
    words = read_shapes(written_shapes(shaper, GREY, None).to_bytes())
    assert words.vertices == 0
    assert ["NO MAP: x", 1] in words.words["notices"]
    assert words.words["celsius"] is None


@pytest.mark.parametrize(
    ("houses", "corners", "size_m"), [(2200, 4, 0.7), (900, 10, 0.7), (160, 99, 9)]
)
def test_ten_thousand_vertices_take_20_kb_and_coarser_5_kb(houses, corners, size_m):
    """The least and the most vertices that a shape of a map has."""
    pose = camera_pose([0, 0, -60.0], 0, -50, 0, 1e-4)
    whole = written([MapLayer("", town(houses, size_m, corners))], pose=pose)
    assert 8_000 < whole.vertices < 13_000
    data = whole.to_bytes()
    assert len(data) / whole.vertices <= 20_000 / 10_000
    few = coarser(data, 5000)
    assert len(few) <= 5000
    assert read_shapes(few).words["size"] == [640, 512]
    assert coarser(few, 5000) is few


def test_marks_that_hide_each_other_are_few_on_a_thin_link():
    """All trees of a park, and its ways: lines and marks stay in every part of the picture."""
    rng = np.random.default_rng(6)
    trees = np.column_stack([rng.uniform(26, 60, 6000), rng.uniform(-9, 9, 6000), np.zeros(6000)])
    ways = [geo([[26, k, 0], [60, k, 0]]) for k in range(-8, 9)]
    layers = [MapLayer("ways", ways), MapLayer("trees", [geo(tree[None]) for tree in trees])]
    whole = written(layers)
    few = read_shapes(coarser(whole.to_bytes(), 5000))
    assert len(few.to_bytes()) <= 5000
    assert len(few.lines.layer) == len(whole.lines.layer)
    off = few.marks.points[:, None] - whole.marks.points[:, :, None]
    assert np.hypot(*off).min(axis=1).max() <= 4 * 20 * np.sqrt(2)  # squares of 20 px
    assert {*map(tuple, few.marks.points.T)} <= {*map(tuple, whole.marks.points.T)}


def test_no_label_is_without_its_mark_on_a_thin_link():
    """It was beside the mark of another hydrant, and seemed to be its name."""
    hydrants = [geo([[35 + k, 3 * k, 0]], f"H{k}") for k in range(-6, 7)]
    near = [geo([[35 + k, 3 * k + 0.2, 0]]) for k in range(-6, 7)]
    whole = written([MapLayer("hydrants", [*near, *hydrants])])
    few = read_shapes(coarser(whole.to_bytes(), 60))
    assert 0 < len(few.marks.layer) < len(whole.marks.layer)
    for _, u, v, *_ in few.words["labels"]:
        off = np.abs(few.marks.points / 4 - [[u], [v]])
        assert off.max(axis=0).min() < 0.25


def test_a_coarser_line_is_near_the_line():
    """Within the tolerances of its passes: a way of 400 vertices, in 2 kB."""
    rng = np.random.default_rng(8)
    way = np.column_stack(
        [np.linspace(26, 90, 400), rng.normal(0, 0.2, 400).cumsum(), np.zeros(400)]
    )
    whole = written([MapLayer("", [geo(way), geo(way[::-1])])])
    few = read_shapes(coarser(whole.to_bytes(), 900))
    assert 0 < len(few.lines.layer) <= len(whole.lines.layer)  # its pieces are joined
    assert few.lines.points.shape[1] < 0.7 * whole.lines.points.shape[1]
    kept = {tuple(point) for point in few.lines.points.T.tolist()}
    assert kept <= {tuple(point) for point in whole.lines.points.T.tolist()}
    assert len(kept) >= 2


def test_long_lines_of_many_vertices_stay_on_a_thin_link():
    """Contours: they come in pieces of some pixels each, and all of them had been left out."""
    east = np.linspace(-30, 30, 3000)
    contours = [
        dataclasses.replace(
            geo(np.column_stack([north + np.sin(3 * east), east, 0 * east])), closed=False
        )
        for north in range(-20, 20, 4)
    ]
    whole = written([MapLayer("", contours)], pose=camera_pose([0, 0, -100.0], 0, -90, 0, 1e-6))
    few = read_shapes(coarser(whole.to_bytes(), 1000))
    assert len(few.to_bytes()) <= 1000
    left, right = (few.lines.points[0, few.lines.starts[k:][:10] - k] for k in (0, 1))
    assert np.abs(right - left).min() >= 4 * 400


TOWN = written([MapLayer("", town(30), FILLED)]).to_bytes()


@pytest.mark.parametrize("cut", [0, 3, 20, -1])
def test_damaged_bytes_are_refused(cut):
    data = written([MapLayer("", town(3))]).to_bytes()
    with pytest.raises(MessageError, match="tirgeo/overlay/shapes"):
        read_shapes(zlib.compress(zlib.decompress(data)[:cut]) if cut else b"no stream")


@given(places=st.lists(st.tuples(st.floats(0, 1), st.integers(1, 255)), min_size=1, max_size=5))
def test_shapes_damaged_anyhow_are_refused_or_read(places):
    data = bytearray(zlib.decompress(TOWN))
    for share, change in places:
        data[int(share * (len(data) - 1))] ^= change
    with contextlib.suppress(MessageError):
        coarser(zlib.compress(data), 100)


def test_large_numbers_are_whole_again():
    whole = written([MapLayer("", town(2))])
    far = whole.lines._replace(points=whole.lines.points * 1_000_000)
    result = read_shapes(WrittenShapes(whole.words, whole.rings, far, whole.marks).to_bytes())
    assert np.array_equal(result.lines.points, far.points)


def test_the_lines_for_foxglove_are_the_same_lines():
    """Two points a segment, from the corner of the first pixel, in the colour of their layer."""
    ways = [geo([[30, -5, 0], [50, 9, 0]]), geo([[35, 5, 0], [45, 5, 0], [45, 8, 0]])]
    whole = written([MapLayer("a", ways[:1]), MapLayer("b", ways[1:], FILLED)])
    marker = Messages().line_marker(START, whole)
    lines = [line.T / 4 for line in np.split(whole.lines.points, whole.lines.starts[1:-1], axis=1)]
    ends = np.concatenate([np.repeat(line, 2, axis=0)[1:-1] for line in lines]) + 0.5
    assert [(p.x, p.y) for p in marker.points] == [tuple(end) for end in ends.tolist()]
    segments = [len(line) - 1 for line in lines]
    blue = [c.b for c in marker.outline_colors]
    assert blue == [0.0] * sum(segments)
    green = [c.g for c in marker.outline_colors]
    assert green == [1.0] * segments[0] + [80 / 255] * sum(segments[1:])
    assert Cdr.serialize(marker)
