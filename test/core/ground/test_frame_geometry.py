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
"""What a picture shows from where: angles by trigonometry, places and outlines by OpenCV."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
import pytest
from coded_frames import GROUND_M, terrain_of
from hypothesis import given, strategies as st
from numpy.testing import assert_allclose
from scenes import PLANE, camera_pose

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import (
    BODY_OPTICAL,
    Q_BODY_OPTICAL,
    matrix_from_euler,
    matrix_from_quat,
    matrix_from_rotvec,
    quat_from_euler,
    quat_multiply,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic, rotation_ecef_from_ned
from tirgeo_ros.core.ground.frame_geometry import (
    Sight,
    body_rpy,
    camera_place,
    footprint,
    frame_geometry,
    height_above_m,
)
from tirgeo_ros.core.ground.ground_point import Located, circular_error_90, linear_error_90, place
from tirgeo_ros.core.types.poses import BodyPose, CameraPose

CONFIG = ConfidenceConfig()
MIDDLE = Camera(640, 512, 800.0, 800.0, 319.5, 255.5)
SIGMA2 = 1e-6
ABOVE_M = 50.0


def sight_of(body_deg, sensor_deg, camera=MIDDLE, plane=PLANE, north_m=0.0, ground=None):
    """A sight from ABOVE_M over the ground; angles in degrees are (roll, pitch, yaw)."""
    q_nb = quat_from_euler(*np.radians(body_deg))
    q_ng = quat_multiply(q_nb, quat_from_euler(*np.radians(sensor_deg)))
    position_n = np.array([north_m, 0.0, -ABOVE_M])
    covariance = SIGMA2 * np.eye(6)
    pose = CameraPose(7, position_n, quat_multiply(q_ng, Q_BODY_OPTICAL), covariance)
    body = BodyPose(7, position_n, q_nb, covariance)
    return Sight(camera, pose, plane, plane.height_m if ground is None else ground, body)


def axes_n(geometry):
    """The sensor's axes (columns) in those of the place; the first is the line of sight."""
    return matrix_from_euler(*geometry.platform_rpy) @ matrix_from_euler(*geometry.sensor_rpy)


@pytest.mark.parametrize(
    ("body_deg", "sensor_deg", "azimuth", "elevation"),
    [
        ((0, 0, 45), (0, -30, 90), 135.0, -30.0),
        ((3, 5, 45), (0, -30, 90), 131.7605, -32.8585),
        ((3, 5, 45), (0, -30, 0), 43.3460, -24.9569),
    ],
)
def test_the_standard_s_order_of_angles(body_deg, sensor_deg, azimuth, elevation):
    geometry = frame_geometry(sight_of(body_deg, sensor_deg), CONFIG)
    assert_allclose(np.degrees(geometry.platform_rpy), body_deg, atol=1e-9)
    assert_allclose(np.degrees(geometry.sensor_rpy), sensor_deg, atol=1e-9)
    north, east, down = axes_n(geometry)[:, 0]
    assert math.degrees(math.atan2(east, north)) == pytest.approx(azimuth, abs=1e-4)
    assert -math.degrees(math.asin(down)) == pytest.approx(elevation, abs=1e-4)


@given(
    st.sampled_from([-90.0, -89.9999, -33.0, 0.0, 47.0, 90.0]),
    st.sampled_from([-180.0, -179.9999, 16.0, 180.0]),
    st.floats(-180, 180),
    st.floats(-90, -20),
    st.floats(-180, 180),
    st.floats(-30, 30),
    st.floats(-5000, 5000),
)
def test_angles_point_from_the_camera_to_the_centre(lat, lon, yaw, pitch, heading, tilt, north):
    """Anywhere on the earth, with a lens whose axis is not the picture's middle."""
    plane = TangentPlane(math.radians(lat), math.radians(lon), 0.0)
    # Composed in the plane, so far from its origin the angles there are others.
    pose = camera_pose([north, 0.0, -200.0], tilt / 3, pitch, yaw, SIGMA2)
    q_nb = quat_from_euler(*np.radians([tilt, -tilt, heading]))
    body = BodyPose(0, pose.position_n, q_nb, pose.covariance)
    geometry = frame_geometry(Sight(XT2, pose, plane, -30.0, body), CONFIG)
    if not math.isfinite(geometry.slant_range_m):
        assert pitch > -35
        return
    camera_e, centre_e = (ecef_from_geodetic(*p) for p in (geometry.sensor, geometry.centre))
    rotation_en = rotation_ecef_from_ned(*geometry.sensor[:2])
    to_centre_n = (centre_e - camera_e) @ rotation_en
    assert np.linalg.norm(to_centre_n) == pytest.approx(geometry.slant_range_m, abs=1e-6)
    # 1e-8 m of coordinates over 100 m and more.
    assert_allclose(to_centre_n / geometry.slant_range_m, axes_n(geometry)[:, 0], atol=1e-9)


