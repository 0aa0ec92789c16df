"""A navigation solution as a pose in the map's plane."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_euler
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import quat_ecef_from_ned, rotation_ecef_from_ned
from tirgeo_ros.core.types.poses import NavSolution

latitudes, longitudes = st.floats(-1.5, 1.5), st.floats(-3.2, 3.2)


def solution(latitude_rad, longitude_rad, q_nb):
    root = np.random.default_rng(3).normal(size=(9, 9))
    rest = np.zeros(3), q_nb, np.zeros(3), (0.0, 0.0, 0.0), root @ root.T
    return NavSolution(5, latitude_rad, longitude_rad, 120.0, *rest)


@given(latitudes, longitudes)
def test_quaternion_of_local_axes_is_that_of_the_matrix(latitude_rad, longitude_rad):
    q = quat_ecef_from_ned(latitude_rad, longitude_rad)
    expected = rotation_ecef_from_ned(latitude_rad, longitude_rad)
    np.testing.assert_allclose(matrix_from_quat(q), expected, atol=4e-15)


@given(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01), st.floats(-3, 3))
def test_attitude_and_covariance_turn_with_the_axes(north_rad, east_rad, yaw):
    plane = TangentPlane(0.9, 0.2, 50.0)
    at = solution(0.9 + north_rad, 0.2 + east_rad, quat_from_euler(0.1, -0.2, yaw))
    pose = plane.body_pose(at)
    turn = plane.rotation_from_local(at.latitude_rad, at.longitude_rad)
    np.testing.assert_allclose(
        matrix_from_quat(pose.q_nb), turn @ matrix_from_quat(at.q_nb), atol=4e-15
    )
    for block in (slice(0, 3), slice(3, 6)):
        expected = turn @ at.pose_covariance[block, block] @ turn.T
        np.testing.assert_allclose(pose.covariance[block, block], expected, atol=1e-13)
    assert pose.stamp_ns == 5
