"""A map as a web page gets it: places and names of every form, no more than a browser draws."""

from __future__ import annotations

import json
import math
import re

import numpy as np

from tirgeo_ros.core.map.map_layers import GeoFeature, MapLayer
from tirgeo_ros.io.maps import map_process as module
from tirgeo_ros.io.maps.map_process import MapProcess, page_map


def feature(*places, label="", closed=False, group=-1):
    points = np.radians([(*place, 0.0) for place in places])
    points[:, 2] = math.nan
    return GeoFeature(label, closed, points, group)


SQUARE = ((48.0, 16.0), (48.0, 16.2), (48.2, 16.2))
HOLE = ((48.05, 16.1), (48.05, 16.15), (48.1, 16.15))


def drawn(*features):
    found = json.loads(page_map([MapLayer("beds", features)]))
    return [(one["geometry"], one["properties"]) for one in found["features"]]


def test_points_lines_and_areas_are_longitude_and_latitude():
    (point, _), (line, _), (area, told) = drawn(
        feature((48.123456789, 16.5), label="hydrant"),
        feature(*SQUARE[:2]),
        feature(*SQUARE, label="bed", closed=True),
    )
    assert point == {"type": "Point", "coordinates": [16.5, 48.1234568]}
    assert line == {"type": "LineString", "coordinates": [[16.0, 48.0], [16.2, 48.0]]}
    ring = [[16.0, 48.0], [16.2, 48.0], [16.2, 48.2], [16.0, 48.0]]
    assert area == {"type": "Polygon", "coordinates": [ring]}
    assert told == {"layer": "beds", "name": "bed"}


def test_the_outlines_of_a_feature_are_one_area_with_holes():
    parts = (feature(*SQUARE, closed=True, group=3), feature(*HOLE, closed=True, group=3))
    (area, _), (other, _) = drawn(*parts, feature(*SQUARE, closed=True, group=4))
    assert [len(ring) for ring in area["coordinates"]] == [4, 4]
    assert len(other["coordinates"]) == 1


def circle(rng, radius_m, count):
    turn = np.linspace(0, 2 * math.pi, count, endpoint=False)
    ring_m = rng.uniform(-2000, 2000, 2) + radius_m * np.column_stack([np.sin(turn), np.cos(turn)])
    ring = np.degrees(ring_m / 6378137.0) / [1, math.cos(0.838)] + [math.degrees(0.838), 16]
    return feature(*ring, closed=True)


def test_a_large_map_is_simplified_to_what_a_browser_draws(monkeypatch):
    """The largest stay, houses with corners, lakes within the tolerance; words say so."""
    monkeypatch.setattr(module, "MOST_PARTS", 300)
    monkeypatch.setattr(module, "MOST_POINTS", 2500)
    rng = np.random.default_rng(1)
    houses = [circle(rng, 5.0, 4) for _ in range(1000)]
    lakes = [circle(rng, 100.0, 64) for _ in range(30)]
    layers = [MapLayer("houses", houses), MapLayer("lakes", lakes)]
    found = json.loads(page_map(layers))
    shapes = [one["geometry"]["coordinates"][0] for one in found["features"]]
    names = [one["properties"]["layer"] for one in found["features"]]
    assert names == ["houses"] * 270 + ["lakes"] * 30
    assert {len(ring) for ring in shapes[:270]} == {5}  # an outline ends where it begins
    words = re.fullmatch("300 of 1,030 shapes, lines within (.*) m", found["simplified"])
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


def test_the_process_that_reads_maps_makes_it(sample):
    child = MapProcess()
    try:
        found = json.loads(child.answer("map", "page", str(sample / "map.geojson")))
    finally:
        child.close()
    names = {one["properties"]["name"] for one in found["features"]}
    assert "Peony D8" in names
