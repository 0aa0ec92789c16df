"""Say why no part of a map is in view: too far, elsewhere, behind the camera, off the ground."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.distance import (
    ELSEWHERE_M,
    Nearest,
    compass_word,
    distance_words,
    likely_mistake,
    nearest_feature,
    way_words,
)
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.map.visibility import HORIZON_ROWS
from tirgeo_ros.core.overlay.scale_bar_compass import camera_heading_rad
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

_MOVED_M, _MOVED_PART = 1.0, 0.05  # of the distance to the map: then it is searched again
_GRID = 5  # pixels along each side of the picture, to look for the horizon


class MapAbsence:
    """Explain why one map is not in view; search it again once the camera has moved."""

    def __init__(
        self, vector_map: VectorMap, plane: TangentPlane, first_n: Array | None = None
    ) -> None:
        """Set the map; ``first_n`` (3,) is a point of it, used if nothing lies on the ground."""
        self._map, self._first_n = vector_map, first_n
        self._off_ground = not (len(vector_map.lines) or len(vector_map.marks))
        self._plane = plane
        self._searched_from_n = np.full(3, np.inf)
        self._nearest: Nearest | None = None

    def why(self, camera: Camera, pose: CameraPose, far_m: float) -> str:
        """Return the reason for a pose in the map's plane; ground is drawn up to ``far_m``."""
        moved_m = math.dist(pose.position_n, self._searched_from_n)
        near_m = self._nearest.distance_m if self._nearest else 0.0
        if moved_m > max(_MOVED_M, _MOVED_PART * near_m):
            self._nearest = nearest_feature(self._map, pose.position_n, self._first_n)
            self._searched_from_n = pose.position_n
        if self._nearest is None:
            return "it has no place"
        distance_m, azimuth_rad, point_n = self._nearest
        lead = f"map {way_words(distance_m, azimuth_rad)}"
        if distance_m > ELSEWHERE_M:
            question = likely_mistake(self._plane, point_n)
            return f"{lead}; {question}" if question else lead
        if self._off_ground:
            return "none of the map lies on the elevation model"
        if _looks_above_horizon(camera, pose):
            return "the camera looks above the horizon"
        if distance_m > far_m:
            return f"{lead}; it is drawn up to {distance_words(far_m)}"
        return f"{lead}; the camera looks {compass_word(camera_heading_rad(pose))}"


def _looks_above_horizon(camera: Camera, pose: CameraPose) -> bool:
    """Return whether no pixel's ray points far enough down that ground is drawn there."""
    across = np.linspace(0, camera.width - 1, _GRID)
    down = np.linspace(0, camera.height - 1, _GRID)
    uv = np.stack(np.meshgrid(across, down), -1).reshape(-1, 2)
    north, east, below = matrix_from_quat(pose.q_nc) @ camera.rays(uv).T
    # Rays beyond the lens limit are nan and compare false.
    return not bool((below > np.hypot(north, east) * (HORIZON_ROWS / camera.fy)).any())
