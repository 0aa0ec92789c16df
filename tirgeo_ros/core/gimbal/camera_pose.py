"""From the body's pose and the gimbal's angles to the camera's pose, with its covariance.

Two ways (Ren et al. 2022, section 3.4), and one that is both:

``from_reported``
    Equation 12: roll and pitch of the camera as the flight controller reports them, heading
    psi_EKF + psi_coder, where psi_coder is the reported camera heading less the autopilot's own of
    the same instant. That is the reported rotation turned about the vertical by
    psi_EKF - psi_autopilot, the form used here: it also holds where the camera looks straight
    down and its roll and heading are not defined. The gimbal's north may be off the autopilot's
    by a bias, which is taken out; what it is not known to goes into the covariance.
``from_joints``
    The whole chain: body attitude, then the encoder angles.
``from_computed``
    The same chain with angles that no encoder saw: they are the rotation from the autopilot's
    attitude to the reported one. So they are wrong by what those are: the gimbal's north is taken
    out of them, and its uncertainty, that of the reported roll and pitch and that of the
    autopilot's tilt go into the covariance. The last is not in ``from_reported``.

Errors are ``phi_n`` as in the charter. The camera's are linear in the body's position error,
the body's phi_n and the gimbal's angle errors, so its covariance follows from Jacobians.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, sin

import numpy as np

from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.frames.axes import BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import (
    canonical,
    hamilton,
    matrix_from_euler,
    matrix_from_quat,
    quat_from_matrix,
    rotation_of,
)
from tirgeo_ros.core.gimbal.joint_geometry import chain
from tirgeo_ros.core.navigation.strapdown import Quaternion, Rotation, matrix, rotate
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import USUAL_ORDER, CameraAttitudeSample, JointSample
from tirgeo_ros.core.types.poses import BodyPose, CameraPose

#: Smallest horizontal part of the nose's direction from which a heading is taken.
_LEAST_HORIZONTAL = 1e-3
_IDENTITY = np.eye(6)
_DOWN_N = np.array([[0.0], [0.0], [1.0]])
_AXES_N = np.eye(3)


@dataclass(frozen=True)
class Mount:
    """How the camera hangs from the aircraft, and how well the gimbal's angles are known."""

    lever_arm_b: Array  # (3,) pivot from the IMU, m
    camera_offset_g: Array  # (3,) camera from the pivot, m
    q_gc: Array  # (4,) optical frame to the gimbal's camera axes, with the boresight
    joint_variance: Array  # (3,) yaw, roll, pitch encoders, rad2
    reported_variance: Array  # (2,) reported roll, pitch, rad2
    tilt_variance: float  # the autopilot's own attitude about north and east, each, rad2
    joint_order: str = USUAL_ORDER

    @classmethod
    def from_config(cls, config: GimbalConfig) -> Mount:
        """Return the mount that a gimbal's parameters describe."""
        return cls(
            config.aircraft.pivot_lever_b,
            config.aircraft.camera_from_pivot_g,
            quat_from_matrix(matrix_from_euler(*config.boresight_rpy_rad) @ BODY_OPTICAL),
            np.full(3, np.radians(config.encoder_sigma_deg) ** 2),
            np.radians(np.array(config.reported_sigma_deg)) ** 2,
            np.radians(config.autopilot_tilt_sigma_deg) ** 2,
            config.joint_order,
        )


def from_joints(mount: Mount, body: BodyPose, joints: JointSample) -> CameraPose:
    """Return the camera's pose by the body's attitude and the encoders."""
    q_nb: Quaternion = tuple(body.q_nb.tolist())
    rotation_nb = rotation_of(q_nb)
    q_bg, axes_b = chain(joints, mount.joint_order)
    axes_n = np.dot(matrix(rotation_nb), axes_b)
    q_ng = hamilton(q_nb, q_bg)
    return _camera_pose(mount, body, rotation_nb, q_ng, None, axes_n, mount.joint_variance)


