"""Where the map's outlines truly lie in a picture, by a way of its own, and how far ink is off."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.poses import CameraPose

_STEP_M = 0.25  # lines are cut so fine that the lens cannot bend a piece visibly
_NEAREST_M = 1.0
_MARK_PX = 8  # a point is drawn as a mark of this reach, which has no outline on the ground
STATUS_ROWS = 20


def ink_of(image: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels of the lines' colour, pure yellow, outside the status line."""
    blue, green, red = (image[:, :, k].astype(int) for k in range(3))
    ink = (green > 200) & (red > 200) & (blue < 60)
    ink[-STATUS_ROWS:] = False
    return ink


class Outlines:
    """The lines of a map in the axes of a plane."""

    def __init__(self, features, plane: TangentPlane, ground_height_m: float) -> None:
        lines, points = [], []
        for feature in features:
            lat, lon, height = feature.points.T
            height = np.where(np.isnan(height), ground_height_m, height)
            corners = plane.ned_from_geodetic(lat, lon, height)
            if len(corners) == 1:
                points.append(corners[0])
            else:
                lines.append(_fine(corners, closed=feature.closed))
        self._lines = np.vstack(lines)
        self._starts = np.cumsum([len(line) for line in lines])[:-1]
        self._points = np.array(points).reshape(-1, 3)

    def drawn(self, camera: Camera, pose: CameraPose) -> tuple[np.ndarray, np.ndarray]:
        """(h, w) bool twice: where lines lie, and where marks of points may lie."""
        lines = np.zeros((camera.height, camera.width), np.uint8)
        uv, seen = _projected(camera, pose, self._lines)
        together = seen[1:] & seen[:-1]
        together[self._starts - 1] = False
        ends = np.rint(np.stack([uv[:-1], uv[1:]], 1)[together]).astype(np.int32)
        cv2.polylines(lines, list(ends), False, (1,))
        marks = np.zeros_like(lines)
        uv, seen = _projected(camera, pose, self._points)
        for u, v in uv[seen]:
            cv2.circle(marks, (round(u), round(v)), _MARK_PX, (1,), -1)
        return lines.astype(bool), marks.astype(bool)


def distances_px(ink: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """(N,) from each pixel of ink to the nearest pixel of a line."""
    far = cv2.distanceTransform((~lines).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return far[ink]


def _fine(corners: np.ndarray, *, closed: bool) -> np.ndarray:
    if closed and not np.array_equal(corners[0], corners[-1]):
        corners = np.vstack([corners, corners[:1]])
    pieces = []
    for start, end in pairwise(corners):
        count = max(int(np.ceil(np.linalg.norm(end - start) / _STEP_M)), 1)
        share = np.arange(count)[:, None] / count
        pieces.append(start + share * (end - start))
    return np.vstack([*pieces, corners[-1:]])


def _projected(
    camera: Camera, pose: CameraPose, points_n: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) pixels, nan where not seen, and (N,) whether in or near the picture."""
    points_c = (points_n - pose.position_n) @ matrix_from_quat(pose.q_nc)
    uv, valid = camera.project(points_c)
    size = np.array([camera.width, camera.height])
    near = np.all((uv > -size) & (uv < 2 * size), axis=1)
    seen = valid & near & (points_c[:, 2] > _NEAREST_M)
    return np.where(seen[:, None], uv, np.nan), seen
