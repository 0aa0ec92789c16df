"""A gimbal's joints: three angles, one about each body axis, and the order of their chain.

Yaw turns about z, roll about x, pitch about y, each in the axes that the joints before it have
turned. The order names them from the aircraft to the camera: most thermal gimbals are
``yaw-roll-pitch``. Angles stand as yaw, roll, pitch in arrays, whatever the order.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from tirgeo_ros.core.frames.rotations import hamilton, rotation_of
from tirgeo_ros.core.navigation.strapdown import Quaternion
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import JOINT_ORDERS, JOINTS, USUAL_ORDER, JointSample


def _axis(joint: int) -> int:
    """The axis 0 x, 1 y, 2 z of joint 0 yaw, 1 roll, 2 pitch."""
    return (joint + 2) % 3


#: By order: its joints (0 yaw, 1 roll, 2 pitch) from the aircraft to the camera.
_CHAINS = {order: tuple(JOINTS.index(name) for name in order.split("-")) for order in JOINT_ORDERS}


def chain(joints: JointSample, order: str = USUAL_ORDER) -> tuple[Quaternion, Array]:
    """``q_bg`` of the three turns in their order, and the joints' axes in ``b`` as columns.

    The columns (3, 3) are those of yaw, roll, pitch.
    """
    first, middle, last = _CHAINS[order]
    q_first, q_both, q_bg = _turns(joints, order)
    axes_b = np.zeros((3, 3))
    axes_b[_axis(first), first] = 1.0
    axes_b[:, middle] = rotation_of(q_first)[_axis(middle) :: 3]
    axes_b[:, last] = rotation_of(q_both)[_axis(last) :: 3]
    return q_bg, axes_b


def camera_turn(joints: JointSample, order: str = USUAL_ORDER) -> Array:
    """``q_bg`` (4,) of the three turns in their order."""
    return np.array(_turns(joints, order)[2])


def _turns(joints: JointSample, order: str) -> tuple[Quaternion, Quaternion, Quaternion]:
    """The rotations by the first joint, by the first two and by all."""
    angles = (joints.yaw_rad, joints.roll_rad, joints.pitch_rad)
    first, middle, last = (_turn(joint, angles[joint]) for joint in _CHAINS[order])
    both = hamilton(first, middle)
    return first, both, hamilton(both, last)


def _turn(joint: int, angle_rad: float) -> Quaternion:
    c, s = cos(angle_rad / 2), sin(angle_rad / 2)
    return ((c, 0.0, 0.0, s), (c, s, 0.0, 0.0), (c, 0.0, s, 0.0))[joint]


def joint_angles(rotation_bg: Array, order: str = USUAL_ORDER) -> Array:
    """Yaw, roll, pitch (..., 3) that make ``R_bg`` (..., 3, 3) in their order.

    The middle joint's is in [-pi/2, pi/2]. The last is what is left of the matrix once the first
    is taken out. So the three give the matrix again with the middle one at 90 deg too, where the
    others turn about one axis.
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
