"""Angles of a gimbal's joints in every order of the chain."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    matrix_from_rotvec,
    rotation_x,
    rotation_y,
    rotation_z,
)
from tirgeo_ros.core.gimbal.joint_geometry import chain, joint_angles
from tirgeo_ros.core.types.joint_orders import JOINT_ORDERS
from tirgeo_ros.core.types.measurements import JointSample

ROUNDING = 1e-12
TURNS = {"yaw": rotation_z, "roll": rotation_x, "pitch": rotation_y}

angles = st.floats(-math.pi, math.pi)
orders = st.sampled_from(JOINT_ORDERS)


def turned(order, **by_name):
    """R_bg by the matrices of the three turns."""
    first, middle, last = (TURNS[name](by_name[name]) for name in order.split("-"))
    return first @ middle @ last


def by_name(order, first, middle, last):
    return dict(zip(order.split("-"), (first, middle, last), strict=True))


@given(orders, angles, st.floats(-math.pi / 2, math.pi / 2), angles)
def test_joint_angles_give_the_matrix_anywhere(order, first, middle, last):
    matrix = turned(order, **by_name(order, first, middle, last))
    said = dict(zip(TURNS, joint_angles(matrix, order), strict=True))
    np.testing.assert_allclose(turned(order, **said), matrix, atol=ROUNDING)
    assert abs(said[order.split("-")[1]]) <= math.pi / 2


@given(orders, angles, angles, angles)
def test_the_axes_are_what_small_turns_of_the_joints_turn_about(order, yaw, roll, pitch):
    at = np.array([yaw, roll, pitch])
    q_bg, axes_b = chain(JointSample(0, *at.tolist()), order)
    rotation = matrix_from_quat(np.array(q_bg))
    for joint, axis_b in enumerate(axes_b.T):
        moved = at + 1e-6 * np.eye(3)[joint]
        more = chain(JointSample(0, *moved.tolist()), order)[0]
        expected = matrix_from_rotvec(1e-6 * axis_b) @ rotation
        # a turn about one axis is exact; 1e-16 of rounding beside 1e-6
        np.testing.assert_allclose(matrix_from_quat(np.array(more)), expected, atol=ROUNDING)
