"""A map as a web page gets it: places, names and colours of every form."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from tirgeo_ros.core.map.layers import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps import page_map as module
from tirgeo_ros.io.maps.map_process import MapProcess
from tirgeo_ros.io.maps.page_map import page_map


def feature(*places, label="", closed=False, group=-1):
    points = np.radians([(*place, 0.0) for place in places])
    points[:, 2] = math.nan
    return GeoFeature(label, closed, points, group)


SQUARE = ((48.0, 16.0), (48.0, 16.2), (48.2, 16.2))
HOLE = ((48.05, 16.1), (48.05, 16.15), (48.1, 16.15))


def drawn(*features, **style):
    found = json.loads(page_map([MapLayer("beds", features, LayerStyle(**style))]))
    return [(one["geometry"], one["properties"]) for one in found["features"]]


def test_points_lines_and_areas_are_longitude_and_latitude():
    (point, _), (line, _), (area, told) = drawn(
        feature((48.123456789, 16.5), label="hydrant"),
        feature(*SQUARE[:2]),
        feature(*SQUARE, label="bed", closed=True),
        line_bgr=(255, 128, 0),
        fill_bgr=(1, 2, 3),
    )
    assert point == {"type": "Point", "coordinates": [16.5, 48.1234568]}
    assert line == {"type": "LineString", "coordinates": [[16.0, 48.0], [16.2, 48.0]]}
    ring = [[16.0, 48.0], [16.2, 48.0], [16.2, 48.2], [16.0, 48.0]]
    assert area == {"type": "Polygon", "coordinates": [ring]}
    assert told == {"layer": "beds", "name": "bed", "color": "#0080ff", "filled": True}


def test_the_outlines_of_a_feature_are_one_area_with_holes():
    parts = (feature(*SQUARE, closed=True, group=3), feature(*HOLE, closed=True, group=3))
    (area, _), (other, _) = drawn(*parts, feature(*SQUARE, closed=True, group=4))
    assert [len(ring) for ring in area["coordinates"]] == [4, 4]
    assert len(other["coordinates"]) == 1


def test_a_map_too_large_for_a_browser_is_refused(monkeypatch):
    monkeypatch.setattr(module, "MOST_BYTES", 100)
    with pytest.raises(MapError, match="cut out the area of the flight"):
        drawn(feature(*SQUARE))


def test_the_process_that_reads_maps_makes_it(sample):
    child = MapProcess()
    try:
        found = json.loads(child.answer("map", "page", str(sample / "map.geojson")))
    finally:
        child.close()
    names = {one["properties"]["name"] for one in found["features"]}
    assert "Peony D8" in names
