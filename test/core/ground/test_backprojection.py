"""Pixels to points of level ground, and the reasons where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import camera_pose as pose_at

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Reason, locate

PLANE = TangentPlane(0.6955, 2.0368, 30.0)
RATIONAL = Camera(
    640, 512, 500.0, 510.0, 322.0, 250.0, (0.1, -0.05, 1e-3, -5e-4, 0.01, 0.12, -0.03, 0.005)
)


def pixels_of(camera, pose, points_n):
    return camera.project((points_n - pose.position_n) @ matrix_from_quat(pose.q_nc))


@given(
    roll=st.floats(-20, 20),
    pitch=st.floats(-90, -25),
    yaw=st.floats(-180, 180),
    height=st.floats(5, 200),
    ground=st.floats(-80, 80),
    far=st.floats(0, 3000),
    camera=st.sampled_from([XT2, RATIONAL]),
    seed=st.integers(0, 2**31),
)
def test_inverts_the_projection(roll, pitch, yaw, height, ground, far, camera, seed):
    rng = np.random.default_rng(seed)
    lat, lon, _ = PLANE.geodetic_from_ned(np.array([far, -far, 0.0]))
    pose = pose_at(PLANE.ned_from_geodetic(lat, lon, ground + height), roll, pitch, yaw)
    uv = rng.uniform([0, 0], [639, 511], (3, 2))
    points, reasons = locate(camera, pose, uv, PLANE, ground)
    met = np.array([reason is None for reason in reasons])
    assert np.isfinite(points).all(axis=1).tolist() == met.tolist()
    points, uv = points[met], uv[met]
    # earth-fixed coordinates of 6e6 m are rounded by 1e-9 m, some times over
    np.testing.assert_allclose(PLANE.geodetic_from_ned(points)[2], ground, atol=2e-8)
    back, seen = pixels_of(camera, pose, points)
    assert seen.all()
    np.testing.assert_allclose(back, uv, rtol=0, atol=1e-6)  # the figure required


@pytest.mark.parametrize("ground_m", [29.9, -100.0])
def test_a_ray_at_or_above_the_horizon_meets_nothing(ground_m):
    level = pose_at([0.0, 0.0, 0.0], 0, 0, 0)
    rows = np.array([[XT2.cx, XT2.cy - 100], [XT2.cx, XT2.cy], [XT2.cx, XT2.cy + 100]])
    points, reasons = locate(XT2, level, rows, PLANE, ground_m)
    assert reasons == [Reason.ABOVE_HORIZON, Reason.ABOVE_HORIZON, None]
    assert np.isnan(points[:2]).all()


def test_the_horizon_dips_as_on_a_sphere():
    """From h above a sphere it lies sqrt(2 h / R) under the level: 5.6 mrad from 100 m."""
    level = pose_at([0.0, 0.0, -100.0], 0, 0, 0)
    dip = np.sqrt(2 * 100 / 6.36e6)
    rows = XT2.cy + XT2.fy * np.tan(dip * np.array([0.95, 1.05]))
    uv = np.stack([np.full(2, XT2.cx), rows], -1)  # at the centre the lens does not bend
    assert locate(XT2, level, uv, PLANE, 30.0)[1] == [Reason.ABOVE_HORIZON, None]


def test_a_camera_under_the_ground_locates_nothing():
    pose = pose_at([0.0, 0.0, 5.0], 0, -40, 0)
    uv = np.array([[320.0, 10.0], [320.0, 500.0]])
    points, reasons = locate(XT2, pose, uv, PLANE, 30.0)
    assert reasons == [Reason.UNDERGROUND] * 2
    assert np.isnan(points).all()


@pytest.mark.parametrize("uv", [[1e6, 1e6], [np.nan, 10.0], [-1e12, 3.0]])
def test_a_pixel_outside_the_lens_model_meets_nothing(uv):
    pose = pose_at([0.0, 0.0, -20.0], 0, -90, 0)
    points, reasons = locate(XT2, pose, np.array([uv]), PLANE, 30.0)
    assert reasons == [Reason.OUTSIDE_LENS]
    assert np.isnan(points).all()
