"""Compare two sets of poses of one flight, also when their tangent planes differ."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.frames.rotations import (
    quat_conjugate,
    quat_from_matrix,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

_WHOLE_FLIGHT_S = 1e9


def in_plane(pose: CameraPose, plane: TangentPlane, target: TangentPlane) -> CameraPose:
    """Convert a pose given in ``plane`` to ``target``, with its rotation and covariance."""
    turn = target.rotation_from_local(plane.latitude_rad, plane.longitude_rad)
    both = np.kron(np.eye(2), turn)
    return dataclasses.replace(
        pose,
        position_n=target.ned_from_geodetic(*plane.geodetic_from_ned(pose.position_n)),
        q_nc=quat_multiply(quat_from_matrix(turn), pose.q_nc),
        covariance=both @ pose.covariance @ both.T,
    )


@dataclass(frozen=True)
class PoseDifferences:
    """Hold the differences of N poses from the reference at the same instants."""

    stamp_ns: list[int]
    position_n: Array  # (N, 3) m
    rotation_n: Array  # (N, 3) rad: the rotation from the reference to the pose

    @property
    def distance_m(self) -> Array:
        """Return the distances in space (N,), m."""
        return np.asarray(np.linalg.norm(self.position_n, axis=1))

    @property
    def angle_rad(self) -> Array:
        """Return the angles of the rotations (N,), rad."""
        return np.asarray(np.linalg.norm(self.rotation_n, axis=1))


def differences(poses: Sequence[CameraPose], reference: Sequence[CameraPose]) -> PoseDifferences:
    """Compare poses in one plane; skip instants where the reference has no pose."""
    history: PoseBuffer[CameraPose] = PoseBuffer(_WHOLE_FLIGHT_S)
    for pose in reference:
        history.add(pose)
    pairs = [(p, r) for p in poses if isinstance(r := history.at(p.stamp_ns), CameraPose)]
    return PoseDifferences(
        [pose.stamp_ns for pose, _ in pairs],
        np.array([pose.position_n - other.position_n for pose, other in pairs]).reshape(-1, 3),
        np.array(
            [rotvec_from_quat(quat_multiply(p.q_nc, quat_conjugate(r.q_nc))) for p, r in pairs]
        ).reshape(-1, 3),
    )