@given(st.floats(-180, 180), st.floats(-90, -35), st.floats(-10, 10))
def test_corners_are_those_of_the_footprint(yaw, pitch, roll):
    pose = camera_pose([30.0, -20.0, -ABOVE_M], roll, pitch, yaw, SIGMA2)
    geometry = frame_geometry(Sight(XT2, pose, PLANE, PLANE.height_m), CONFIG)
    outline_n = footprint(XT2, pose, PLANE, PLANE.height_m, 1e9)
    latitudes, longitudes, _ = PLANE.geodetic_from_ned(outline_n[::8])
    assert_allclose(geometry.corners, np.stack([latitudes, longitudes], 1), rtol=0, atol=1e-15)


def test_fields_of_view_and_width_by_trigonometry():
    geometry = frame_geometry(sight_of((0, 0, 10), (0, -90, 0)), CONFIG)
    expected = [2 * math.atan(half / 800.0) for half in (320, 256)]
    assert_allclose(geometry.fields_of_view, expected, rtol=1e-12)
    assert geometry.slant_range_m == pytest.approx(ABOVE_M, abs=1e-6)
    assert geometry.width_m == pytest.approx(ABOVE_M * 640 / 800, rel=1e-5)  # the earth is round


def test_the_lens_does_not_turn_the_picture():
    """With the axis off the middle, roll is that of the picture's own rows."""
    sight = sight_of((0, 0, 30), (12, -60, 5), XT2)
    geometry = frame_geometry(sight, CONFIG)
    left, right = XT2.rays(np.array([[-0.5, 255.5], [639.5, 255.5]]))
    row_n = matrix_from_quat(sight.pose.q_nc) @ (right - left)
    down = axes_n(geometry)[:, 2] @ row_n / np.linalg.norm(row_n)
    assert down == pytest.approx(0.0, abs=1e-12)


def test_target_error_is_that_of_a_click():
    sight = sight_of((0, 0, 0), (0, -50, 20), XT2)
    geometry = frame_geometry(sight, CONFIG)
    click = place(XT2, sight.pose, (319.5, 255.5), PLANE, PLANE.height_m, CONFIG)
    assert isinstance(click, Located)
    assert geometry.centre == (click.latitude_rad, click.longitude_rad, click.height_m)
    assert geometry.ce90_m == circular_error_90(click.covariance_n)
    assert geometry.le90_m == linear_error_90(click.covariance_n)
    assert 0.1 < geometry.ce90_m < 1.0


@pytest.mark.parametrize(
    ("sensor_deg", "ground", "finite"),
    [
        ((0, -45, 0), None, (True, True)),
        ((0, -15, 0), None, (True, False)),  # the upper corners are above the horizon
        ((0, 10, 0), None, (False, False)),
        ((0, -0.2, 0), None, (False, False)),  # too flat for a click
        ((0, -45, 0), math.nan, (False, False)),
        ((0, -45, 0), 9000.0, (False, False)),
    ],
)
def test_unknown_values_are_nan(sensor_deg, ground, finite):
    geometry = frame_geometry(sight_of((0, 0, 0), sensor_deg, ground=ground), CONFIG)
    numbers = (*geometry.centre, geometry.slant_range_m, geometry.ce90_m, geometry.le90_m)
    assert set(np.isfinite(numbers)) == {finite[0]}
    assert set(np.isfinite(geometry.corners).ravel()) == {finite[1]}
    assert np.isfinite([*geometry.sensor, *geometry.sensor_rpy]).all()


def test_without_the_aircraft_s_attitude_no_angles():
    sight = sight_of((0, 0, 0), (0, -45, 0))._replace(body=None)
    geometry = frame_geometry(sight, CONFIG)
    assert np.isnan([*geometry.platform_rpy, *geometry.sensor_rpy]).all()
    assert np.isfinite(geometry.corners).all()


COVARIANCE = np.diag([0.01, 0.02, 0.03, 0.002, 0.003, 0.004]) ** 2
DOWN = camera_pose([0.0, 0, 0])
angles = st.tuples(st.floats(-180, 180), st.floats(-90, 90), st.floats(-180, 180))


