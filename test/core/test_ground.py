"""Pixels to ground points: the inverse of the projection, and nothing above the horizon."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.attitude import matrix_from_quat, quat_from_euler, quat_multiply
from tirgeo_ros.core.camera import XT2
from tirgeo_ros.core.frames import Q_BODY_OPTICAL
from tirgeo_ros.core.ground import locate
from tirgeo_ros.core.samples import CameraPose


def pose_at(position_n, roll_deg, pitch_deg, yaw_deg):
    q_ng = quat_from_euler(*np.radians([roll_deg, pitch_deg, yaw_deg]))
    q_nc = quat_multiply(q_ng, Q_BODY_OPTICAL)
    return CameraPose(0, np.asarray(position_n, float), q_nc, np.zeros((6, 6)))


def pixels_of(camera, pose, points_n):
    return camera.project((points_n - pose.position_n) @ matrix_from_quat(pose.q_nc))


def test_the_principal_point_by_hand():
    pose = pose_at([100.0, 200.0, -20.0], 0, -30, 90)
    points, valid = locate(XT2, pose, np.array([[XT2.cx, XT2.cy]]), 0.0)
    assert valid.all()
    # 20 m high, 30 deg down, looking east: 20 / tan(30 deg) east of the camera.
    np.testing.assert_allclose(points, [[100.0, 200.0 + 20 * np.sqrt(3), 0.0]], atol=1e-9)


@given(
    roll=st.floats(-20, 20),
    pitch=st.floats(-90, -25),
    yaw=st.floats(-180, 180),
    height=st.floats(5, 200),
    ground_d=st.floats(-50, 50),
    seed=st.integers(0, 2**31),
)
def test_inverts_the_projection(roll, pitch, yaw, height, ground_d, seed):
    rng = np.random.default_rng(seed)
    pose = pose_at([30.0, -40.0, ground_d - height], roll, pitch, yaw)
    uv = rng.uniform([100, 100], [540, 412], (3, 2))
    points, valid = locate(XT2, pose, uv, ground_d)
    points, uv = points[valid], uv[valid]
    np.testing.assert_allclose(points[:, 2], ground_d, atol=1e-9)
    back, seen = pixels_of(XT2, pose, points)
    assert seen.all()
    # 1e-9 px of the lens, and rounding of a point up to some km away (1e-12 m) at 5 m and more.
    np.testing.assert_allclose(back, uv, rtol=0, atol=1e-7)


def test_a_ray_at_or_above_the_horizon_meets_nothing():
    level = pose_at([0.0, 0.0, -20.0], 0, 0, 0)
    rows = np.array([[XT2.cx, XT2.cy - 100], [XT2.cx, XT2.cy], [XT2.cx, XT2.cy + 100]])
    points, valid = locate(XT2, level, rows, 0.0)
    assert valid.tolist() == [False, False, True]
    assert np.isnan(points[:2]).all()
    assert np.isfinite(points[2]).all()


def test_a_camera_under_the_plane_sees_it_only_upwards():
    pose = pose_at([0.0, 0.0, 5.0], 0, 0, 0)
    above = np.array([[XT2.cx, XT2.cy - 100], [XT2.cx, XT2.cy + 100]])
    assert locate(XT2, pose, above, 0.0)[1].tolist() == [True, False]


@pytest.mark.parametrize("uv", [[1e6, 1e6], [np.nan, 10.0], [-1e12, 3.0]])
def test_a_pixel_outside_the_lens_model_meets_nothing(uv):
    pose = pose_at([0.0, 0.0, -20.0], 0, -90, 0)
    points, valid = locate(XT2, pose, np.array([uv]), 0.0)
    assert not valid[0]
    assert np.isnan(points).all()
