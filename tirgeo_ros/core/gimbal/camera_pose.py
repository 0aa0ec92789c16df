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
"""Compute the camera's pose and its covariance from the body's pose and the gimbal's angles.

Yaw turns about z, roll about x and pitch about y, each in the axes as turned by the joints before
it. The order names the joints from the aircraft to the camera: most thermal gimbals are
``yaw-roll-pitch``. In arrays the angles are always yaw, roll, pitch, whatever the order.

There are three compositions. The first two are those of Ren et al. 2022, section 3.4; the third
combines them.

``from_reported``
    Equation 12: roll and pitch of the camera are those that the flight controller reports. The
    heading is psi_EKF + psi_coder, where psi_coder is the reported camera heading minus the
    autopilot's heading at the same instant. This equals the reported rotation turned about the
    vertical by psi_EKF - psi_autopilot, which is the form used here: it also holds where the
    camera looks straight down and its roll and heading are not defined. The gimbal's north may
    differ from the autopilot's by a bias. The estimated bias is subtracted; its remaining
    uncertainty goes into the covariance.
``from_joints``
    The whole chain: body attitude, then the encoder angles.
``from_computed``
    The same chain, with joint angles that no encoder measured: they are computed from the
    rotation between the autopilot's attitude and the reported camera attitude, and so carry the
    errors of both. The bias of the gimbal's north is subtracted. The covariance includes the
    uncertainty of that bias, of the reported roll and pitch, and of the autopilot's tilt.
    ``from_reported`` does not include the autopilot's tilt.

Attitude errors are ``phi_n`` as in the charter. The camera's errors are linear in the body's
position error, the body's phi_n and the gimbal's angle errors, so its covariance follows from
the Jacobians.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.frames.rotations import (
    BODY_OPTICAL,
    azimuth,
    azimuth_row,
    canonical,
    matrix_from_euler,
    matrix_from_quat,
    quat_from_matrix,
    quat_multiply,
    rotation_of,
)
from tirgeo_ros.core.navigation.ins.strapdown import matrix, rotate
from tirgeo_ros.core.types.arrays import Array, Quaternion, Rotation
from tirgeo_ros.core.types.measurements import (
    JOINT_ORDERS,
    JOINTS,
    USUAL_ORDER,
    CameraAttitudeSample,
    JointSample,
)
from tirgeo_ros.core.types.poses import BodyPose, CameraPose

#: For each order, its joints (0 yaw, 1 roll, 2 pitch) from the aircraft to the camera.
_CHAINS = {order: tuple(JOINTS.index(name) for name in order.split("-")) for order in JOINT_ORDERS}
#: Smallest horizontal component of the nose's unit vector at which the heading is defined.
_LEAST_HORIZONTAL = 1e-3
_IDENTITY = np.eye(6)
_DOWN_N = np.array([[0.0], [0.0], [1.0]])
_AXES_N = np.eye(3)


def _axis(joint: int) -> int:
    """Return the axis (0 x, 1 y, 2 z) of a joint (0 yaw, 1 roll, 2 pitch)."""
    return (joint + 2) % 3


def chain(joints: JointSample, order: str = USUAL_ORDER) -> tuple[Quaternion, Array]:
    """Return ``q_bg``, the joints' three turns in their order, and the joints' axes in ``b``.

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
    """Return ``q_bg`` (4,), the joints' three turns in their order."""
    return np.array(_turns(joints, order)[2])


def _turns(joints: JointSample, order: str) -> tuple[Quaternion, Quaternion, Quaternion]:
    """Return the rotations by the first joint, by the first two, and by all three."""
    angles = (joints.yaw_rad, joints.roll_rad, joints.pitch_rad)
    turns: list[Quaternion] = []
    for joint in _CHAINS[order]:
        c, s = cos(angles[joint] / 2), sin(angles[joint] / 2)
        turns.append(((c, 0.0, 0.0, s), (c, s, 0.0, 0.0), (c, 0.0, s, 0.0))[joint])
    both = quat_multiply(turns[0], turns[1])
    return turns[0], both, quat_multiply(both, turns[2])


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


