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
"""Survey and observation files, and control points of a picture."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from measured import run_measured

from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.io.surveys.survey import (
    Observation,
    SurveyPoint,
    downward,
    load_control_points,
    load_observations,
    load_survey,
    save_observations,
    save_survey,
)

names = st.text(st.characters(codec="utf-8", categories=("L", "N")), min_size=1).filter(
    lambda name: name == name.strip()
)
points = st.builds(
    SurveyPoint,
    names | st.sampled_from(['a,"b"', "K 1"]),
    st.floats(-math.pi / 2, math.pi / 2),
    st.floats(-math.pi, math.pi),
    st.floats(-500, 9000),
)


@given(st.lists(points, min_size=1, max_size=5, unique_by=lambda point: point.id))
@pytest.mark.parametrize("suffix", ["csv", "geojson"])
def test_survey_round_trip(tmp_path_factory, suffix, expected):
    path = tmp_path_factory.mktemp("survey") / f"survey.{suffix}"
    save_survey(path, expected)
    result = load_survey(path)
    assert [p.id for p in result] == [p.id for p in expected]
    for point, wanted in zip(result, expected, strict=True):
        # Ten decimals of a degree and four of a metre are written.
        assert abs(point.latitude_rad - wanted.latitude_rad) <= math.radians(0.51e-10)
        assert abs(point.longitude_rad - wanted.longitude_rad) <= math.radians(0.51e-10)
        assert abs(point.height_m - wanted.height_m) <= 0.51e-4


def test_csv_by_hand(tmp_path):
    path = tmp_path / "s.csv"
    path.write_bytes(b"\xef\xbb\xbfh, id ,lat,lon,note\r\n12.5,7, 30 ,-97,by the oak\r\n")
    (point,) = load_survey(path)
    assert point == SurveyPoint("7", math.radians(30), math.radians(-97), 12.5)


def test_observation_round_trip(tmp_path):
    path = tmp_path / "o.csv"
    rows = [Observation("P1", 1_700_000_000_123_456_789, 12.125, -3.5), Observation("P2", 0, 0, 1)]
    save_observations(path, rows)
    assert path.read_text().splitlines()[0] == "id,stamp_ns,u,v"
    assert load_observations(path) == rows


def feature(geometry=None, properties=None):
    geometry = geometry or {"type": "Point", "coordinates": [1, 2, 3]}
    properties = {"id": "a"} if properties is None else properties
    return {"type": "Feature", "geometry": geometry, "properties": properties}


@pytest.mark.parametrize(
    "broken",
    [
        feature({"type": "LineString", "coordinates": [[1, 2, 3], [1, 2, 3]]}),
        feature({"type": "Point", "coordinates": [1, 2]}),
        feature({"type": "Point", "coordinates": ["east", 2, 3]}),
        feature({"type": "Point", "coordinates": [1, 91, 3]}),
        feature(properties={}),
        feature({"type": "Point", "coordinates": [10**400, 5, 6]}),
        {"type": "Feature", "geometry": None, "properties": {"id": "a"}},
        3,
    ],
)
def test_broken_features_are_numbered(tmp_path, broken):
    path = tmp_path / "s.geojson"
    features = [feature(), broken]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.raises(SurveyError, match=f"^{path}: feature 2 is not a Point with longitude"):
        load_survey(path)


def test_files_that_cannot_be_read_or_written(tmp_path):
    with pytest.raises(SurveyError, match=r"none\.csv: cannot be read: No such file"):
        load_observations(tmp_path / "none.csv")
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\xfa")
    with pytest.raises(SurveyError, match="not a text file in UTF-8"):
        load_survey(tmp_path / "bytes.csv")
    with pytest.raises(SurveyError, match="cannot be written: No such file"):
        save_observations(tmp_path / "none" / "o.csv", [])


TABLES = {
    "load_survey": ("id,lat,lon,h", "P{0},48.{0:07d},16.{0:07d},200.5"),
    "load_observations": ("id,stamp_ns,u,v", "P{0},{0},320.5,256.5"),
}
LOAD = """
import sys
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.surveys import survey
name, path = sys.argv[1:]
try:
    print(len(getattr(survey, name)(path)))
except TirgeoError as error:
    print(error)
