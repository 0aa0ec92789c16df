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
"""Rotations: closed forms, round trips, batches, and the angles where formulas break."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.linalg import expm

from tirgeo_ros.core.frames import rotations as att
from tirgeo_ros.core.frames.rotations import wrap_pi

#: Products of a few numbers of order one: some tens of roundings of 1.1e-16.
ROUNDING = 5e-15

angles = st.floats(-math.pi, math.pi)
vectors = st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array)


@st.composite
def quats(draw):
    q = np.array(draw(st.lists(st.floats(-1, 1), min_size=4, max_size=4)))
    assume(q @ q > 1e-4)
    return q / math.sqrt(q @ q)


@pytest.mark.parametrize("angle", [math.pi, -math.pi, 3 * math.pi, -3 * math.pi, 7 * math.pi])
@pytest.mark.parametrize("towards", [-math.inf, math.inf])
def test_wrapping_next_to_half_a_turn_stays_below_pi(angle, towards):
    wrapped = float(wrap_pi(np.nextafter(angle, towards)))
    assert -math.pi <= wrapped < math.pi


def test_an_unknown_angle_stays_unknown():
    np.testing.assert_array_equal(wrap_pi([math.nan, 7 * math.pi]), [math.nan, -math.pi])


@given(quats())
def test_matrix_is_a_rotation_and_gives_the_quaternion_back(q):
    m = att.matrix_from_quat(q)
    np.testing.assert_allclose(m @ m.T, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(m) == pytest.approx(1, abs=ROUNDING)
    back = att.quat_from_matrix(m)
    assert back[0] >= 0
    # q and -q are one rotation; where w is zero to rounding either may come.
    assert min(np.abs(back - q).max(), np.abs(back + q).max()) < ROUNDING


@given(quats(), quats(), vectors)
def test_composition(p, q, v):
    together = att.matrix_from_quat(att.quat_multiply(p, q))
    apart = att.matrix_from_quat(p) @ att.matrix_from_quat(q)
    np.testing.assert_allclose(together, apart, atol=ROUNDING)
    np.testing.assert_allclose(together @ v, apart @ v, atol=ROUNDING)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_turns_come_back(axis):
    """Trace -1: the form with w as divisor would divide by zero."""
    matrix = -np.eye(3)
    matrix[axis, axis] = 1
    np.testing.assert_array_equal(np.abs(att.quat_from_matrix(matrix)), np.eye(4)[axis + 1])


@given(vectors)
def test_matrix_of_a_rotation_vector_is_the_exponential(rotvec):
    # SciPy's squarings of a matrix of norm 3.1 round a few times.
    np.testing.assert_allclose(att.matrix_from_rotvec(rotvec), expm(att.skew(rotvec)), atol=1e-14)


@given(vectors)
def test_rotation_vector_comes_back(rotvec):
    assume(np.linalg.norm(rotvec) < math.pi - 1e-6)  # half a turn has two
    back = att.rotvec_from_quat(att.quat_from_rotvec(rotvec))
    np.testing.assert_allclose(back, rotvec, atol=ROUNDING)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-15, 1e-12, 1e-9, 1e-7])
def test_small_rotation_vectors_keep_their_digits(size):
    rotvec = size * np.array([0.6, -0.48, 0.64])
    back = att.rotvec_from_quat(att.quat_from_rotvec(rotvec))
    np.testing.assert_allclose(back, rotvec, rtol=1e-14)


def test_known_attitudes():
    """Nose, right wing and belly of three attitudes, in north, east, down."""
    east = att.matrix_from_euler(0, 0, math.pi / 2)
    np.testing.assert_allclose(east, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    up = att.matrix_from_euler(0, math.pi / 2, 0)
    np.testing.assert_allclose(up[:, 0], [0, 0, -1], atol=1e-15)  # pitch raises the nose
    right = att.matrix_from_euler(math.pi / 2, 0, 0)
    np.testing.assert_allclose(right[:, 1], [0, 0, 1], atol=1e-15)  # roll drops the right wing


@given(angles, st.floats(-1.5, 1.5), angles)
def test_euler_angles_come_back(roll, pitch, yaw):
    result = att.euler_from_quat(att.quat_from_euler(roll, pitch, yaw))
    # Rounding over cos(1.5 rad) = 0.07.
    np.testing.assert_allclose(wrap_pi(result - [roll, pitch, yaw]), 0, atol=2e-13)


@given(
    angles,
    st.sampled_from([-1, 1]),
    st.sampled_from([0.0, 1e-17, 1e-12, 1e-9, 1e-8, 1e-6, 1e-3]),
    angles,
)
def test_euler_angles_give_the_matrix_at_gimbal_lock(roll, sign, off, yaw):
    matrix = att.matrix_from_euler(roll, sign * (math.pi / 2 - off), yaw)
    result = att.euler_from_matrix(matrix)
    np.testing.assert_allclose(att.matrix_from_euler(*result), matrix, atol=ROUNDING)
    assert abs(result[1]) <= math.pi / 2


@given(quats(), vectors, st.floats(0, 1), st.sampled_from([-1, 1]))
def test_slerp_is_a_fraction_of_the_turn(q, turn, fraction, sign):
    assume(np.linalg.norm(turn) < math.pi - 1e-3)
    end = sign * att.quat_multiply(q, att.quat_from_rotvec(turn))
    expected = att.quat_multiply(q, att.quat_from_rotvec(fraction * turn))
    result = att.slerp(q, end, fraction)
    # The direction across is known to rounding over its length, at worst sin(half of 1e-3).
    np.testing.assert_allclose(
        att.matrix_from_quat(result), att.matrix_from_quat(expected), atol=1e-12
    )
    assert math.sqrt(result @ result) == pytest.approx(1, abs=1e-15)


@pytest.mark.parametrize(
    ("optical", "body"),
    [
        ((0, 0, 1), (1, 0, 0)),  # along the view is forward
        ((1, 0, 0), (0, 1, 0)),  # right in the picture is right
        ((0, 1, 0), (0, 0, 1)),  # down in the picture is down
    ],
)
def test_optical_axes_by_hand(optical, body):
    np.testing.assert_array_equal(att.BODY_OPTICAL @ optical, body)
    np.testing.assert_array_equal(att.matrix_from_quat(att.Q_BODY_OPTICAL) @ optical, body)


def test_ros_axes_by_hand():
    np.testing.assert_array_equal(att.ENU_NED @ [1.0, 2.0, 3.0], [2, 1, -3])
    np.testing.assert_array_equal(att.flu_from_frd(np.array([1.0, 2.0, 3.0])), [1, -2, -3])
    np.testing.assert_array_equal(att.FLU_FRD @ [1.0, 2.0, 3.0], [1, -2, -3])


OF_QUATERNIONS = (
    *(att.matrix_from_quat, att.canonical, att.quat_conjugate),
    *(att.rotvec_from_quat, att.euler_from_quat),
)
OF_MATRICES = att.quat_from_matrix, att.euler_from_matrix
OF_VECTORS = att.skew, att.quat_from_rotvec, att.matrix_from_rotvec


@pytest.mark.parametrize("function", [*OF_QUATERNIONS, *OF_MATRICES, *OF_VECTORS])
# Batches whose size equals an axis' size show a transpose that other sizes hide.
@pytest.mark.parametrize("shape", [(1,), (3,), (4,), (9,), (2, 3), (4, 4), (0,)])
def test_batches_equal_their_elements(function, shape):
    rng = np.random.default_rng(1)
    values = rng.normal(size=(*shape, 3 if function in OF_VECTORS else 4))
    if function not in OF_VECTORS:
        values = values / np.linalg.norm(values, axis=-1, keepdims=True)
    if function in OF_MATRICES:
        values = att.matrix_from_quat(values)
    result = function(values)
    assert result.shape[: len(shape)] == shape
    for index in np.ndindex(*shape):
        np.testing.assert_allclose(result[index], function(values[index]), atol=ROUNDING)


@pytest.mark.parametrize(("p_shape", "q_shape"), [((), (4,)), ((4,), ()), ((4, 4), (4, 4))])
def test_products_of_batches(p_shape, q_shape):
    rng = np.random.default_rng(2)
    p, q = rng.normal(size=(*p_shape, 4)), rng.normal(size=(*q_shape, 4))
    result = att.quat_multiply(p, q)
    both = (np.broadcast_to(each, result.shape) for each in (p, q))
    for item, left, right in zip(*(each.reshape(-1, 4) for each in (result, *both)), strict=True):
        np.testing.assert_allclose(item, att.quat_multiply(left, right), atol=2 * ROUNDING)


@pytest.mark.parametrize("pitch", [0.0, -45.0, -90.0])
@pytest.mark.parametrize("flipped", [False, True])
def test_a_level_aircraft_looks_where_the_camera_looks(pitch, flipped):
    yaw, roll = (40.0, 0.0) if not flipped else (-140.0, 180.0)
    pitch = pitch if not flipped else -180.0 - pitch
    q_nb = att.level_quat(att.quat_from_euler(*np.radians([roll, pitch, yaw])))
    assert np.degrees(att.euler_from_quat(q_nb)) == pytest.approx([0, 0, 40])