@dataclass(frozen=True)
class Mount:
    """Hold how the camera is mounted on the aircraft, and the variances of the gimbal's angles."""

    lever_arm_b: Array  # (3,) from the IMU to the gimbal's pivot, m
    camera_offset_g: Array  # (3,) from the pivot to the camera, m
    q_gc: Array  # (4,) from the optical frame to the gimbal's camera axes, with the boresight
    joint_variance: Array  # (3,) yaw, roll, pitch encoders, rad2
    reported_variance: Array  # (3,) reported roll, pitch, and tilt aside looking down, rad2
    tilt_variance: float  # the autopilot's attitude, about north and about east each, rad2
    joint_order: str = USUAL_ORDER

    @classmethod
    def from_config(cls, config: GimbalConfig) -> Mount:
        """Return the mount described by a gimbal's parameters."""
        return cls(
            lever_arm_b=config.aircraft.pivot_lever_b,
            camera_offset_g=config.aircraft.camera_from_pivot_g,
            q_gc=quat_from_matrix(matrix_from_euler(*config.boresight_rpy_rad) @ BODY_OPTICAL),
            joint_variance=np.full(3, np.radians(config.encoder_sigma_deg) ** 2),
            reported_variance=np.radians(np.take(config.reported_sigma_deg, (0, 1, 0))) ** 2,
            tilt_variance=np.radians(config.autopilot_tilt_sigma_deg) ** 2,
            joint_order=config.joint_order,
        )


def from_joints(mount: Mount, body: BodyPose, joints: JointSample) -> CameraPose:
    """Return the camera's pose from the body's attitude and the encoder angles."""
    q_nb: Quaternion = tuple(body.q_nb.tolist())
    rotation_nb = rotation_of(q_nb)
    q_bg, axes_b = chain(joints, mount.joint_order)
    axes_n = np.dot(matrix(rotation_nb), axes_b)
    q_ng = quat_multiply(q_nb, q_bg)
    return _camera_pose(mount, body, rotation_nb, q_ng, None, axes_n, mount.joint_variance)


@dataclass(frozen=True, slots=True)
class YawBias:
    """Hold the reported camera heading's bias relative to the autopilot's heading."""

    bias_rad: float = 0.0
    variance: float = 0.0  # rad2


def from_computed(mount: Mount, body: BodyPose, joints: JointSample, north: YawBias) -> CameraPose:
    """Return the camera's pose from the body's attitude and the computed joint angles.

    The bias is subtracted by a rotation about the vertical, because the error is a heading
    error. A rotation about the yaw joint's axis would tilt the picture when the body is not level.
    """
    q_nb: Quaternion = tuple(body.q_nb.tolist())
    q_bg, _ = chain(joints)
    swing = _about_vertical(-north.bias_rad)
    q_ng = quat_multiply(swing, quat_multiply(q_nb, q_bg))
    axes_n = np.concatenate([_reported_axes(matrix(rotation_of(q_ng))), _AXES_N], 1)
    tilt = mount.tilt_variance
    variances = np.append(mount.reported_variance, (tilt, tilt, north.variance))
    turned = matrix(rotation_of(swing))
    return _camera_pose(mount, body, rotation_of(q_nb), q_ng, turned, axes_n, variances)


def _about_vertical(angle_rad: float) -> Quaternion:
    return (cos(angle_rad / 2), 0.0, 0.0, sin(angle_rad / 2))