def place_at(attitude_deg, position_n=(0.0, 0, 0), plane=PLANE):
    return camera_place(camera_pose(position_n, *attitude_deg, COVARIANCE), plane)


@given(angles)
def test_both_sets_of_angles_give_the_attitude(attitude_deg):
    place = place_at(attitude_deg)
    assert_allclose(matrix_from_euler(*place.rpy) @ BODY_OPTICAL, place.rotation_lc, atol=1e-12)
    # Right in the picture is right of the nose, down is its back, forward is down.
    axes_l = matrix_from_euler(*place.mapping_rpy)
    as_optical = np.stack([axes_l[:, 1], -axes_l[:, 0], axes_l[:, 2]], axis=1)
    assert_allclose(as_optical, place.rotation_lc, atol=1e-12)


def test_angles_are_against_north_at_the_camera_not_at_the_origin():
    """75 km east of the origin, north has turned by the meridians' convergence."""
    plane = TangentPlane(math.radians(48.0), math.radians(16.0), 0.0)
    where = math.radians(48.0), math.radians(17.0), 500.0
    position_n = plane.ned_from_geodetic(*where)
    place = place_at((0, -90, 0), position_n, plane)
    # True north there points to the west of the plane's, by the longitude times sin(latitude).
    convergence = math.radians(1) * math.sin(where[0])
    assert place.mapping_rpy[2] == pytest.approx(convergence, abs=2e-5)
    assert_allclose([place.latitude_rad, place.longitude_rad], where[:2], atol=1e-12)
    assert place.height_m == pytest.approx(500, abs=1e-6)
    body = BodyPose(0, position_n, np.array([1.0, 0, 0, 0]), COVARIANCE)
    assert body_rpy(body, plane)[2] == pytest.approx(convergence, abs=2e-5)
    turn = plane.rotation_from_local(*where[:2])
    expected = np.sqrt(np.diag(turn.T @ COVARIANCE[:3, :3] @ turn))
    assert_allclose(place.position_sigmas_m, expected)
    assert_allclose(turn @ place.rotation_lc, matrix_from_quat(DOWN.q_nc), atol=1e-15)


def test_accuracies_are_the_spread_of_the_angles():
    """The sigmas against those of angles of attitudes that are turned by random errors."""
    place = place_at((8.0, -50.0, 130.0))
    spreads = place.covariance_l[3:, 3:]
    errors = np.random.default_rng(3).multivariate_normal(np.zeros(3), spreads, 4000)
    turned = [
        dataclasses.replace(place, rotation_lc=matrix_from_rotvec(item) @ place.rotation_lc)
        for item in errors
    ]
    spread = np.std([item.mapping_rpy for item in turned], axis=0)
    # The standard deviation of 4000 samples is good to 1.1 %: four times that.
    assert_allclose(place.mapping_sigmas_rad, spread, rtol=0.045)


def test_a_level_camera_has_no_accuracy_of_yaw_and_roll_apart():
    assert np.isnan(place_at((0, 0, 0)).mapping_sigmas_rad).all()


def test_heights_are_above_the_sea_and_the_ground_where_these_are_known():
    place = place_at((0, 0, 0), (0, 0, -30.0))
    assert place.altitude_m(math.nan) == place.height_m
    assert place.altitude_m(-9.0) == pytest.approx(41.5 + 9.0)
    # Without a ground there is no height above it.
    assert math.isnan(height_above_m(camera_pose([0, 0, -30.0]), PLANE, None))
    assert height_above_m(camera_pose([0, 0, -30.0]), PLANE, 1.5) == pytest.approx(40.0)


def hills(north_m, east_m):
    """At most 8 / 70^2 of curvature: bilinear cells of 2 m are off by half of that, 0.8 mm."""
    return 8.0 * np.sin(north_m / 70.0) * np.cos(east_m / 90.0)


def rays_n(camera, pose, uv):
    """Unit rays (N, 3) through pixels, NED, by OpenCV."""
    flat = cv2.undistortPoints(
        np.array(uv, float)[:, None], camera.matrix, np.array(camera.distortion)
    )
    rays = np.column_stack([flat[:, 0], np.ones(len(uv))]) @ matrix_from_quat(pose.q_nc).T
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def pixels_of(camera, pose, points_n):
    points_c = (points_n - pose.position_n) @ matrix_from_quat(pose.q_nc)
    distortion = np.array(camera.distortion or (0.0, 0.0, 0.0, 0.0))
    return cv2.projectPoints(points_c, np.zeros(3), np.zeros(3), camera.matrix, distortion)[0][
        :, 0
    ]


