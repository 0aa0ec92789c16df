"""A picture's outline on the ground: against OpenCV's lens model and trigonometry."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scenes import PLANE, camera_pose, graticule

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.frame_geometry import footprint

GROUND_M = PLANE.height_m
PLAIN = Camera(640, 512, 800.0, 800.0, 319.5, 255.5)
SIDE, STEP_RAD = 801, 1.0 / 6.36e6  # nodes, a metre of latitude


def hills(latitude_rad, longitude_rad):
    """At most 8 / 70^2 of curvature: bilinear cells of a metre are off by an eighth, 0.2 mm."""
    north = (latitude_rad - PLANE.latitude_rad) / STEP_RAD
    east = (longitude_rad - PLANE.longitude_rad) / STEP_RAD
    return GROUND_M + 8.0 * np.sin(north / 70.0) * np.cos(east / 90.0)


def terrain_of(surface):
    """A model that ends 400 cells from the plane's origin, in the north after 400 m."""
    south_west = np.array([PLANE.latitude_rad, PLANE.longitude_rad]) - 400 * STEP_RAD
    latitude, longitude = south_west[:, None] + STEP_RAD * np.arange(SIDE)
    grid = np.meshgrid(latitude[::-1], longitude, indexing="ij")
    step_deg = float(np.degrees(STEP_RAD))
    place = graticule(tuple(np.degrees(south_west).tolist()), (step_deg, step_deg), SIDE)
    return Terrain(surface(*grid), place)


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
    outline_n = footprint(PLAIN, pose, PLANE, GROUND_M, far_m)
    ahead_m = (outline_n - pose.position_n) @ matrix_from_quat(pose.q_nc)[:, 2]
    assert ahead_m.max() <= far_m
    far = np.flatnonzero(ahead_m > 0.9 * far_m)
    assert len(far) == 2
    # To a 256th of 64 or 80 px, of the 40 px between this depth and the horizon.
    assert_allclose(ahead_m[far], far_m, rtol=0.01)
    assert (far[1] - far[0]) % len(outline_n) in (1, len(outline_n) - 1)  # joined by a line
    uv = pixels_of(PLAIN, pose, outline_n)
    assert np.abs(off_border_px(PLAIN, uv)).max() < 1e-6
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
    assert footprint(PLAIN, pose, PLANE, GROUND_M, far_m).shape == (0, 3)


def test_on_an_elevation_model_it_lies_on_the_hills():
    pose = camera_pose([0, 0, -100.0], 0.0, -60.0, 20.0)
    outline_n = footprint(XT2, pose, PLANE, terrain_of(hills), 1e4)
    latitude, longitude, height = PLANE.geodetic_from_ned(outline_n)
    assert_allclose(height, hills(latitude, longitude), atol=2e-3)  # of the bilinear cells
    assert np.ptp(height) > 5.0
    assert np.abs(off_border_px(XT2, pixels_of(XT2, pose, outline_n))).max() < 1e-6


def test_it_ends_at_the_edge_of_an_elevation_model():
    """Looking north over the edge at 400 m."""
    pose = camera_pose([330.0, 0, -100.0], 0.0, -45.0)
    terrain = terrain_of(lambda latitude, _: np.full_like(latitude, GROUND_M))
    outline_n = footprint(PLAIN, pose, PLANE, terrain, 1e4)
    assert np.isfinite(outline_n).all()
    open_n = footprint(PLAIN, pose, PLANE, GROUND_M, 1e4)
    north_m = outline_n[:, 0].max()
    assert open_n[:, 0].max() > 440.0
    # A metre of latitude is 0.1 % shorter or longer here; a 256th of 64 px spans 6 cm.
    assert north_m == pytest.approx(400.0, abs=0.6)
