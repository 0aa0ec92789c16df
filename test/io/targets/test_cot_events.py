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
"""Targets, an aircraft and its camera as Cursor-on-Target: by numbers and by projecting."""

from __future__ import annotations

import dataclasses
import math
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import (
    BODY_OPTICAL,
    matrix_from_euler,
    matrix_from_quat,
    quat_from_matrix,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.frame_geometry import Sight, frame_geometry
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.targets.cot_events import (
    UNKNOWN,
    AircraftState,
    aircraft_event,
    deletion_event,
    encoded,
    looks_at_event,
    target_event,
    withdrawn_event,
)

SEEN_NS = 1_634_731_235_605_555_556  # 2021-10-20, 12:00:35.605 UTC
NOW_NS = SEEN_NS + 60_000_000_000
#: 2 m in each level direction and 0.5 m up, one standard deviation.
ROUND = (4.0, 0, 0, 0, 4.0, 0, 0, 0, 0.25)
CLICK = Located(SEEN_NS, 48.20817425, -16.37381885, 211.25, ROUND)
TARGET = Target("0123456789abcdef" * 2, 7, "", "fire", "", "", SEEN_NS, SEEN_NS, (CLICK,))
HOSTILE = "</remarks><__forcedelete/> \"'&<![CDATA[ ]]> \x00\x07\ud800\u202e\nnext line"
PLANE = TangentPlane(math.radians(48.2), math.radians(16.37), 200.0)
UP_M = 150.0
#: Focal lengths alike and the principal point in the middle: the axis is the middle's ray.
PLAIN = Camera(640, 512, 800.0, 800.0, 319.5, 255.5)
STATE = AircraftState("uav1", 48.2, 16.37, 350.0, 0.05, 0.08, 359.9999, 4.5)


def parsed(event):
    return ET.fromstring(encoded(event))


def test_a_target_is_a_spot_with_place_errors_and_colour():
    data = encoded(target_event(TARGET, NOW_NS))
    assert data.startswith(b'<?xml version="1.0" encoding="UTF-8"?>\n<event ')
    assert data.endswith(b"</event>")
    event = ET.fromstring(data)
    assert event.attrib == {
        "version": "2.0",
        "uid": "tirgeo-" + TARGET.id,
        "type": "b-m-p-s-m",
        "how": "m-i",
        "time": "2021-10-20T12:01:35.605Z",
        "start": "2021-10-20T12:01:35.605Z",
        "stale": "2021-10-21T12:01:35.605Z",
    }
    point = event.find("point").attrib
    assert (point["lat"], point["lon"], point["hae"]) == ("48.2081742", "-16.3738188", "211.250")
    # CE90 of a circular normal distribution is sqrt(-2 ln 0.1) sigma, LE90 1.6449 sigma.
    assert float(point["ce"]) == pytest.approx(2 * math.sqrt(-2 * math.log(0.1)), abs=1e-3)
    assert float(point["le"]) == pytest.approx(0.5 * 1.644854, abs=1e-3)
    assert event.find("detail/contact").get("callsign") == "7 fire"
    assert event.find("detail/color").get("argb") == "-35072"
    icon = event.find("detail/usericon").get("iconsetpath")
    assert icon == "COT_MAPPING_SPOTMAP/b-m-p-s-m/-35072"
    assert event.find("detail/archive") is not None
    remarks = event.find("detail/remarks").text
    assert remarks.startswith("fire; seen 2021-10-20T12:00:35.605Z; 90 % within 4.3 m")
    assert "CE90" in remarks
    assert "LE90" in remarks


def test_remarks_have_name_note_and_clicks():
    clicks = (CLICK, dataclasses.replace(CLICK, latitude_deg=48.21, stamp_ns=SEEN_NS + 10**9))
    words = {"name": "roof", "note": "two floors", "aircraft": "uav1", "status": "checked"}
    event = parsed(target_event(dataclasses.replace(TARGET, clicks=clicks, **words), NOW_NS))
    assert event.find("detail/contact").get("callsign") == "7 roof"
    remarks = event.find("detail/remarks").text
    for text in ("fire; checked; two floors", "by uav1", "2 clicks", "the clicks disagree"):
        assert text in remarks


def test_hostile_text_stays_text():
    event = parsed(
        target_event(dataclasses.replace(TARGET, name=HOSTILE, note=HOSTILE + "x" * 9000), NOW_NS)
    )
    harmless = "</remarks><__forcedelete/> \"'&<![CDATA[ ]]> next line"
    assert event.find("detail/contact").get("callsign") == "7 " + harmless
    remarks = event.find("detail/remarks").text
    assert harmless in remarks
    assert "CE90" in remarks  # a long note does not push it out
    assert event.find(".//__forcedelete") is None
    assert len(encoded(target_event(dataclasses.replace(TARGET, note='"' * 9000), 0))) < 65507


def test_a_deletion_names_the_target_and_a_withdrawn_one_is_soon_stale():
    event = parsed(deletion_event(TARGET, NOW_NS))
    assert event.get("type") == "t-x-d-d"
    assert event.get("uid") not in {"", "tirgeo-" + TARGET.id}
    link = event.find("detail/link").attrib
    assert link == {"uid": "tirgeo-" + TARGET.id, "relation": "none", "type": "none"}
    assert event.find("detail/__forcedelete") is not None
    assert set(event.find("point").attrib) == {"lat", "lon", "hae", "ce", "le"}
    withdrawn = withdrawn_event(TARGET, NOW_NS)
    assert withdrawn.get("uid") == "tirgeo-" + TARGET.id
    assert withdrawn.get("stale") == "2021-10-20T12:01:40.605Z"


def looking(rotation_nb, camera=PLAIN, ground=200.0):
    """Return the geometry of a picture taken above the plane's origin; body axes of the camera."""
    q_nc = quat_from_matrix(rotation_nb @ BODY_OPTICAL)
    pose = CameraPose(SEEN_NS, np.array([0, 0, -UP_M]), q_nc, np.diag([0.01] * 3 + [1e-6] * 3))
    return frame_geometry(Sight(camera, pose, PLANE, ground), ConfidenceConfig()), pose


def degrees(roll, pitch, yaw):
    return matrix_from_euler(*np.radians([roll, pitch, yaw]))


def events(view):
    state = dataclasses.replace(STATE, view=view)
    looks_at = looks_at_event("drone", state, SEEN_NS)
    aircraft = parsed(aircraft_event("drone", state, SEEN_NS))
    return aircraft, None if looks_at is None else parsed(looks_at)


def numbers(element):
    return {key: float(text) for key, text in element.attrib.items()}


@pytest.mark.parametrize("attitude", [(12, -35, 200), (-5, -89.5, 10), (4, -60, 359.99996)])
def test_the_angles_lead_back_to_the_pixels(attitude):
    view, pose = looking(degrees(*attitude), XT2)
    aircraft, _ = events(view)
    cells = numbers(aircraft.find("detail/sensor"))
    assert 0 <= cells["azimuth"] < 360
    turn = degrees(cells["roll"], cells["elevation"], cells["azimuth"])
    points_n = pose.position_n + 100 * turn.T[:2]  # forward; right of the camera
    middle, valid = XT2.project((points_n - pose.position_n) @ matrix_from_quat(pose.q_nc))
    assert valid[0]
    # 0.0005 deg of rounding in each angle are 0.007 px; three of them
    np.testing.assert_allclose(middle[0], [319.5, 255.5], atol=0.03)
    edges = XT2.rays(np.array([[-0.5, 255.5], [639.5, 255.5], [319.5, -0.5], [319.5, 511.5]]))
    edges = edges @ matrix_from_quat(pose.q_nc).T @ turn  # forward, right, down of the angles
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    assert cells["fov"] == pytest.approx(math.degrees(math.acos(edges[0] @ edges[1])), abs=6e-4)
    assert cells["vfov"] == pytest.approx(math.degrees(math.acos(edges[2] @ edges[3])), abs=6e-4)
    assert edges[1, 1] > 0 > edges[0, 1]
    assert edges[1, 2] == pytest.approx(edges[0, 2], abs=3e-5)  # the row is level in them


def test_the_point_of_interest_is_the_pictures_middle_and_the_fan_ends_there():
    view, pose = looking(degrees(4, -40, 130), XT2)
    aircraft, looks_at = events(view)
    assert looks_at.get("type") == "b-m-p-s-p-i"
    link = looks_at.find("detail/link").attrib
    assert link == {"uid": "drone", "type": "a-f-A-M-H-Q", "relation": "p-p"}
    point = numbers(looks_at.find("point"))
    assert point["hae"] == pytest.approx(200.0, abs=1e-3)
    assert point["ce"] == pytest.approx(view.ce90_m, abs=1e-3)
    at_n = PLANE.ned_from_geodetic(math.radians(point["lat"]), math.radians(point["lon"]), 200.0)
    uv, _ = XT2.project([(at_n - pose.position_n) @ matrix_from_quat(pose.q_nc)])
    # the seventh decimal of a degree is 1 cm, of 233 m at 800 px
    np.testing.assert_allclose(uv[0], [319.5, 255.5], atol=0.06)
    reach = float(aircraft.find("detail/sensor").get("range"))
    assert reach == pytest.approx(math.hypot(*at_n[:2]), abs=0.02)


def test_an_aircraft_has_place_motion_and_name():
    aircraft, _ = events(None)
    assert (aircraft.get("type"), aircraft.get("how")) == ("a-f-A-M-H-Q", "m-f")
    point = aircraft.find("point").attrib
    assert point == {
        "lat": "48.2000000",
        "lon": "16.3700000",
        "hae": "350.000",
        "ce": "0.050",
        "le": "0.080",
    }
    assert aircraft.find("detail/track").attrib == {"course": "0.000", "speed": "4.500"}
    assert aircraft.find("detail/contact").get("callsign") == "uav1"
    assert aircraft.get("stale") == "2021-10-20T12:01:05.605Z"


def test_unknown_values_are_left_out_and_never_nan():
    above_horizon, _ = looking(degrees(0, 20, 0))
    state = AircraftState("uav1", 48.2, 16.37, 350.0, view=above_horizon)
    text = encoded(aircraft_event("drone", state, SEEN_NS)).decode()
    event = ET.fromstring(text)
    assert event.find("point").get("ce") == event.find("point").get("le") == UNKNOWN
    assert event.find("detail/track") is None
    sensor = event.find("detail/sensor")
    assert "range" not in sensor.attrib  # so that no fan is drawn
    assert float(sensor.get("elevation")) == pytest.approx(20, abs=1e-3)
    assert "nan" not in text.lower()
    assert looks_at_event("drone", state, SEEN_NS) is None
    assert events(None)[1] is None