@dataclass(frozen=True, slots=True)
class NorthBias:
    """By what the reported camera heading is too large beside the autopilot's."""

    bias_rad: float = 0.0
    variance: float = 0.0  # rad2


def from_computed(
    mount: Mount, body: BodyPose, joints: JointSample, north: NorthBias
) -> CameraPose:
    """Return the camera's pose by the body's attitude and joints computed from reported ones.

    The bias is taken out about the vertical, where it is; about the joint's axis it would tilt
    the picture of a body that is not level.
    """
    q_nb: Quaternion = tuple(body.q_nb.tolist())
    q_bg, _ = chain(joints)
    swing = _about_vertical(-north.bias_rad)
    q_ng = hamilton(swing, hamilton(q_nb, q_bg))
    axes_n = np.concatenate([_roll_and_pitch_axes(matrix(rotation_of(q_ng))), _AXES_N], 1)
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
    north: NorthBias,
) -> CameraPose | None:
    """Return the camera's pose by Equation 12, ``autopilot_q_nb`` (4,) of the same instant.

    The reported attitude is level at the aircraft, the result in the map's plane; they differ
    by the distance from the origin over the earth's radius, 0.009 deg in each km.
    None where body or autopilot point straight up or down and have no heading.
    """
    rotation_nb = rotation_of(tuple(body.q_nb.tolist()))
    nose = np.array(rotation_nb[0::3])
    autopilot_nose = matrix_from_quat(autopilot_q_nb)[:, 0]
    if not (_has_heading(nose) and _has_heading(autopilot_nose)):
        return None
    angle = atan2(nose[1], nose[0]) - atan2(autopilot_nose[1], autopilot_nose[0])
    angle -= north.bias_rad
    swing = _about_vertical(angle)
    q_ng = hamilton(swing, tuple(canonical(reported.q_ng).tolist()))
    vertical = np.zeros((3, 3))
    vertical[2] = heading_row(nose)
    axes_n = np.concatenate([_roll_and_pitch_axes(matrix(rotation_of(q_ng))), _DOWN_N], 1)
    variances = np.append(mount.reported_variance, north.variance)
    return _camera_pose(mount, body, rotation_nb, q_ng, vertical, axes_n, variances)


def _has_heading(nose_n: Array) -> bool:
    return bool(np.hypot(nose_n[0], nose_n[1]) > _LEAST_HORIZONTAL)


def heading_row(nose_n: Array) -> Array:
    """(3,) derivative of the heading by phi_n, where ``nose_n`` (3,) is the body's x axis.

    Equation 9's last row: [tan(pitch) cos(yaw), tan(pitch) sin(yaw), 1].
    """
    x, y, z = nose_n
    return np.asarray(np.array([-z * x, -z * y, x * x + y * y]) / (x * x + y * y))


def _roll_and_pitch_axes(rotation_ng: Array) -> Array:
    """(3, 2) the axes about which Euler roll and pitch turn the camera."""
    forward = rotation_ng[:, 0]
    if _has_heading(forward):
        across = np.array([-forward[1], forward[0], 0.0]) / np.hypot(forward[0], forward[1])
    else:
        across = rotation_ng[:, 1]  # the right side, level within the same small angle
    return np.stack([forward, across], 1)


def _camera_pose(
    mount: Mount,
    body: BodyPose,
    rotation_nb: Rotation,
    q_ng: Quaternion,
    from_phi: Array | None,
    axes_n: Array,
    variances: Array,
) -> CameraPose:
    """Assemble the pose, where phi_n of the camera = ``from_phi`` phi_n + ``axes_n`` angles.

    ``from_phi`` (3, 3), None for the unit matrix; ``axes_n`` (3, k) with the k angles'
    ``variances``, rad2. In scalars where it can be: it runs at every sample of the gimbal.
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
    return CameraPose(
        body.stamp_ns,
        body.position_n + np.array((a + x, b + y, c + z)),
        canonical(np.array(hamilton(q_ng, tuple(mount.q_gc.tolist())))),
        covariance,
    )
