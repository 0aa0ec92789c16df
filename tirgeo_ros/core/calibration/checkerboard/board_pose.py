"""Estimate the pose of a checkerboard before a calibrated camera, from frame to frame of a video.

A plane has two poses that explain a weak picture of it about equally well (Collins and Bartoli,
Infinitesimal plane-based pose estimation, IJCV 2014). Where the picture does not decide, the pose
nearer to the last one is taken. A board looks the same after half a turn; the end from which its
corners are counted is kept from the previous picture.
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
    found = []
    for rotation, position in _solutions(sighting, board, camera):
        arms_c = board.points_m @ rotation.T
        uv, valid = camera.project(arms_c + position)  # by the camera's own model
        if valid.all():
            errors = sighting.corners_px - uv
            rms = float(np.sqrt((errors**2).sum(1).mean()))
            covariance = _covariance(arms_c, position, camera, errors)
            found.append(BoardPose(rotation, position, rms, covariance))
    return sorted(found, key=lambda pose: pose.rms_px)


def _solutions(
    sighting: BoardSighting, board: Checkerboard, camera: Camera
) -> Iterator[tuple[Array, Array]]:
    """Yield least-squares rotations (3, 3) and positions (3,), each from another start."""
    seen = np.ascontiguousarray(sighting.corners_px)
    given = board.points_m, seen, camera.matrix, np.array(camera.distortion or (0.0,) * 4)
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


def _covariance(arms_c: Array, position_c: Array, camera: Camera, errors: Array) -> Array:
    """Return the rotation's covariance (3, 3), with the variance of the corners' errors."""
    x, y, z = (arms_c + position_c).T
    xx, xy, yx, yy = camera.slopes(x / z, y / z)
    to_plane = np.zeros((len(z), 2, 3))
    to_plane[:, 0, 0] = to_plane[:, 1, 1] = 1 / z
    to_plane[:, 0, 2], to_plane[:, 1, 2] = -x / z**2, -y / z**2
    lens = np.stack([np.stack([xx, xy], -1), np.stack([yx, yy], -1)], 1)
    by_place = lens @ to_plane
    by_turn = np.cross(arms_c[:, None], by_place)  # d(point) = phi x arm
    slopes = np.concatenate([by_turn, by_place], 2).reshape(-1, 6)
    normal = slopes.T @ slopes
    scale = 1 / np.sqrt(np.diag(normal))
    inverse = np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True)
    inverse *= np.outer(scale, scale)
    return np.asarray(inverse[:3, :3] * (errors**2).sum() / max(errors.size - 6, 1))


class BoardTracker:
    """Track the pose of one fixed board over a video, starting from the last pose."""

    def __init__(self, board: Checkerboard, camera: Camera) -> None:
        self._board, self._camera = board, camera
        self._last: Array | None = None
        self._turned: Array = np.eye(3)
        self._dark_first = False

    def pose(self, sighting: BoardSighting) -> BoardPose | None:
        """Return the board's pose, in a frame that is upright in the first picture, or None.

        The frame's x then points right, as nearly as the board's sides permit, y down, z away.
        """
        poses = [
            pose._replace(rotation_cb=pose.rotation_cb @ turn)
            for pose in board_poses(sighting, self._board, self._camera)
            for turn in self._turns(sighting)
        ]
        if not poses:
            return None
        if self._last is None:
            # The quarter turns of the frame: the one whose x points right is upright.
            quarters = [np.linalg.matrix_power(_QUARTER, number) for number in range(4)]
            first = poses[0].rotation_cb
            self._turned = max(quarters, key=lambda turn: float((first @ turn)[0, 0]))
            self._dark_first = sighting.dark_first
            best = poses[0]._replace(rotation_cb=first @ self._turned)
        else:
            last = self._last
            # Of the poses that are not clearly worse than the best, the nearest to the last one.
            count = self._board.count
            least = min(pose.rms_px for pose in poses)
            variance = max(least**2 * count / max(2 * count - 6, 1), 1e-12)
            allowed = [p for p in poses if (p.rms_px**2 - least**2) * count <= _CLEAR * variance]
            best = max(allowed, key=lambda pose: float(np.trace(last.T @ pose.rotation_cb)))
        self._last = best.rotation_cb
        return best

    def _turns(self, sighting: BoardSighting) -> list[Array]:
        """Return the possible rotations from the track's frame to that of the counted corners."""
        board, half = self._board, _QUARTER @ _QUARTER
        if self._last is None:
            return [np.eye(3)]
        if board.columns == board.rows:
            turns = [np.eye(3), _QUARTER, half, _QUARTER.T]
        elif (board.columns + board.rows) % 2:
            # Half a turn exchanges dark and light, so the squares' colours decide.
            turns = [np.eye(3) if sighting.dark_first == self._dark_first else half]
        else:
            turns = [np.eye(3), half]
        return [turn @ self._turned for turn in turns]


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
