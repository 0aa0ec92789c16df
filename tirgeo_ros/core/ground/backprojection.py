"""Back-project pixels to the ground (Ren et al. 2022, Eq. 23), or return why it is impossible.

The ray through the pixel is intersected with the ground: a surface of constant ellipsoidal height,
or the bilinear surface of an elevation model. Both follow the earth's curvature; the map's tangent
plane departs from it by 8 cm at 1 km.
"""

from __future__ import annotations

from enum import Enum
from typing import TypeAlias

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.dem_intersection import Stop, first_hit
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

#: The ground under the map: one ellipsoidal height (m) everywhere, or an elevation model.
Ground: TypeAlias = float | Terrain
_MOST_STEPS = 6
#: Height errors at which the iteration ends and at which its result is accepted. Earth-fixed
#: coordinates have a rounding error of 1e-9 m, which accumulates.
_SETTLED_M, _CLOSE_M = 1e-8, 1e-6
#: Rays closer to the surface's tangent than this (rad) give no point: no attitude is so accurate.
_LEVEL_RAD = 1e-4


class Reason(Enum):
    """Name why a pixel has no ground point; the value is the text shown to the user."""

    OUTSIDE_LENS = "the pixel is outside the lens model"
    OUTSIDE_PICTURE = "the pixel is outside the picture"
    ABOVE_HORIZON = "the pixel looks over the horizon"
    UNDERGROUND = "the camera is below the ground: are both heights ellipsoidal?"
    CAMERA_OFF_MODEL = "the camera is beside the elevation model"
    OFF_MODEL = "the line of sight leaves the elevation model"
    GAP = "the elevation model has a gap along the line of sight"
    GRAZING = "the line of sight is too flat for a point to be told"
    NO_POSE = "no trusted pose at that picture"
    UNCERTAIN_POSE = "the pose's covariance is not known"
    UNKNOWN_PICTURE = "no picture of that stamp was shown"
    TOO_OLD = "the picture of that stamp is too long ago"
    NO_PICTURE = "no picture was shown yet"
    NO_GROUND = "the height of the ground is not known: set ground_height_m or dem"


_OF_STOP = {
    Stop.OVER: Reason.ABOVE_HORIZON,
    Stop.UNDER: Reason.UNDERGROUND,
    Stop.STARTS_BESIDE: Reason.CAMERA_OFF_MODEL,
    Stop.BESIDE: Reason.OFF_MODEL,
    Stop.GAP: Reason.GAP,
}


def locate(
    camera: Camera, pose: CameraPose, uv: Array, plane: TangentPlane, ground: Ground
) -> tuple[Array, list[Reason | None]]:
    """Back-project pixels (N, 2) to ground points (N, 3), NED in the map's plane, m.

    The list has N entries: None for a pixel with a point, else the reason why it has none; that
    point is nan. The point is the first one along the ray, so ground behind a ridge is not found.
    """
    rays_n = camera.rays(uv) @ matrix_from_quat(pose.q_nc).T
    rays_n /= np.linalg.norm(rays_n, axis=1, keepdims=True)
    if isinstance(ground, Terrain):
        found = [first_hit(ground, plane, pose.position_n, ray) for ray in rays_n]
        ways = np.array([np.nan if isinstance(way, Stop) else way for way in found])
        stops = [way if isinstance(way, Stop) else None for way in found]
    else:
        ways, stops = level_hits(ground, plane, pose.position_n, rays_n)
    reasons = [
        Reason.OUTSIDE_LENS if np.isnan(ray[0]) else None if stop is None else _OF_STOP[stop]
        for ray, stop in zip(rays_n, stops, strict=True)
    ]
    return pose.position_n + ways[:, None] * rays_n, reasons


def level_hits(
    height_m: float, plane: TangentPlane, position_n: Array, rays_n: Array
) -> tuple[Array, list[Stop | None]]:
    """Return the distances (N,), m, along unit rays (N, 3) at which the height is reached.

    Where it is not reached, the distance is nan and the list has a Stop instead of None. The first
    guess is on a sphere; Newton's method on the ellipsoidal height then refines it.
    """
    latitude, longitude, camera_m = plane.geodetic_from_ned(position_n)
    above_m = float(camera_m) - height_m
    if not above_m > 0:
        return np.full(len(rays_n), np.nan), [Stop.UNDER] * len(rays_n)
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = rays_n @ plane.up_n(latitude, longitude)
        # On a sphere the smaller root t of above + slope t + (1 - slope^2) t^2 / 2 R.
        bend = (1 - slopes**2) / (2 * SEMI_MAJOR_AXIS_M)
        root = np.sqrt(np.where(slopes < 0, slopes**2 - 4 * bend * above_m, np.nan))
        ways = 2 * above_m / (root - slopes)
        for _ in range(_MOST_STEPS):
            points_n = position_n + ways[:, None] * rays_n
            latitude, longitude, off_m = plane.geodetic_from_ned(points_n)
            off_m -= height_m
            # The height's gradient is the ellipsoid's normal at the place.
            slopes = (plane.up_n(latitude, longitude) * rays_n).sum(axis=1)
            if not (np.abs(off_m) > _SETTLED_M).any():
                break
            ways = ways - off_m / slopes
        met = (np.abs(off_m) < _CLOSE_M) & (slopes < -_LEVEL_RAD) & (ways > 0)
    return np.where(met, ways, np.nan), [None if one else Stop.OVER for one in met.tolist()]
