"""Rotations in batches: any leading axes give what the elements give."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.frames import rotations as att

#: Products of a few numbers of order one, summed in another order.
ROUNDING = 5e-15


def random_quats(seed, *shape):
    q = np.random.default_rng(seed).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


#: Batches whose size equals an axis' size show a transpose that other sizes hide.
SHAPES = [(), (1,), (3,), (4,), (9,), (2, 3), (4, 4), (0,)]


def each(function, *batches, shape):
    """The function on each element, stacked: what a batch must give."""
    flat = [batch.reshape(-1, *batch.shape[len(shape) :]) for batch in batches]
    rows = [function(*(batch[i] for batch in flat)) for i in range(len(flat[0]))]
    return np.array(rows).reshape(*shape, *np.shape(rows[0])) if rows else None


@pytest.mark.parametrize("shape", SHAPES)
def test_batches_of_quaternions_equal_their_elements(shape):
    p, q = random_quats(1, *shape), random_quats(2, *shape)
    for function, arguments in (
        (att.matrix_from_quat, (p,)),
        (att.canonical, (p,)),
        (att.quat_conjugate, (p,)),
        (att.rotvec_from_quat, (p,)),
        (att.euler_from_quat, (p,)),
        (att.quat_multiply, (p, q)),
    ):
        found = function(*arguments)
        assert found.shape[: len(shape)] == shape
        expected = each(function, *arguments, shape=shape)
        if expected is not None:
            # The order of a sum of four squares may differ.
            np.testing.assert_allclose(found, expected, atol=ROUNDING)


@pytest.mark.parametrize("shape", SHAPES)
def test_batches_of_matrices_and_vectors_equal_their_elements(shape):
    matrices = att.matrix_from_quat(random_quats(3, *shape))
    vector = np.random.default_rng(4).normal(size=(*shape, 3))
    for function, argument in (
        (att.quat_from_matrix, matrices),
        (att.euler_from_matrix, matrices),
        (att.skew, vector),
        (att.quat_from_rotvec, vector),
        (att.matrix_from_rotvec, vector),
    ):
        found = function(argument)
        assert found.shape[: len(shape)] == shape
        expected = each(function, argument, shape=shape)
        if expected is not None:
            np.testing.assert_allclose(found, expected, atol=ROUNDING)


@pytest.mark.parametrize("shape", SHAPES)
def test_batches_of_angles_equal_their_elements(shape):
    roll, pitch, yaw = np.random.default_rng(5).uniform(-1.5, 1.5, size=(3, *shape))
    for function in (att.matrix_from_euler, att.quat_from_euler):
        found = function(roll, pitch, yaw)
        assert found.shape[: len(shape)] == shape
        expected = each(function, roll, pitch, yaw, shape=shape)
        if expected is not None:
            np.testing.assert_allclose(found, expected, atol=ROUNDING)
    assert att.rotation_z(yaw).shape == (*shape, 3, 3)


def test_one_quaternion_times_a_batch():
    one, many = random_quats(6), random_quats(7, 4)
    found = att.quat_multiply(one, many)
    np.testing.assert_allclose(found[2], att.quat_multiply(one, many[2]), atol=ROUNDING)
    found = att.quat_multiply(many, one)
    np.testing.assert_allclose(found[3], att.quat_multiply(many[3], one), atol=ROUNDING)
