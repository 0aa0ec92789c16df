"""Say of a picture from where it was taken, and where a place is in it."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.types.arrays import Array

#: A footprint whose heights differ by more lies on no level ground. The Earth's bend makes 8 cm
#: in a kilometre.
_LEVEL_M = 1.0


def level_of(footprint_n: Array, plane: TangentPlane) -> float:
    """Return the ellipsoidal height (m) of a footprint (N, 3), NED; nan if it is not level."""
    if len(footprint_n) < 3:
        return math.nan
    _, _, heights_m = plane.geodetic_from_ned(footprint_n)
    return float(np.median(heights_m)) if np.ptp(heights_m) < _LEVEL_M else math.nan


def on_ground(
    plane: TangentPlane, footprint_n: Array, latitude_rad: float, longitude_rad: float
) -> Array:
    """Return a place (3,), NED, on the flat ground that fits a footprint (3 or more, 3) best."""
    north, east, _ = plane.ned_from_geodetic(latitude_rad, longitude_rad, plane.height_m).tolist()
    level = np.column_stack([footprint_n[:, :2], np.ones(len(footprint_n))])
    slope, *_ = np.linalg.lstsq(level, footprint_n[:, 2], rcond=None)
    return np.array([north, east, float(np.dot(slope, [north, east, 1.0]))])


def pixel_of(sight: Sight, point_n: Array) -> tuple[float, float] | None:
    """Return column and row of a point (3,), NED, in a picture; None outside it."""
    offset_n, camera = point_n - sight.pose.position_n, sight.camera
    uv, seen = camera.project(offset_n[None] @ matrix_from_quat(sight.pose.q_nc))
    u, v = uv[0].tolist()
    inside = seen[0] and -0.5 <= u < camera.width - 0.5 and -0.5 <= v < camera.height - 0.5
    return (u, v) if inside else None