def from_reported(
    mount: Mount,
    body: BodyPose,
    autopilot_q_nb: Array,
    reported: CameraAttitudeSample,
    north: YawBias,
) -> CameraPose | None:
    """Return the camera's pose by Equation 12, or None where a heading is not defined.

    ``autopilot_q_nb`` (4,) is the autopilot's attitude at the same instant. The reported attitude
    refers to the tangent plane at the aircraft, the result to the map's tangent plane. They
    differ by the distance from the origin divided by the earth's radius, 0.009 deg per km.
    None if the body's or the autopilot's nose points straight up or down.
    """
    rotation_nb = rotation_of(tuple(body.q_nb.tolist()))
    nose = np.array(rotation_nb[0::3])
    autopilot_nose = matrix_from_quat(autopilot_q_nb)[:, 0]
    if not (_has_heading(nose) and _has_heading(autopilot_nose)):
        return None
    angle = azimuth(nose) - azimuth(autopilot_nose)
    angle -= north.bias_rad
    swing = _about_vertical(angle)
    q_ng = quat_multiply(swing, tuple(canonical(reported.q_ng).tolist()))
    vertical = np.zeros((3, 3))
    vertical[2] = azimuth_row(nose)
    axes_n = np.concatenate([_reported_axes(matrix(rotation_of(q_ng))), _DOWN_N], 1)
    variances = np.append(mount.reported_variance, north.variance)
    return _camera_pose(mount, body, rotation_nb, q_ng, vertical, axes_n, variances)


def _has_heading(nose_n: Array) -> bool:
    return bool(np.hypot(nose_n[0], nose_n[1]) > _LEAST_HORIZONTAL)


def _reported_axes(rotation_ng: Array) -> Array:
    """Return the axes (3, 3), in NED, about which errors of the reported attitude turn the camera.

    The first two are those of Euler roll and pitch. Of a camera that looks down, roll is a turn
    about the vertical, and the tilt to its sides would have no error. The third axis, level and
    as long as the view's down component, keeps the error of that tilt the same at any pitch.
    """
    forward = rotation_ng[:, 0]
    if _has_heading(forward):
        across = np.array([-forward[1], forward[0], 0.0]) / np.hypot(forward[0], forward[1])
    else:
        across = rotation_ng[:, 1]  # the camera's right axis, level within the same small angle
    aside = forward[2] * np.array([across[1], -across[0], 0.0])
    return np.stack([forward, across, aside], 1)


def _camera_pose(
    mount: Mount,
    body: BodyPose,
    rotation_nb: Rotation,
    q_ng: Quaternion,
    from_phi: Array | None,
    axes_n: Array,
    variances: Array,
) -> CameraPose:
    """Assemble the pose, where the camera's phi_n = ``from_phi`` phi_n + ``axes_n`` angle errors.

    ``from_phi`` is (3, 3), None for the identity. ``axes_n`` (3, k) are the axes of k angles with
    ``variances`` (k,), rad2. Scalars are used where possible because this runs for every gimbal
    sample.
    """
    a, b, c = rotate(rotation_nb, tuple(mount.lever_arm_b.tolist()))
    x, y, z = rotate(rotation_of(q_ng), tuple(mount.camera_offset_g.tolist()))
    arm = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))  # -[offset x]
    lever = np.array(((0.0, c, -b), (-c, 0.0, a), (b, -a, 0.0)))  # -[lever x]
    by_body = _IDENTITY.copy()
    if from_phi is None:
        by_body[:3, 3:] = arm + lever
    else:
        by_body[:3, 3:] = np.dot(arm, from_phi) + lever
        by_body[3:, 3:] = from_phi
    by_angles = np.concatenate((np.dot(arm, axes_n), axes_n))
    covariance = np.dot(np.dot(by_body, body.covariance), by_body.T)
    covariance += np.dot(by_angles * variances, by_angles.T)
    covariance += covariance.T.copy()
    covariance *= 0.5
    position_n = body.position_n + np.array((a + x, b + y, c + z))
    q_nc = canonical(np.array(quat_multiply(q_ng, tuple(mount.q_gc.tolist()))))
    return CameraPose(body.stamp_ns, position_n, q_nc, covariance)
