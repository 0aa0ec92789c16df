"""Explain why none of a map is in the picture."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.distance import (
    ELSEWHERE_M,
    NearestFeature,
    compass_word,
    distance_words,
    likely_mistake,
    way_words,
)
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.map.visibility import HORIZON_ROWS
from tirgeo_ros.core.overlay.scale_bar_compass import camera_heading_rad
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

_MOVED_M, _MOVED_PART = 1.0, 0.05  # of the distance to the map
_TURNED = math.cos(math.radians(2.0))  # of the optical axis
_GRID = 5  # pixels along each side of the picture


class MapAbsence:
    """Explain why one map is not in view; recompute once the camera has moved or turned."""

    def __init__(
        self, vector_map: VectorMap, plane: TangentPlane, first_n: Array | None = None
    ) -> None:
        """Set the map; ``first_n`` (3,) is a point of it, used if nothing lies on the ground."""
        self._whereabouts = NearestFeature(vector_map, first_n)
        self._off_ground = not (len(vector_map.lines) or len(vector_map.marks))
        self._plane = plane
        self._last_answer: tuple[Camera, Array, Array, float, str] | None = None

    def why(self, camera: Camera, pose: CameraPose, far_m: float) -> str:
        """Return the reason for a pose in the map's plane; ground is drawn up to ``far_m``."""
        axis = matrix_from_quat(pose.q_nc)[:, 2]
        if self._last_answer is not None:
            seen_by, position_n, before, reach_m, words = self._last_answer
            moved_m = float(np.linalg.norm(pose.position_n - position_n))
            if seen_by == camera and moved_m < reach_m and float(axis @ before) > _TURNED:
                return words
        distance_m, words = self._why(camera, pose, far_m)
        reach_m = max(_MOVED_M, _MOVED_PART * distance_m)
        self._last_answer = camera, pose.position_n, axis, reach_m, words
        return words

    def _why(self, camera: Camera, pose: CameraPose, far_m: float) -> tuple[float, str]:
        nearest = self._whereabouts.nearest(pose.position_n)
        if nearest is None:
            return math.inf, "it has no place"
        distance_m, azimuth_rad, point_n = nearest
        if distance_m > ELSEWHERE_M:
            question = likely_mistake(self._plane, point_n)
            lead = f"map {way_words(distance_m, azimuth_rad)}"
            return distance_m, f"{lead}; {question}" if question else lead
        if self._off_ground:
            return distance_m, "none of the map lies on the elevation model"
        if _looks_above_horizon(camera, pose):
            return distance_m, "the camera looks above the horizon"
        lead = f"map {way_words(distance_m, azimuth_rad)}"
        if distance_m > far_m:
            return distance_m, f"{lead}; it is drawn up to {distance_words(far_m)}"
        looks = compass_word(camera_heading_rad(pose))
        return distance_m, f"{lead}; the camera looks {looks}"


def _looks_above_horizon(camera: Camera, pose: CameraPose) -> bool:
    """Return whether no pixel's ray points far enough down that ground is drawn there."""
    across = np.linspace(0, camera.width - 1, _GRID)
    down = np.linspace(0, camera.height - 1, _GRID)
    uv = np.stack(np.meshgrid(across, down), -1).reshape(-1, 2)
    north, east, below = matrix_from_quat(pose.q_nc) @ camera.rays(uv).T
    # Rays beyond the lens limit are nan and compare false.
    return not bool((below > np.hypot(north, east) * (HORIZON_ROWS / camera.fy)).any())
