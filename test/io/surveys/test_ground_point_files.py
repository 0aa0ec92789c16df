"""Located points as files: what GeoJSON, KML and Cursor-on-Target readers find in them."""

from __future__ import annotations

import json
import math
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.ground.ground_point import Located, Refusal
from tirgeo_ros.io.surveys.ground_point_files import Answered, cot, geojson, kml

STAMP_NS = 1_634_731_235_605_555_556  # 2021-10-20, 12:00:35.605 UTC
PLACE = TangentPlane(math.radians(39.85), math.radians(116.7), 11.5)
#: 2 m and 0.5 m (one sigma), the longer towards 30 deg; 0.1 m up.
TURN = math.radians(30)
AXES = np.array([[math.cos(TURN), -math.sin(TURN)], [math.sin(TURN), math.cos(TURN)]])
COVARIANCE = np.zeros((3, 3))
COVARIANCE[:2, :2] = AXES @ np.diag([4.0, 0.25]) @ AXES.T
COVARIANCE[2, 2] = 0.01
FOUND = Located(
    STAMP_NS,
    (320.5, 256.25),
    np.zeros(3),
    COVARIANCE,
    PLACE.latitude_rad,
    PLACE.longitude_rad,
    PLACE.height_m,
)
REFUSED = Refusal(STAMP_NS + 5, (1.0, 2.0), Reason.ABOVE_HORIZON)
ANSWERS = [Answered("sheep <1> & \x07Ü", FOUND), Answered("cloud", REFUSED)]
SCALE_95 = math.sqrt(5.991464547)  # chi-square, two degrees of freedom
KML = "{http://www.opengis.net/kml/2.2}"


def test_geojson_points_in_order_and_then_ellipses():
    features = json.loads(geojson(ANSWERS))["features"]
    assert [(f["properties"]["kind"], f["properties"]["id"]) for f in features] == [
        ("point", ANSWERS[0].id),
        ("point", "cloud"),
        ("ellipse", ANSWERS[0].id),
    ]
    point = features[0]
    assert point["geometry"] == {"type": "Point", "coordinates": [116.7, 39.85, 11.5]}
    said = point["properties"]
    assert (said["stamp_ns"], said["u"], said["v"], said["reason"]) == (
        STAMP_NS,
        320.5,
        256.25,
        None,
    )
    assert said["ellipse_major_m"] == pytest.approx(2 * SCALE_95, abs=1e-4)
    assert said["ellipse_minor_m"] == pytest.approx(0.5 * SCALE_95, abs=1e-4)
    assert said["ellipse_azimuth_deg"] == pytest.approx(30, abs=1e-3)
    assert said["sigma_height_m"] == pytest.approx(0.1)
    assert said["sigma_north_m"] == pytest.approx(math.sqrt(COVARIANCE[0, 0]), abs=1e-4)


def test_a_refused_pixel_has_no_geometry_but_a_reason():
    refused = json.loads(geojson(ANSWERS))["features"][1]
    assert refused["geometry"] is None
    assert refused["properties"]["reason"] == "the pixel is above the horizon"
    assert refused["properties"]["stamp_ns"] == STAMP_NS + 5
    assert refused["properties"]["height_m"] is None


def test_the_polygon_is_the_ellipse():
    ring = json.loads(geojson(ANSWERS))["features"][2]["geometry"]["coordinates"][0]
    assert ring[0] == ring[-1]
    lon, lat = np.radians(np.array(ring)).T
    corners_n = PLACE.ned_from_geodetic(lat, lon, 11.5)[:-1, :2]
    squares = np.einsum("ni,ij,nj->n", corners_n, np.linalg.inv(COVARIANCE[:2, :2]), corners_n)
    # nine decimals of a degree are 0.1 mm, of 1.2 m at the least
    np.testing.assert_allclose(squares, 5.991464547, rtol=5e-4)
    lengths = np.hypot(*corners_n.T)
    north, east = corners_n[np.argmax(lengths)]
    assert math.degrees(math.atan2(east, north)) % 180 == pytest.approx(30, abs=0.1)
    # anticlockwise on a map, east to the right (RFC 7946): the area from x = east, y = north
    area = np.sum(
        corners_n[:, 1] * np.roll(corners_n[:, 0], -1)
        - corners_n[:, 0] * np.roll(corners_n[:, 1], -1)
    )
    assert area > 0


def test_kml_holds_points_ellipses_and_reasons():
    document = ET.fromstring(kml(ANSWERS))[0]
    first, second = document.findall(f"{KML}Placemark")
    assert first.find(f"{KML}name").text == "sheep <1> & Ü"  # no XML holds a bell
    assert first.find(f".//{KML}Point/{KML}coordinates").text == "116.700000000,39.850000000"
    assert len(first.find(f".//{KML}LinearRing/{KML}coordinates").text.split()) == 61
    values = {d.get("name"): d.find(f"{KML}value").text for d in first.iter(f"{KML}Data")}
    assert values["height_m"] == "11.5"
    assert first.find(f".//{KML}when").text == "2021-10-20T12:00:35.605Z"
    assert "above the horizon" in second.find(f"{KML}description").text
    assert second.find(f".//{KML}Point") is None


def test_cursor_on_target_events():
    events = list(ET.fromstring(cot(ANSWERS)).iter("event"))
    assert len(events) == 1
    event = events[0].attrib
    assert event["uid"].endswith(str(STAMP_NS))
    assert (event["version"], event["type"], event["how"]) == ("2.0", "a-u-G", "m-f")
    assert event["time"] == event["start"] == "2021-10-20T12:00:35.605Z"
    assert event["stale"] == "2021-10-21T12:00:35.605Z"
    point = {key: float(value) for key, value in events[0].find("point").attrib.items()}
    assert point == {"lat": 39.85, "lon": 116.7, "hae": 11.5, "ce": 2.0, "le": 0.1}
