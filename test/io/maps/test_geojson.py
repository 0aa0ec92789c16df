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
"""GeoJSON is read as GDAL reads it, to the last bit, without GDAL."""

from __future__ import annotations

import json

import numpy as np
import pyogrio
import pytest
from map_files import RING
from wild_map_files import BAD, collection, feature, named

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps.gdal_tables import _tables, read_tables
from tirgeo_ros.io.maps.geojson import geojson_table
from tirgeo_ros.io.maps.layers import read_layers
from tirgeo_ros.io.maps.style_sheet import LabelRule, Wanted, shown_value

NINE = [[16.123456789012345 + k / 3, 48.0 + k / 7, 170.1 + k / 11] for k in range(9)]
SHAPES = {
    "Point": NINE[0],
    "MultiPoint": NINE[:3],
    "LineString": NINE,
    "MultiLineString": [NINE[:4], NINE[4:]],
    "Polygon": [[*NINE[:3], NINE[0]], [*NINE[6:9], NINE[6]]],
    "MultiPolygon": [[[*NINE[:3], NINE[0]]], [[*NINE[3:6], NINE[3]]]],
}


def of(*values, member="kind"):
    """Features with these values of a property, one for each."""
    return [feature("Point", RING[0], properties={member: value}) for value in values]


def geometry(kind, **members):
    return {"type": "Feature", "properties": {}, "geometry": {"type": kind, **members}}


INNER = [{"type": kind, "coordinates": nested} for kind, nested in SHAPES.items()]
MIXED = {"type": "GeometryCollection", "geometries": INNER[:2]}
FILES = {
    **{kind: collection(feature(kind, nested)) for kind, nested in SHAPES.items()},
    "collections": collection(geometry("GeometryCollection", geometries=[*INNER, MIXED])),
    "a feature": json.dumps(feature()),
    "a geometry": json.dumps(INNER[4]),
    "a collection of geometries": json.dumps(MIXED),
    "a name": collection(feature(), name="beds"),
    "a system": collection(
        feature(coordinates=[[5e5, 5.3e6], [6e5, 5.4e6]]), **named("EPSG:2154")
    ),
    "a system by its code": collection(
        feature(coordinates=[[5e5, 5.3e6], [6e5, 5.4e6]]),
        crs={"type": "EPSG", "properties": {"code": 32633}},
    ),
    "no system": collection(feature(), crs=None),
    "no feature": collection(feature(), {"properties": {}, "geometry": None}, feature()),
    "words of geometries as properties": collection(
        feature(properties={"kind": "a", "coordinates": "16,48", "geometry": "point"})
    ),
    "bad features": collection(*BAD, *[feature()] * 3),
    "numbers": collection(*of(1, 2.5, None, -3)),
    "whole numbers": collection(*of(1, 2, -3)),
    "texts": collection(*of("a", None, "", "Straße")),
    "texts and numbers": collection(*of("96", 60, 2.5)),
    "true and false": collection(*of(True, False)),
    "nothing": collection(*of(None, None)),
    "an id": collection(feature(id="w7"), feature(id="w8")),
    "ids of numbers": collection(feature(id=7), feature(id=8)),
    "more in a position": collection(feature("LineString", [[16, 48, 3, 9], [17, 48, 4, 9]])),
    "an open ring": collection(feature("Polygon", [RING[:-1]])),
    "empty": collection(feature("LineString", []), feature("Point", []), feature("Polygon", [])),
    "no geometry": collection(feature(), {"type": "Feature", "properties": {}, "geometry": None}),
    "long numbers": '{"type": "Point", "coordinates": [16.12345678901234567890123, 4.8e1]}',
}
WANTED = Wanted(LabelRule.of_field("kind"))


def both(path):
    """The table of a file: read here, and by GDAL."""
    (other,) = _tables(pyogrio, path, "", WANTED)
    return geojson_table(path, WANTED), other


@pytest.mark.parametrize("case", FILES)
def test_a_table_is_that_of_gdal(tmp_path, case):
    path = tmp_path / "a map.geojson"
    path.write_text(FILES[case])
    ours, other = both(path)
    assert (ours.where, ours.name) == (other.where, other.name)
    assert ours.crs == ("EPSG:4326" if other.crs == "EPSG:4979" else other.crs)  # with heights
    for name in ("points", "starts", "feature", "closed"):
        np.testing.assert_array_equal(getattr(ours.shapes, name), getattr(other.shapes, name))
    assert ours.faults == other.faults
    assert {*ours.fields} == {*other.fields}
    shown = [
        [{k: shown_value(v) for k, v in row.items()} for row in t.rows] for t in (ours, other)
    ]
    assert shown[0] == shown[1]


def test_the_sample_map_is_that_of_gdal(sample):
    ours, other = both(sample / "map.geojson")
    np.testing.assert_array_equal(ours.shapes.points, other.shapes.points)
    assert ours.rows == other.rows
    assert len(ours.rows) > 10


@pytest.mark.parametrize(
    "text",
    [
        "\n".join([json.dumps(feature())] * 2),
        f"\x1e{json.dumps(feature())}\n",
        '{"type": "Topology", "objects": {}, "arcs": []}',
        "[1, 2]",
    ],
)
def test_other_json_is_left_to_gdal(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    assert geojson_table(tmp_path / "a.json", WANTED) is None


def test_a_line_of_heights_here_and_there_has_them_where_they_are(tmp_path):
    """GDAL takes 0 for the others, which would be at the ellipsoid."""
    path = tmp_path / "a.geojson"
    path.write_text(collection(feature("LineString", [[16, 48, 3], [17, 48]])))
    (layer,) = read_layers(str(path))
    np.testing.assert_array_equal(layer.features[0].points[:, 2], [3, np.nan])


def test_a_damaged_file_is_refused_with_the_place(tmp_path):
    path = tmp_path / "a.geojson"
    path.write_text(FILES["a feature"][:-9])
    with pytest.raises(MapError, match=r"a\.geojson: not a readable map: .* line 1 column \d+"):
        read_tables(path, "", WANTED)
