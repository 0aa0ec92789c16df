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
"""Clicks are located with the picture and the pose that were clicked on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import camera_pose

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig, PictureConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.ground.ground_point import Located, Refusal
from tirgeo_ros.core.overlay.clicks import (
    MARKER_S,
    MARKERS,
    REMEMBERED_S,
    TEMPERATURE_SCALE,
    Clicks,
    Marker,
    PlacedMarkers,
    marker_shapes,
    thermal_of,
)
from tirgeo_ros.core.overlay.map_renderer import LineRenderer
from tirgeo_ros.core.targets.target import Target

PLANE = TangentPlane(0.6955, 2.0368, 30.0)
S = 1_000_000_000


def pose_over(north_m):
    return camera_pose([north_m, 0.0, -50.0], covariance=1e-4)


@pytest.fixture
def clicks():
    """Three pictures, a second and ten metres apart."""
    shown = Clicks(ConfidenceConfig())
    shown.set_plane(PLANE)
    shown.ground = 30.0
    for k in range(1, 4):
        shown.show(k * S, XT2, pose_over(10.0 * k))
    return shown


CENTRE = (XT2.cx, XT2.cy)


@pytest.mark.parametrize(("stamp_ns", "north_m"), [(S, 10), (2 * S, 20), (3 * S, 30), (0, 30)])
def test_the_pose_of_the_pictures_own_stamp_is_used(clicks, stamp_ns, north_m):
    answer = clicks.locate(CENTRE, stamp_ns)
    assert isinstance(answer, Located)
    assert answer.stamp_ns == (stamp_ns or 3 * S)
    np.testing.assert_allclose(answer.point_n, [north_m, 0, 0], atol=1e-3)
    assert clicks.counts == {"located": 1}


@pytest.mark.parametrize(
    ("stamp_ns", "reason"),
    [
        (S - 1, Reason.TOO_OLD),
        (2 * S + 1, Reason.UNKNOWN_PICTURE),
        (4 * S, Reason.UNKNOWN_PICTURE),
    ],
)
def test_a_stamp_that_was_not_shown_is_refused(clicks, stamp_ns, reason):
    answer = clicks.locate(CENTRE, stamp_ns)
    assert isinstance(answer, Refusal)
    assert (answer.reason, answer.stamp_ns) == (reason, stamp_ns)
    assert clicks.counts == {f"refused_{reason.name.lower()}": 1}
    assert clicks.markers() == []


def test_pictures_are_forgotten_in_time(clicks):
    late_ns = 2 * S + round(REMEMBERED_S * 1e9)
    clicks.show(late_ns, XT2, pose_over(0.0))
    assert clicks.locate(CENTRE, S).reason is Reason.TOO_OLD
    assert isinstance(clicks.locate(CENTRE, 2 * S), Located)


def test_a_click_needs_pose_plane_and_ground():
    clicks = Clicks(ConfidenceConfig())
    assert clicks.locate(CENTRE).reason is Reason.NO_PICTURE
    clicks.set_plane(PLANE)
    clicks.show(S, XT2, None)
    assert clicks.locate(CENTRE).reason is Reason.NO_POSE
    clicks.show(2 * S, XT2, pose_over(0.0))
    assert clicks.locate(CENTRE).reason is Reason.NO_GROUND
    clicks.ground = math.nan
    assert clicks.locate(CENTRE).reason is Reason.NO_GROUND
    clicks.ground = 31.0
    assert clicks.locate((700.0, 3.0)).reason is Reason.OUTSIDE_PICTURE
    assert isinstance(clicks.locate(CENTRE), Located)
    clicks.ground = None
    assert clicks.locate(CENTRE).reason is Reason.NO_GROUND


def test_marks_stay_for_a_time_and_a_number(clicks):
    answer = clicks.locate(CENTRE, S)
    (mark,) = clicks.markers()
    assert mark.label == answer.label
    np.testing.assert_array_equal(mark.point_n, answer.point_n)
    clicks.show(S + round(MARKER_S * 1e9), XT2, None)
    assert len(clicks.markers()) == 1
    clicks.show(S + round(MARKER_S * 1e9) + 1, XT2, pose_over(5.0))
    assert clicks.markers() == []
    for _ in range(MARKERS + 3):
        clicks.locate(CENTRE)
    assert len(clicks.markers()) == MARKERS


def test_another_plane_forgets_pictures_and_moves_marks(clicks):
    before = clicks.locate(CENTRE, S)
    other = TangentPlane(0.6955 + 1e-6, 2.0368, 25.0)
    clicks.set_plane(other)
    assert clicks.locate(CENTRE, S).reason is Reason.NO_PICTURE
    (mark,) = clicks.markers()
    expected = other.ned_from_geodetic(
        *(float(x) for x in PLANE.geodetic_from_ned(before.point_n))
    )
    np.testing.assert_allclose(mark.point_n, expected, atol=1e-6)
    clicks.show(9 * S, XT2, pose_over(0.0))
    clicks.set_plane(TangentPlane(other.latitude_rad, other.longitude_rad, other.height_m))
    assert isinstance(clicks.locate(CENTRE), Located)  # the same plane, set again


def test_a_click_has_the_temperature_of_its_own_picture(clicks):
    scale = PictureConfig(celsius_per_count=0.04)
    for stamp_ns, count in ((S, 8000), (2 * S, 8025)):
        clicks.show_thermal(stamp_ns, thermal_of(np.full((2, 2), count, np.uint16), scale))
    assert clicks.locate(CENTRE, S).temperature_c == pytest.approx(8000 * 0.04 - 273.15)
    assert clicks.locate(CENTRE, 2 * S).temperature_c == pytest.approx(8025 * 0.04 - 273.15)
    assert math.isnan(clicks.locate(CENTRE, 3 * S).temperature_c)


def test_temperatures_of_another_size_than_the_picture():
    thermal = thermal_of(np.array([[14_000, 0], [0, 15_000]], np.uint16), TEMPERATURE_SCALE)
    assert thermal.celsius((319.4, 255.4), CAMERA) == pytest.approx(6.85)
    assert thermal.celsius((319.6, 255.6), CAMERA) == pytest.approx(26.85)
    outside = (639.6, 10.0), (-0.6, 10.0)
    assert all(math.isnan(thermal.celsius(uv, CAMERA)) for uv in ((320.0, 1.0), *outside))
    assert thermal_of(np.zeros((2, 2), np.uint8), TEMPERATURE_SCALE) is None


CAMERA = Camera(640, 512, 800.0, 800.0, 319.5, 255.5)
HEIGHT_M = 20.0  # 40 px to a metre, straight down
POSE = camera_pose([0.0, 0.0, -HEIGHT_M], covariance=1e-6)


@pytest.mark.parametrize("sigma_m", [0.3, 1.0, 2.0])
def test_the_ellipse_holds_95_percent(sigma_m):
    image = np.full((512, 640, 3), 128, np.uint8)
    marker = Marker(np.zeros(3), "x", np.diag([sigma_m**2, sigma_m**2, 0.0]))
    placed = PlacedMarkers(image, marker_shapes(CAMERA, POSE, [marker]))
    placed.paint(image, LineRenderer())
    for box in placed.boxes:
        image[box.top : box.bottom, box.left : box.right] = 128
    v, u = np.nonzero((image != 128).any(axis=2))
    # 2 px of ink and 1 px of halo on each side, both anti-aliased
    reach_px = np.hypot(u - 319.5, v - 255.5).max()
    assert reach_px == pytest.approx(2.4477 * sigma_m * 40, abs=4)


def target_at(*place):
    """A target at a place: latitude, longitude (deg), height (m)."""
    clicks = (Located(S, *place, (1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0)),)
    return Target("0" * 32, 1, "", "fire", "", "", S, S, clicks)


def test_targets_take_the_place_of_clicks_and_stay_in_another_plane(clicks):
    answer = clicks.locate(CENTRE, S)
    place = answer.latitude_rad, answer.longitude_rad, answer.height_m
    clicks.set_targets([target_at(answer.latitude_deg, answer.longitude_deg, answer.height_m)])
    (marker,) = clicks.markers()
    assert marker.label == "1 fire"
    np.testing.assert_allclose(marker.point_n, answer.point_n, atol=1e-6)
    moved = TangentPlane(PLANE.latitude_rad + 1e-6, PLANE.longitude_rad, PLANE.height_m)
    clicks.set_plane(moved)
    (marker,) = clicks.markers()
    np.testing.assert_allclose(marker.point_n, moved.ned_from_geodetic(*place), atol=1e-6)
    # A target stays, however long ago its picture was.
    clicks.show(10**12 * S, XT2, pose_over(0.0))
    assert len(clicks.markers()) == 1
    clicks.set_targets([])
    assert clicks.markers() == []


def test_targets_wait_for_the_plane():
    clicks = Clicks(ConfidenceConfig())
    clicks.set_targets([target_at(39.85, 116.7, 30.0)])
    assert clicks.markers() == []
    clicks.set_plane(PLANE)
    assert [marker.label for marker in clicks.markers()] == ["1 fire"]
