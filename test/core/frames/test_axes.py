"""ENU and NED, FLU and FRD, camera body and optical frame: both ways, by hand-made vectors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.frames import axes as frames
from tirgeo_ros.core.frames.rotations import matrix_from_quat

vectors = st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3).map(np.array)


def test_north_east_down_by_hand():
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
    np.testing.assert_array_equal(frames.flu_from_frd(frames.flu_from_frd(v)), v)
    np.testing.assert_array_equal(frames.ENU_NED @ frames.ENU_NED @ v, v)
    np.testing.assert_array_equal(frames.flu_from_frd(v), frames.FLU_FRD @ v)
