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
"""A map read by another process, which may fail or crash, and the map for a web page."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from project import reader_of

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.vector_map import GeoFeature, MapLayer
from tirgeo_ros.core.overlay.map_shapes import drape_layers
from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.io.maps import load_layers, map_process as module
from tirgeo_ros.io.maps.map_process import MapProcess, page_map

PLANE = TangentPlane(math.radians(30.5), math.radians(114.3), 25.0)
LINE = [[114.3, 30.5], [114.301, 30.5005], [114.302, 30.501]]


@pytest.fixture
def config(tmp_path) -> OverlayConfig:
    path = tmp_path / "map.geojson"
    path.write_text(feature(LINE))
    return OverlayConfig(map=str(path), ground_height_m=30.0)


def feature(line) -> str:
    geometry = {"type": "LineString", "coordinates": line}
    return json.dumps({"type": "Feature", "properties": {}, "geometry": geometry})


@pytest.fixture
def child():
    process = MapProcess()
    yield process
    process.stop()


def test_the_map_equals_one_draped_in_this_process(child, config):
    contents = child.read(config)
    assert (contents.features, contents.left_out) == (1, ())
    result, own = child.drape(PLANE), drape_layers(load_layers(config.map), PLANE, 30.0)
    np.testing.assert_array_equal(result.map.lines.points, own.map.lines.points)
    assert (result.plane, result.features) == (PLANE, contents.features)
    # Half and a whole thousandth of a degree to the north, at 110.85 km a degree there (WGS84).
    np.testing.assert_allclose(result.map.lines.points[0][-1], 110.85, rtol=1e-3)
    assert math.isnan(result.level_m)


def test_the_middle_of_own_heights_comes_with_the_map(child, config):
    high = [[*place, height] for place, height in zip(LINE, (10.0, 20.0, 60.0), strict=True)]
    Path(config.map).write_text(feature(high))
    child.read(OverlayConfig(map=config.map))
    assert child.drape(PLANE).level_m == 20.0


def test_a_map_is_read_again_before_each_draping(child, config):
    child.read(config)
    child.read(config)  # the first is given up
    child.drape(PLANE)
    with pytest.raises(MapError, match=r"map\.geojson: nothing was read"):
        child.drape(PLANE)
    child.read(config)
    assert child.drape(PLANE).features == 1


def test_an_error_of_the_reading_is_raised_in_the_parent(child, config):
    with pytest.raises(ConfigError, match="1 of 1 features have no height; set ground_height_m"):
        child.read(OverlayConfig(map=config.map))
    Path(config.map).write_text("{")
    with pytest.raises(MapError, match=r"map\.geojson: not a readable map"):
        child.read(config)
    with pytest.raises(MapError, match=r"nowhere\.geojson"):
        child.read(OverlayConfig(map=str(Path(config.map).with_name("nowhere.geojson"))))


def test_a_reader_that_dies_is_an_error_that_names_the_map(child, config):
    child.read(config)
    os.kill(reader_of(os.getpid()), signal.SIGKILL)
    with pytest.raises(
        MapError, match=r"map\.geojson: the process that reads it ended \(exit code -9\)"
    ):
        child.drape(PLANE)
    assert child.read(config).features == 1  # the next map is not affected


def test_a_reader_that_cannot_begin_is_an_error_that_names_the_map(child, config, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(
        MapError, match=r"map\.geojson: the process that reads it ended \(exit code 1\)"
    ):
        child.read(config)


def test_a_reading_is_stopped_from_another_thread(child, config, tmp_path):
    """The reader waits at a pipe that nobody writes to."""
    pipe = tmp_path / "slow.geojson"
    os.mkfifo(pipe)
    raised: list[MapError] = []

    def read() -> None:
        try:
            child.read(OverlayConfig(map=str(pipe), ground_height_m=30.0))
        except MapError as error:
            raised.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    time.sleep(0.2)
    child.stop()
    thread.join(10.0)
    assert not thread.is_alive()
    assert "slow.geojson: the process that reads it ended (exit code -9)" in str(raised[0])
    with pytest.raises(MapError, match=r"map\.geojson: not read: stopped"):
        child.read(config)


def part(*places, label="", closed=False, group=-1):
    points = np.radians([(*place, 0.0) for place in places])
    points[:, 2] = math.nan
    return GeoFeature(label, closed, points, group)


SQUARE = ((48.0, 16.0), (48.0, 16.2), (48.2, 16.2))
HOLE = ((48.05, 16.1), (48.05, 16.15), (48.1, 16.15))


def drawn(*features):
    result = json.loads(page_map([MapLayer("beds", features)]))
    return [(item["geometry"], item["properties"]) for item in result["features"]]


def test_points_lines_and_areas_are_longitude_and_latitude():
    (point, _), (line, _), (area, reports) = drawn(
        part((48.123456789, 16.5), label="hydrant"),
        part(*SQUARE[:2]),
        part(*SQUARE, label="bed", closed=True),
    )
    assert point == {"type": "Point", "coordinates": [16.5, 48.1234568]}
    assert line == {"type": "LineString", "coordinates": [[16.0, 48.0], [16.2, 48.0]]}
    ring = [[16.0, 48.0], [16.2, 48.0], [16.2, 48.2], [16.0, 48.0]]
    assert area == {"type": "Polygon", "coordinates": [ring]}
    assert reports == {"layer": "beds", "name": "bed"}


def test_the_outlines_of_a_feature_are_one_area_with_holes():
    parts = (part(*SQUARE, closed=True, group=3), part(*HOLE, closed=True, group=3))
    (area, _), (other, _) = drawn(*parts, part(*SQUARE, closed=True, group=4))
    assert [len(ring) for ring in area["coordinates"]] == [4, 4]
    assert len(other["coordinates"]) == 1


def circle(rng, radius_m, count):
    turn = np.linspace(0, 2 * math.pi, count, endpoint=False)
    ring_m = rng.uniform(-2000, 2000, 2) + radius_m * np.column_stack([np.sin(turn), np.cos(turn)])
    ring = np.degrees(ring_m / 6378137.0) / [1, math.cos(0.838)] + [math.degrees(0.838), 16]
    return part(*ring, closed=True)


def test_a_large_map_is_simplified_to_what_a_browser_draws(monkeypatch):
    """The largest parts stay, houses with corners, lakes within the stated tolerance."""
    monkeypatch.setattr(module, "MOST_PARTS", 300)
    monkeypatch.setattr(module, "MOST_POINTS", 2500)
    rng = np.random.default_rng(1)
    houses = [circle(rng, 5.0, 4) for _ in range(1000)]
    lakes = [circle(rng, 100.0, 64) for _ in range(30)]
    layers = [MapLayer("houses", houses), MapLayer("lakes", lakes)]
    result = json.loads(page_map(layers))
    shapes = [item["geometry"]["coordinates"][0] for item in result["features"]]
    names = [item["properties"]["layer"] for item in result["features"]]
    assert names == ["houses"] * 270 + ["lakes"] * 30
    assert {len(ring) for ring in shapes[:270]} == {5}  # an outline ends where it begins
    words = re.fullmatch("300 of 1,030 shapes, lines within (.*) m", result["simplified"])
    for lake, ring in zip(lakes, shapes[270:], strict=True):
        assert 5 < len(ring) < 64
        kept_rad = np.radians(ring)[:, ::-1]
        off = np.abs(lake.points[:, None, :2] - kept_rad).sum(axis=2).min(axis=0)
        assert off.max() < 1.8e-9  # each is a point of the map, twice rounded to 5e-8 degrees
        middle_m = (kept_rad[1:] + kept_rad[:-1]) / 2 - lake.points[:, :2].mean(axis=0)
        sagitta_m = 100 - 6378137.0 * np.hypot(middle_m[:, 0], middle_m[:, 1] * math.cos(0.838))
        assert sagitta_m.max() < 1.05 * float(words[1])  # two digits are said
    monkeypatch.undo()
    assert json.loads(page_map(layers))["simplified"] == ""


def test_the_process_that_reads_maps_makes_the_pages_map(sample):
    child = MapProcess()
    try:
        result = json.loads(child.answer("map", "page", str(sample / "map.geojson")))
    finally:
        child.close()
    names = {item["properties"]["name"] for item in result["features"]}
    assert "Peony D8" in names
