"""ENU and NED, FLU and FRD, camera body and optical frame: both ways, by hand-made vectors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core import frames
from tirgeo_ros.core.attitude import (
    canonical,
    matrix_from_quat,
    quat_from_euler,
    quat_from_rotvec,
    quat_multiply,
)

#: A handful of products of numbers of order one.
ROUNDING = 2e-15

vectors = st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3).map(np.array)
rotvecs = st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array)


def test_north_east_down_by_hand():
    np.testing.assert_array_equal(frames.enu_from_ned(np.array([1.0, 2.0, 3.0])), [2, 1, -3])
    np.testing.assert_array_equal(frames.ENU_NED @ [1.0, 2.0, 3.0], [2, 1, -3])


def test_forward_right_down_by_hand():
    np.testing.assert_array_equal(frames.flu_from_frd(np.array([1.0, 2.0, 3.0])), [1, -2, -3])
    np.testing.assert_array_equal(frames.FLU_FRD @ [1.0, 2.0, 3.0], [1, -2, -3])


@pytest.mark.parametrize(
    ("optical", "body"),
    [
        ((0, 0, 1), (1, 0, 0)),  # along the view is forward
        ((1, 0, 0), (0, 1, 0)),  # right in the picture is right
        ((0, 1, 0), (0, 0, 1)),  # down in the picture is down
    ],
)
def test_optical_axes_by_hand(optical, body):
    np.testing.assert_array_equal(frames.BODY_OPTICAL @ optical, body)
    np.testing.assert_array_equal(matrix_from_quat(frames.Q_BODY_OPTICAL) @ optical, body)


@given(vectors)
def test_vectors_come_back(v):
    np.testing.assert_array_equal(frames.enu_from_ned(frames.enu_from_ned(v)), v)
    np.testing.assert_array_equal(frames.flu_from_frd(frames.flu_from_frd(v)), v)
    np.testing.assert_array_equal(frames.enu_from_ned(v), frames.ENU_NED @ v)
    np.testing.assert_array_equal(frames.flu_from_frd(v), frames.FLU_FRD @ v)


@given(rotvecs)
def test_attitude_is_the_same_in_both_worlds(rotvec):
    q_nb = quat_from_rotvec(rotvec)
    made = frames.quat_enu_flu_from_ned_frd(q_nb)
    expected = frames.ENU_NED @ matrix_from_quat(q_nb) @ frames.FLU_FRD
    np.testing.assert_allclose(matrix_from_quat(made), expected, atol=ROUNDING)
    assert made[0] >= 0
    back = matrix_from_quat(frames.quat_enu_flu_from_ned_frd(made))
    np.testing.assert_allclose(back, matrix_from_quat(q_nb), atol=ROUNDING)


@given(rotvecs)
def test_only_the_world_changes(rotvec):
    q = quat_from_rotvec(rotvec)
    made = frames.quat_enu_from_ned(q)
    expected = frames.ENU_NED @ matrix_from_quat(q)
    np.testing.assert_allclose(matrix_from_quat(made), expected, atol=ROUNDING)
    back = matrix_from_quat(frames.quat_enu_from_ned(made))
    np.testing.assert_allclose(back, matrix_from_quat(q), atol=ROUNDING)


@pytest.mark.parametrize(("heading_deg", "yaw_deg"), [(0, 90), (90, 0), (180, -90), (45, 45)])
def test_heading_is_clockwise_from_north_and_yaw_the_other_way_from_east(heading_deg, yaw_deg):
    made = frames.quat_enu_flu_from_ned_frd(quat_from_euler(0, 0, math.radians(heading_deg)))
    half = math.radians(yaw_deg) / 2
    expected = canonical(np.array([math.cos(half), 0, 0, math.sin(half)]))
    np.testing.assert_allclose(made, expected, atol=ROUNDING)


def test_camera_that_looks_east_and_level():
    """Optical axes in ENU: z along east, x (right) along south, y down."""
    q_ng = quat_from_euler(0, 0, math.pi / 2)
    q_nc = quat_multiply(q_ng, frames.Q_BODY_OPTICAL)
    axes = matrix_from_quat(frames.quat_enu_from_ned(q_nc))
    np.testing.assert_allclose(axes.T, [[0, -1, 0], [0, 0, -1], [1, 0, 0]], atol=ROUNDING)


@pytest.mark.parametrize("blocks", [1, 2, 3])
def test_covariance_of_turned_vectors(blocks):
    root = np.random.default_rng(1).normal(size=(3 * blocks, 3 * blocks))
    made = frames.covariance_enu_from_ned(root @ root.T)
    turned = frames.enu_from_ned(root.T.reshape(-1, blocks, 3)).reshape(-1, 3 * blocks)
    np.testing.assert_allclose(made, turned.T @ turned, atol=1e-13)  # sums of 9 of order ten
    back = frames.covariance_enu_from_ned(made)
    np.testing.assert_array_equal(back, root @ root.T)


@pytest.mark.parametrize("count", [1, 3, 4])
def test_batches_equal_their_elements(count):
    rng = np.random.default_rng(2)
    v, q = rng.normal(size=(count, 3)), rng.normal(size=(count, 4))
    for function, batch in (
        (frames.enu_from_ned, v),
        (frames.flu_from_frd, v),
        (frames.quat_enu_from_ned, q),
        (frames.quat_enu_flu_from_ned_frd, q),
    ):
        expected = np.array([function(row) for row in batch])
        np.testing.assert_allclose(function(batch), expected, atol=ROUNDING)