"""


@pytest.mark.parametrize("name", TABLES)
def test_a_table_of_too_many_rows_is_refused(tmp_path, name):
    """The results of a million rows, such as ellipses of sixty corners, take four gigabytes."""
    header, row = TABLES[name]
    rows, reason = (30_000, "more than the 20000 allowed: split the file")
    if name == "load_observations":
        rows, reason = (10**6, "larger than 16 MB")
    path = tmp_path / "many.csv"
    lines = "\n".join(row.format(number) for number in range(rows))
    path.write_text(f"{header}\n{lines}\n")
    done = run_measured(LOAD, name, str(path))
    assert done.said.startswith(f"{path}: "), done
    assert reason in done.said, done
    assert done.said.count("\n") == 1
    done.check_modest()


MARKS = "id,column,row\na,10.5,20\nb,30,40\nc,50,5\n"
SURVEY = "id,lat,lon,h\nc,39.82,116.71,20\na,39.81,116.7,20\nz,39.8,116.7,20\n"
HEAD = "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual\n"
POINTS = (
    '#CRS: GEOGCRS["WGS 84",DATUM["World Geodetic System 1984",ELLIPSOID["WGS 84",6378137,'
    '298.257223563]],CS[ellipsoidal,2],AXIS["latitude",north],AXIS["longitude",east],'
    'ANGLEUNIT["degree",0.0174532925199433],ID["EPSG",4326]]\n'
    f"{HEAD}116.70,39.81,100.5,-200.25,1,0,0,0\n116.71,39.82,300,-400,1,0,0,0\n"
    "116.72,39.83,500,-600,0,0,0,0\n"
)


def write(folder, name, text):
    (folder / name).write_text(text)
    return folder / name


def test_marks_and_survey_are_matched_by_id(tmp_path):
    result = load_control_points(write(tmp_path, "m.csv", MARKS), write(tmp_path, "s.csv", SURVEY))
    assert result.names == ["a", "c"]
    assert result.pixels.tolist() == [[10.5, 20], [50, 5]]
    np.testing.assert_allclose(result.degrees, [[116.7, 39.81], [116.71, 39.82]], rtol=1e-12)
    assert result.unused == ("b", "z")


def test_a_points_file_of_qgis(tmp_path):
    result = load_control_points(write(tmp_path, "o.points", POINTS), None)
    assert result.pixels.tolist() == [[100.5, 200.25], [300, 400]]  # the third is switched off
    np.testing.assert_allclose(result.degrees, [[116.70, 39.81], [116.71, 39.82]], rtol=1e-12)


def test_rows_counted_upwards_are_reversed():
    up = np.array([[1.0, -5], [2, -700], [3, 2]])  # one a little above the picture
    assert downward(up)[:, 1].tolist() == [5, 700, -2]
    assert downward(-up)[:, 1].tolist() == [5, 700, -2]
    assert downward(np.zeros((0, 2))).shape == (0, 2)


OF_SURVEYS = [
    ("{", "line 1: not JSON"),
    (f'{{"a": {"9" * 5000}}}', "not JSON: Exceeds the limit"),
    (f'{{"a": {"[" * 100_000}', "not JSON: maximum recursion depth"),
    ("[1]", "not a GeoJSON FeatureCollection"),
    ("", "no column id, lat, lon, h; the first line must be id,lat,lon,h"),
    ("id,lat,lon\n", "no column h;"),
    ("id,lat,lon,h\na,1,2,3\nb,1,2\n", "line 3 does not match id,lat,lon,h"),
    ("id,lat,lon,h\na,north,2,3\n", "line 2 does not match"),
    ("id,lat,lon,h\na,1,2,inf\n", "line 2 does not match"),
    ("id,lat,lon,h\na,1,2,3\na,4,5,6\n", "point a appears twice"),
]
ROWS = ["a,1.5,2,3", "a,1,x,3", "a,1,2", "a,1,nan,3", ",1,2,3", "a,1e400,2,3", f"a,{1 << 63},2,3"]
OF_POINTS = [
    (POINTS.partition("\n")[2], "names no coordinate system; save it with QGIS 3.26"),
    (MARKS, "not a .points file of QGIS .*give --survey too"),
    (POINTS.replace("300", "x"), "point 2 must have four numbers"),
    (POINTS.replace("39.82", "99.82"), "a point is outside its system GEOG"),
]
OF_MARKS = [
    ("id,column\na,1\n", "no column row; the first line must be id,column,row"),
    ("id,column,row\na,1,nan\n", "line 2 does not match id,column,row"),
    ("id,column,row\na,1,2\na,3,4\n", "point a appears twice"),
    ("id,column,row\nq,1,2\n", r"none of its ids is in .*s\.csv"),
]
CASES = [
    *((load_survey, *case) for case in OF_SURVEYS),
    *((load_observations, f"id,stamp_ns,u,v\nb,1,2,3\n{row}\n", "line 3 does") for row in ROWS),
    *((lambda path: load_control_points(path, None), *case) for case in OF_POINTS),
    *((lambda path: load_control_points(path, path.with_name("s.csv")), *c) for c in OF_MARKS),
]


@pytest.mark.parametrize(("load", "text", "reason"), CASES)
def test_errors_name_the_file_and_the_line(tmp_path, load, text, reason):
    write(tmp_path, "s.csv", SURVEY)
    path = write(tmp_path, "refused.csv", text)
    with pytest.raises(SurveyError, match=f"^{path}: {reason}"):
        load(path)
