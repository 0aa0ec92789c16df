"""Back-project pixels to the ground (Ren et al. 2022, Eq. 23), or return why it is impossible.

The ray through the pixel is intersected with the ground: a surface of constant ellipsoidal height,
or the bilinear surface of an elevation model. Both follow the earth's curvature; the map's tangent
plane departs from it by 8 cm at 1 km.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.dem_intersection import Reason, first_hit
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

__all__ = ["Ground", "Reason", "locate"]

#: The ground under the map: one ellipsoidal height (m) everywhere, or an elevation model.
Ground: TypeAlias = float | Terrain
_MOST_STEPS = 6
#: Height errors at which the iteration ends and at which its result is accepted. Earth-fixed
#: coordinates have a rounding error of 1e-9 m, which accumulates.
_SETTLED_M, _CLOSE_M = 1e-8, 1e-6
#: Rays closer to the surface's tangent than this (rad) give no point: no attitude is so accurate.
_LEVEL_RAD = 1e-4


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
        ways = np.array([np.nan if isinstance(way, Reason) else way for way in found])
        stops = [way if isinstance(way, Reason) else None for way in found]
    else:
        ways, stops = level_hits(ground, plane, pose.position_n, rays_n)
    reasons = [
        Reason.OUTSIDE_LENS if np.isnan(ray[0]) else stop
        for ray, stop in zip(rays_n, stops, strict=True)
    ]
    return pose.position_n + ways[:, None] * rays_n, reasons


def level_hits(
    height_m: float, plane: TangentPlane, position_n: Array, rays_n: Array
) -> tuple[Array, list[Reason | None]]:
    """Return the distances (N,), m, along unit rays (N, 3) at which the height is reached.

    Where it is not reached, the distance is nan and the list has a Reason, else None. The first
    guess is on a sphere; Newton's method on the ellipsoidal height then refines it.
    """
    latitude, longitude, camera_m = plane.geodetic_from_ned(position_n)
    above_m = float(camera_m) - height_m
    if not above_m > 0:
        return np.full(len(rays_n), np.nan), [Reason.UNDERGROUND] * len(rays_n)
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
    reasons = [None if one else Reason.ABOVE_HORIZON for one in met.tolist()]
    return np.where(met, ways, np.nan), reasons
