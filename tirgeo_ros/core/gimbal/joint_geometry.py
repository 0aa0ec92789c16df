"""Convert between a gimbal's three joint angles and its rotation, for each order of the joints.

Yaw turns about z, roll about x and pitch about y, each in the axes as turned by the joints before
it. The order names the joints from the aircraft to the camera: most thermal gimbals are
``yaw-roll-pitch``. In arrays the angles are always yaw, roll, pitch, whatever the order.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from tirgeo_ros.core.frames.rotations import quat_multiply, rotation_of
from tirgeo_ros.core.types.arrays import Array, Quaternion
from tirgeo_ros.core.types.joint_orders import JOINT_ORDERS, JOINTS, USUAL_ORDER
from tirgeo_ros.core.types.measurements import JointSample


def _axis(joint: int) -> int:
    """Return the axis (0 x, 1 y, 2 z) of a joint (0 yaw, 1 roll, 2 pitch)."""
    return (joint + 2) % 3


#: For each order, its joints (0 yaw, 1 roll, 2 pitch) from the aircraft to the camera.
_CHAINS = {order: tuple(JOINTS.index(name) for name in order.split("-")) for order in JOINT_ORDERS}


def chain(joints: JointSample, order: str = USUAL_ORDER) -> tuple[Quaternion, Array]:
    """Return ``q_bg`` of the three turns in their order, and the joints' axes in ``b``.

    The axes (3, 3) are columns in the order yaw, roll, pitch.
    """
    first, middle, last = _CHAINS[order]
    q_first, q_both, q_bg = _turns(joints, order)
    axes_b = np.zeros((3, 3))
    axes_b[_axis(first), first] = 1.0
    axes_b[:, middle] = rotation_of(q_first)[_axis(middle) :: 3]
    axes_b[:, last] = rotation_of(q_both)[_axis(last) :: 3]
    return q_bg, axes_b


def camera_turn(joints: JointSample, order: str = USUAL_ORDER) -> Array:
    """Return ``q_bg`` (4,) of the three turns in their order."""
    return np.array(_turns(joints, order)[2])


def _turns(joints: JointSample, order: str) -> tuple[Quaternion, Quaternion, Quaternion]:
    """Return the rotations by the first joint, by the first two, and by all three."""
    angles = (joints.yaw_rad, joints.roll_rad, joints.pitch_rad)
    first, middle, last = (_turn(joint, angles[joint]) for joint in _CHAINS[order])
    both = quat_multiply(first, middle)
    return first, both, quat_multiply(both, last)


def _turn(joint: int, angle_rad: float) -> Quaternion:
    c, s = cos(angle_rad / 2), sin(angle_rad / 2)
    return ((c, 0.0, 0.0, s), (c, s, 0.0, 0.0), (c, 0.0, s, 0.0))[joint]


def joint_angles(rotation_bg: Array, order: str = USUAL_ORDER) -> Array:
    """Return yaw, roll, pitch (..., 3) of a rotation ``R_bg`` (..., 3, 3), for a joint order.

    The middle joint's angle is in [-pi/2, pi/2]. The last angle is computed from the matrix with
    the first turn removed. So the three angles reproduce the matrix even with the middle joint
    at 90 deg, where the other two turn about the same axis.
    """
    m = np.asarray(rotation_bg, float)
    joints = _CHAINS[order]
    i, j, k = map(_axis, joints)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0  # of the permutation of x, y, z
    first = np.arctan2(-sign * m[..., j, k], m[..., k, k])
    middle = np.arctan2(sign * m[..., i, k], np.hypot(m[..., j, k], m[..., k, k]))
    sine, cosine = sign * np.sin(first), np.cos(first)
    last = np.arctan2(
        sign * (cosine * m[..., j, i] + sine * m[..., k, i]),
        cosine * m[..., j, j] + sine * m[..., k, j],
    )
    angles = np.empty(m.shape[:-1])
    for joint, angle in zip(joints, (first, middle, last), strict=True):
        angles[..., joint] = angle
    return angles
