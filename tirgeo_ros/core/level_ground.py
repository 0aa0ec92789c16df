"""Rays to a surface of constant ellipsoidal height."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.geodesy import SEMI_MAJOR_AXIS_M, TangentPlane
from tirgeo_ros.core.samples import Array
from tirgeo_ros.core.terrain_rays import Stop

_STEPS = 4
_CLOSE_M = 1e-6
#: Rays closer to the surface's tangent than this (rad) say nothing: no attitude is so well known.
_LEVEL_RAD = 1e-4


def level_hits(
    height_m: float, plane: TangentPlane, position_n: Array, rays_n: Array
) -> tuple[Array, list[Stop | None]]:
    """How far (N,) along unit rays (N, 3) the height is reached, m; nan and why where it is not.

    Begun on a sphere, then Newton's method on the ellipsoidal height: within 1e-6 m.
    """
    above_m = float(plane.geodetic_from_ned(position_n)[2]) - height_m
    if not above_m > 0:
        return np.full(len(rays_n), np.nan), [Stop.UNDER] * len(rays_n)
    with np.errstate(invalid="ignore", divide="ignore"):
        ways = _on_a_sphere(above_m, rays_n @ _up_n(plane, position_n))
        for _ in range(_STEPS):
            points_n = position_n + ways[:, None] * rays_n
            heights, slopes = _heights_and_slopes(plane, points_n, rays_n)
            ways = ways - (heights - height_m) / slopes
        met = (np.abs(heights - height_m) < _CLOSE_M * 1e3) & (slopes < -_LEVEL_RAD) & (ways > 0)
    return np.where(met, ways, np.nan), [None if one else Stop.OVER for one in met]


def _on_a_sphere(above_m: float, slopes: Array) -> Array:
    """The nearer root of above + slope t + (1 - slope^2) t^2 / 2 R; nan where there is none."""
    bend = (1 - slopes**2) / (2 * SEMI_MAJOR_AXIS_M)
    root = np.sqrt(np.where(slopes < 0, slopes**2 - 4 * bend * above_m, np.nan))
    way: Array = 2 * above_m / (root - slopes)
    return way


def _up_n(plane: TangentPlane, position_n: Array) -> Array:
    """(3,) the ellipsoid's normal at a place."""
    latitude, longitude, _ = plane.geodetic_from_ned(position_n)
    up: Array = -plane.rotation_from_local(float(latitude), float(longitude))[:, 2]
    return up


def _heights_and_slopes(
    plane: TangentPlane, points_n: Array, rays_n: Array
) -> tuple[Array, Array]:
    """Heights (N,) of points (N, 3), and how fast they grow along the rays."""
    step_m = 0.5
    both = np.stack([points_n - step_m * rays_n, points_n, points_n + step_m * rays_n])
    before, here, after = plane.geodetic_from_ned(both)[2]
    return here, (after - before) / (2 * step_m)
