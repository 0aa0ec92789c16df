"""What is inside messages turned between ROS's axes and the core's, against the matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.frames.axes import ENU_NED, FLU_FRD, quat_turned_both
from tirgeo_ros.core.frames.rotations import (
    canonical,
    matrix_from_quat,
    quat_from_euler,
    quat_from_rotvec,
)
from tirgeo_ros.io.messages.message_parts import (
    covariance_turned_world,
    positive,
    quat_turned_world,
)

#: A handful of products of numbers of order one.
ROUNDING = 2e-15

rotvecs = st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array)


@given(rotvecs)
def test_attitude_is_the_same_in_both_worlds(rotvec):
    q_nb = quat_from_rotvec(rotvec)
    made = quat_turned_both(*q_nb)
    expected = ENU_NED @ matrix_from_quat(q_nb) @ FLU_FRD
    np.testing.assert_allclose(matrix_from_quat(made), expected, atol=ROUNDING)
    np.testing.assert_allclose(quat_turned_both(*made), q_nb, atol=ROUNDING)


@given(rotvecs)
def test_only_the_world_changes(rotvec):
    q = quat_from_rotvec(rotvec)
    made = quat_turned_world(*q)
    expected = ENU_NED @ matrix_from_quat(q)
    np.testing.assert_allclose(matrix_from_quat(made), expected, atol=ROUNDING)
    back = matrix_from_quat(quat_turned_world(*made))
    np.testing.assert_allclose(back, matrix_from_quat(q), atol=ROUNDING)


@pytest.mark.parametrize(("heading_deg", "yaw_deg"), [(0, 90), (90, 0), (180, -90), (45, 45)])
def test_heading_is_clockwise_from_north_and_yaw_the_other_way_from_east(heading_deg, yaw_deg):
    made = quat_turned_both(*quat_from_euler(0, 0, math.radians(heading_deg)))
    half = math.radians(yaw_deg) / 2
    expected = canonical(np.array([math.cos(half), 0, 0, math.sin(half)]))
    np.testing.assert_allclose(positive(made), expected, atol=ROUNDING)


@pytest.mark.parametrize("blocks", [1, 2])
def test_covariance_of_turned_vectors(blocks):
    size = 3 * blocks
    root = np.random.default_rng(1).normal(size=(size, size))
    covariance = root @ root.T
    made = covariance_turned_world(covariance, size)
    turn = np.kron(np.eye(blocks), ENU_NED)
    # a permutation with signs: no rounding at all
    np.testing.assert_array_equal(made.reshape(size, size), turn @ covariance @ turn.T)
    back = covariance_turned_world(made, size).reshape(size, size)
    np.testing.assert_array_equal(back, covariance)
