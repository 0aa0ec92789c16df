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
"""Define a checkerboard, what a picture shows of it, and its pose before a calibrated camera.

The board's frame has x along the columns, y along the rows and z into the board, like the optical
frame of a camera that looks straight at it. Its origin is the first inner corner.

A plane has two poses that explain a weak picture of it about equally well (Collins and Bartoli,
Infinitesimal plane-based pose estimation, IJCV 2014). Where the picture does not decide, the pose
nearer to the previous picture's is used. A board also looks the same after half a turn: its
corners are counted from the same end as in the previous picture.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import BODY_OPTICAL, euler_axes, euler_from_matrix
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError

_FEWEST = 3  # corners per side, the least that one of the detectors needs
_MOST = 100

#: The worse of two poses is rejected if its squared errors, divided by their variance, are larger
#: by this: three standard deviations.
_CLEAR = 9.0
_QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Checkerboard:
    """Hold a board of ``columns`` x ``rows`` inner corners, ``square_m`` apart.

    Raises CalibrationError if no such board can exist.
    """

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        """Check that such a board can exist."""
        if not _FEWEST <= min(self.columns, self.rows) <= max(self.columns, self.rows) <= _MOST:
            raise CalibrationError(
                f"board {self.columns}x{self.rows}: it needs {_FEWEST} to {_MOST} inner corners "
                "a side (corners between squares, not squares)"
            )
        if not (math.isfinite(self.square_m) and self.square_m > 0):
            raise CalibrationError(f"square {self.square_m:g} m: its side must be positive")

    @property
    def count(self) -> int:
        """Return the number of inner corners."""
        return self.columns * self.rows

    @property
    def size(self) -> tuple[int, int]:
        """Return columns and rows, as OpenCV takes them."""
        return self.columns, self.rows

    @property
    def grid(self) -> Array:
        """Return (count, 2) column and row of every corner, row by row."""
        rows, columns = np.mgrid[: self.rows, : self.columns]
        return np.stack([columns.ravel(), rows.ravel()], -1).astype(float)

    @property
    def points_m(self) -> Array:
        """Return (count, 3) the corners in the board's frame, m."""
        return np.hstack([self.grid * self.square_m, np.zeros((self.count, 1))])


def board_of(text: str, square_m: float) -> Checkerboard:
    """Return a board from a text such as ``9x6``. Raises CalibrationError."""
    match = re.fullmatch(r"\s*(\d{1,4})\s*[xX]\s*(\d{1,4})\s*", text)
    if match is None:
        raise CalibrationError(f"board {text!r}: give inner corners as COLUMNSxROWS, such as 9x6")
    return Checkerboard(int(match[1]), int(match[2]), square_m)


def rotation_of(turn: Any) -> Array:
    """Return the (3, 3) rotation matrix of OpenCV's rotation vector."""
    return np.asarray(cv2.Rodrigues(turn)[0], float)


class RefusalReason(Enum):
    """Name why a view is not used; the value is its name in reports."""

    NO_BOARD = "no board"
    PARTIAL = "board not whole"
    OTHER_BOARD = "another board"
    COVERED = "corners covered"
    BLURRED = "blurred"
    FAINT = "too faint"
    SMALL = "too small"
    UNEVEN = "corners are not on a plane"
    DUPLICATE = "as another view"
    OUTLIER = "does not fit the others"
    OTHER_SIZE = "another picture size"
    UNREADABLE = "not readable"


@dataclass(frozen=True)
class Refused:
    """Hold the reason why a view is not used."""

    reason: RefusalReason
    detail: str  # numbers, and what to do

    def __str__(self) -> str:
        """Return reason and detail as reports have them."""
        return f"{self.reason.value}: {self.detail}"


@dataclass(frozen=True)
class BoardSighting:
    """Hold a board's corners in a picture, in the order of ``Checkerboard.grid``.

    The order begins at one of the grid's ends and is right-handed: the board's z points away from
    the camera.
    """

    corners_px: Array  # (count, 2)
    sigma_px: float  # standard deviation of a coordinate, from the corner fits
    blur_px: Array  # (2,) sigma of the blur across the rows' edges and across the columns' edges


def steps_of(corners: Array, board: Checkerboard) -> Array:
    """Return (count, 2, 2), px, the steps from each corner along its row and along its column."""
    grid = corners.reshape(board.rows, board.columns, 2)
    steps = np.stack([np.gradient(grid, axis=1), np.gradient(grid, axis=0)], 2)
    return np.asarray(steps.reshape(-1, 2, 2))


class BoardPose(NamedTuple):
    """Hold the pose of a board before a camera."""

    rotation_cb: Array  # (3, 3) board to optical frame
    position_c: Array  # (3,) the board's first corner, m
    rms_px: float  # of the corners' reprojection distances
    covariance: Array  # (3, 3) of the rotation, rad^2, about the optical frame's axes


def board_poses(sighting: BoardSighting, board: Checkerboard, camera: Camera) -> list[BoardPose]:
    """Return the poses that a sighting permits, the better one first; an empty list if none."""
    lens = camera.matrix, np.array(camera.distortion or (0.0,) * 4)
    poses = []
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
        poses.append(BoardPose(rotation, position, rms_px, covariance))
    return sorted(poses, key=lambda pose: pose.rms_px)


def _solutions(
    sighting: BoardSighting, board: Checkerboard, lens: tuple[Array, Array]
) -> Iterator[tuple[Array, Array]]:
    """Yield least-squares rotations (3, 3) and positions (3,), each from another start."""
    inputs = board.points_m, np.ascontiguousarray(sighting.corners_px), *lens
    for method in (cv2.SOLVEPNP_IPPE, cv2.SOLVEPNP_ITERATIVE):
        try:
            _, turns, places, _ = cv2.solvePnPGeneric(*inputs, flags=method)
            refined = [
                cv2.solvePnPRefineLM(*inputs, turn, place)
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
    # phi_b = axes @ d(angles), phi in the board's frame.
    turn = np.linalg.pinv(euler_axes(pitch, yaw)) @ rotation_bc @ BODY_OPTICAL
    return angles, np.asarray(np.sqrt(np.diag(turn @ pose.covariance @ turn.T)))
