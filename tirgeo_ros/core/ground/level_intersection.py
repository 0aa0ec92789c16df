"""Intersect rays with a surface of constant ellipsoidal height."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M
from tirgeo_ros.core.ground.dem_intersection import Stop
from tirgeo_ros.core.types.arrays import Array

_MOST_STEPS = 6
#: Height errors at which the iteration ends and at which its result is accepted. Earth-fixed
#: coordinates have a rounding error of 1e-9 m, which accumulates.
_SETTLED_M, _CLOSE_M = 1e-8, 1e-6
#: Rays closer to the surface's tangent than this (rad) give no point: no attitude is so accurate.
_LEVEL_RAD = 1e-4


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