def off_border_px(camera, uv):
    """Distance of pixels within the picture to its border; negative outside."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    u, v = uv.T
    return np.min([u + 0.5, right - u, v + 0.5, bottom - v], axis=0)


@pytest.mark.parametrize(
    "pose", [camera_pose([5, -7, -60.0]), camera_pose([0, 0, -60.0], 3, -50, 70)]
)
def test_corners_are_where_trigonometry_has_them(pose):
    outline_n = footprint(XT2, pose, PLANE, GROUND_M, 1e4)
    corners = [[-0.5, -0.5], [639.5, -0.5], [639.5, 511.5], [-0.5, 511.5]]
    rays = rays_n(XT2, pose, corners)
    wanted_n = pose.position_n + (60.0 / rays[:, 2:]) * rays
    # The Earth bends away by (130 m)^2 / 2 R = 1.3 mm, and OpenCV ends its search a little early.
    assert_allclose(outline_n[:: len(outline_n) // 4], wanted_n, atol=5e-3)
    assert np.abs(off_border_px(XT2, pixels_of(XT2, pose, outline_n))).max() < 1e-6


def test_it_is_cut_where_lines_end():
    """With the horizon in the picture, and tilted: left and right edge end at the same depth."""
    pose, far_m = camera_pose([0, 0, -100.0], 10.0, -5.0, 30.0), 2000.0
    outline_n = footprint(MIDDLE, pose, PLANE, GROUND_M, far_m)
    ahead_m = (outline_n - pose.position_n) @ matrix_from_quat(pose.q_nc)[:, 2]
    assert ahead_m.max() <= far_m
    far = np.flatnonzero(ahead_m > 0.9 * far_m)
    assert len(far) == 2
    # To a 256th of 64 or 80 px, of the 40 px between this depth and the horizon.
    assert_allclose(ahead_m[far], far_m, rtol=0.01)
    assert (far[1] - far[0]) % len(outline_n) in (1, len(outline_n) - 1)  # joined by a line
    uv = pixels_of(MIDDLE, pose, outline_n)
    assert np.abs(off_border_px(MIDDLE, uv)).max() < 1e-6
    for corner in ([639.5, 511.5], [-0.5, 511.5]):
        assert np.abs(uv - corner).sum(axis=1).min() < 1e-6


@pytest.mark.parametrize(
    ("pose", "far_m"),
    [
        (camera_pose([0, 0, -100.0], 0.0, 40.0), 1e4),  # into the sky
        (camera_pose([0, 0, 5.0]), 1e4),  # below the ground
        (camera_pose([0, 0, -100.0]), 50.0),  # all of it is too far
    ],
)
def test_where_no_ground_is_seen_it_is_empty(pose, far_m):
    assert footprint(MIDDLE, pose, PLANE, GROUND_M, far_m).shape == (0, 3)


def test_on_an_elevation_model_it_lies_on_the_hills():
    pose = camera_pose([0, 0, -100.0], 0.0, -60.0, 20.0)
    outline_n = footprint(XT2, pose, PLANE, terrain_of(hills), 1e4)
    _, _, height = PLANE.geodetic_from_ned(outline_n)
    assert_allclose(height, GROUND_M + hills(*outline_n.T[:2]), atol=2e-3)  # of bilinear cells
    assert np.ptp(height) > 5.0
    assert np.abs(off_border_px(XT2, pixels_of(XT2, pose, outline_n))).max() < 1e-6


def test_it_ends_at_the_edge_of_an_elevation_model():
    """Looking north over the edge, a hundred steps of 2e-5 deg away."""
    edge_m = math.radians(2e-3) * 6.361e6
    pose = camera_pose([edge_m - 70.0, 0, -100.0], 0.0, -45.0)
    terrain = terrain_of(lambda north, _: 0 * north)
    outline_n = footprint(MIDDLE, pose, PLANE, terrain, 1e4)
    assert np.isfinite(outline_n).all()
    open_n = footprint(MIDDLE, pose, PLANE, GROUND_M, 1e4)
    assert open_n[:, 0].max() > edge_m + 40.0
    assert outline_n[:, 0].max() == pytest.approx(edge_m, abs=0.3)  # a 256th of 64 px spans 6 cm
