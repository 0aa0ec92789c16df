"""Control points of a picture, from a CSV and its survey or from QGIS."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.io.surveys.survey import downward, load_control_points

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
    found = load_control_points(
        write(tmp_path, "m.csv", MARKS), write(tmp_path, "s.csv", SURVEY), None
    )
    assert found.names == ["a", "c"]
    assert found.pixels.tolist() == [[10.5, 20], [50, 5]]
    np.testing.assert_allclose(found.degrees, [[116.7, 39.81], [116.71, 39.82]], rtol=1e-12)
    assert found.unused == ("b", "z")


def test_a_points_file_of_qgis(tmp_path):
    found = load_control_points(write(tmp_path, "o.points", POINTS), None, None)
    assert found.pixels.tolist() == [[100.5, 200.25], [300, 400]]  # the third is switched off
    np.testing.assert_allclose(found.degrees, [[116.70, 39.81], [116.71, 39.82]], rtol=1e-12)


def test_a_points_file_of_older_qgis_in_a_named_plane(tmp_path):
    text = "mapX,mapY,pixelX,pixelY,enable\n500000,4400000,10,-20,1\n"
    found = load_control_points(write(tmp_path, "o.points", text), None, "EPSG:32650")
    assert found.degrees[0, 0] == pytest.approx(117.0, abs=1e-9)  # the zone's middle meridian
    assert found.pixels.tolist() == [[10, 20]]


def test_rows_that_grow_upwards_are_turned():
    up = np.array([[1.0, -5], [2, -700], [3, 2]])  # one a little above the picture
    assert downward(up)[:, 1].tolist() == [5, 700, -2]
    assert downward(-up)[:, 1].tolist() == [5, 700, -2]
    assert downward(np.zeros((0, 2))).shape == (0, 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (POINTS.partition("\n")[2], "names no coordinate reference system; give --points-crs"),
        (MARKS, "not a .points file of QGIS .*give --survey too"),
        (POINTS.replace("300", "x"), "point 2 is not four numbers"),
        (POINTS.replace("39.82", "99.82"), "a point is not a place in GEOG"),
    ],
)
def test_points_files_that_are_refused(tmp_path, text, message):
    with pytest.raises(SurveyError, match=rf"o\.points: {message}"):
        load_control_points(write(tmp_path, "o.points", text), None, None)


@pytest.mark.parametrize(
    ("marks", "message"),
    [
        ("id,column\na,1\n", r"m\.csv: no column row; the first line must be id,column,row"),
        ("id,column,row\na,1,nan\n", r"m\.csv: line 2 does not match id,column,row"),
        ("id,column,row\na,1,2\na,3,4\n", r"m\.csv: point a appears twice"),
        ("id,column,row\nq,1,2\n", r"m\.csv: none of its ids is in .*s\.csv"),
    ],
)
def test_marks_that_are_refused(tmp_path, marks, message):
    with pytest.raises(SurveyError, match=message):
        load_control_points(
            write(tmp_path, "m.csv", marks), write(tmp_path, "s.csv", SURVEY), None
        )
