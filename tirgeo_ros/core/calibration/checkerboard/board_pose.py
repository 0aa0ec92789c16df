"""Estimate the pose of a checkerboard before a calibrated camera, from frame to frame of a video.

A plane has two poses that explain a weak picture of it about equally well (Collins and Bartoli,
Infinitesimal plane-based pose estimation, IJCV 2014). Where the picture does not decide, the pose
nearer to the last one is taken. A board looks the same after half a turn, too: the end from which
its corners are counted is that of the last picture.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.calibration.checkerboard.board import BoardSighting, Checkerboard, rotation_of
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.axes import BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import euler_from_matrix
from tirgeo_ros.core.types.arrays import Array

#: The worse of two poses is rejected if its squared errors, divided by their variance, are larger
#: by this: three standard deviations.
_CLEAR = 9.0
_QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


class BoardPose(NamedTuple):
    """Hold the pose of a board before a camera."""

    rotation_cb: Array  # (3, 3) board to optical frame
    position_c: Array  # (3,) the board's first corner, m
    rms_px: float  # of the corners' reprojection distances
    covariance: Array  # (3, 3) of the rotation, rad^2, about the optical frame's axes


def board_poses(sighting: BoardSighting, board: Checkerboard, camera: Camera) -> list[BoardPose]:
    """Return the poses that a sighting permits, the better one first; an empty list if none."""
    lens = camera.matrix, np.array(camera.distortion or (0.0,) * 4)
    found = []
    for rotation, position in _solutions(sighting, board, lens):
        arms_c = board.points_m @ rotation.T
        uv, valid = camera.project(arms_c + position)
        if not valid.all():
            continue
        errors = sighting.corners_px - uv
        # At a rotation vector of zero the slopes by it are those by a small turn.
        slopes = cv2.projectPoints(arms_c, np.zeros(3), position, *lens)[1][:, :6]
        scale = 1 / np.linalg.norm(slopes, axis=0)
        inverse = np.linalg.pinv((slopes * scale).T @ (slopes * scale), hermitian=True)
        variance = (errors**2).sum() / max(errors.size - 6, 1)
        covariance = (inverse * np.outer(scale, scale))[:3, :3] * variance
        rms_px = float(np.sqrt((errors**2).sum(1).mean()))
        found.append(BoardPose(rotation, position, rms_px, covariance))
    return sorted(found, key=lambda pose: pose.rms_px)


def _solutions(
    sighting: BoardSighting, board: Checkerboard, lens: tuple[Array, Array]
) -> Iterator[tuple[Array, Array]]:
    """Yield least-squares rotations (3, 3) and positions (3,), each from another start."""
    given = board.points_m, np.ascontiguousarray(sighting.corners_px), *lens
    for method in (cv2.SOLVEPNP_IPPE, cv2.SOLVEPNP_ITERATIVE):
        try:
            _, turns, places, _ = cv2.solvePnPGeneric(*given, flags=method)
            refined = [
                cv2.solvePnPRefineLM(*given, turn, place)
                for turn, place in zip(turns, places, strict=True)
                if np.isfinite([turn, place]).all()
            ]
        except cv2.error:
            continue
        yield from ((rotation_of(t), np.asarray(p, float).ravel()) for t, p in refined)
        if refined:
            return  # IPPE has no solution, or only nan, for some boards seen straight on


class BoardTracker:
    """Track the pose of one fixed board over a video."""

    def __init__(self, board: Checkerboard, camera: Camera) -> None:
        self._board, self._camera = board, camera
        self._last: Array = np.eye(3)

    def pose(self, sighting: BoardSighting) -> BoardPose | None:
        """Return the board's pose, or None.

        Of the poses that are not clearly worse than the best, and of the board's quarter turns, it
        is the nearest to the last one. In the first picture it is the nearest to upright: x points
        right, as nearly as the board's sides permit, y down, z away.
        """
        poses = board_poses(sighting, self._board, self._camera)
        if not poses:
            return None
        count, least = self._board.count, poses[0].rms_px
        variance = max(least**2 * count / max(2 * count - 6, 1), 1e-12)
        turned = [
            pose._replace(rotation_cb=pose.rotation_cb @ np.linalg.matrix_power(_QUARTER, number))
            for pose in poses
            if (pose.rms_px**2 - least**2) * count <= _CLEAR * variance
            for number in range(4)
        ]
        best = max(turned, key=lambda pose: float(np.trace(self._last.T @ pose.rotation_cb)))
        self._last = best.rotation_cb
        return best


def camera_angles(pose: BoardPose) -> tuple[Array, Array]:
    """Return roll, pitch, yaw (3,), rad, of the camera body against the board, and their sigmas.

    All are zero where the camera looks along the board's normal and is upright to it. Yaw is
    positive to the board's right, pitch upwards.
    """
    rotation_bc = BODY_OPTICAL @ pose.rotation_cb.T @ BODY_OPTICAL.T
    angles = euler_from_matrix(rotation_bc)
    _, pitch, yaw = angles
    # phi_b = axes @ d(angles) for the z-y-x angles, phi in the board's frame (Groves 2.58).
    cosine, sine = np.cos(pitch), np.sin(pitch)
    axes = np.array(
        [
            [np.cos(yaw) * cosine, -np.sin(yaw), 0.0],
            [np.sin(yaw) * cosine, np.cos(yaw), 0.0],
            [-sine, 0.0, 1.0],
        ]
    )
    turn = np.linalg.pinv(axes) @ rotation_bc @ BODY_OPTICAL
    return angles, np.asarray(np.sqrt(np.diag(turn @ pose.covariance @ turn.T)))
