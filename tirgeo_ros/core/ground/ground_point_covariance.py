"""Estimate the covariance of a ground point that was located through a pixel.

The point has errors from the pose, the time, the lens and the ground. Let dc be the error of the
camera's position and phi that of its attitude. The end of the ray, at d from the camera, then has
the error w = dc - d x phi. Let e be its error across the ray from the lens, and dh the error of
the ground's height, along up. The true point lies both on the displaced ray, of direction r, and
on the displaced ground, of normal m:

    d_point = P (w + e) + r (m . up) / (m . r) dh,    P = I - r m^T / (m . r).

This is of first order. The ground's normal is measured over the length of the error itself.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config.overlay import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat, skew
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.dem import Slopes, Terrain
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

_NO_COVARIANCE = np.full((3, 3), np.nan)


def point_covariance(
    camera: Camera,
    pose: CameraPose,
    timed: Array,
    point_n: Array,
    plane: TangentPlane,
    ground: Ground,
    config: ConfidenceConfig,
) -> Array:
    """Return the covariance (3, 3), m2, of a located point (3,), both NED in the map's plane.

    ``timed`` (6, 6) is the pose's covariance plus that of the time error, finite. On an elevation
    model the slope is measured over two cells, or over the length of the error itself if that is
    longer. The result is nan if the ray is parallel to the ground.
    """
    offset_n = point_n - pose.position_n
    off_ray = _off_ray(camera, pose, timed, offset_n, config.lens_sigma_px)
    latitude, longitude, _ = (float(x) for x in plane.geodetic_from_ned(point_n))
    axes_n = plane.rotation_from_local(latitude, longitude)
    up_n, sigma_m = -axes_n[:, 2], config.ground_sigma_m
    if not isinstance(ground, Terrain):
        return _on_ground(off_ray, offset_n, up_n, up_n, sigma_m)
    slopes = Slopes(ground, latitude, longitude, axes_n)
    found = _on_ground(off_ray, offset_n, slopes.normal_n(slopes.cell_m), up_n, sigma_m)
    spread = float(found[0, 0] + found[1, 1])
    if not spread > (2 * slopes.cell_m) ** 2:  # "not >" also catches nan
        return found
    # Over the length of the error, but at most a tenth of the distance: one slope cannot describe
    # the terrain over more.
    step_m = min(math.sqrt(spread), 0.1 * math.hypot(*offset_n.tolist()))
    return _on_ground(off_ray, offset_n, slopes.normal_n(step_m), up_n, sigma_m)


def _off_ray(
    camera: Camera, pose: CameraPose, timed: Array, offset_n: Array, lens_sigma_px: float
) -> Array:
    """Return the covariance (3, 3) of the ray's end, without the error of the ground.

    The end is at ``offset_n`` (3,) from the camera. The lens error, in pixels, is converted to the
    plane through the point and perpendicular to the optical axis. Its part along the ray does not
    matter.
    """
    rotation_nc = matrix_from_quat(pose.q_nc)
    x, y, depth_m = (offset_n @ rotation_nc).tolist()
    ux, uy, vx, vy = camera.slopes(x / depth_m, y / depth_m)
    share = depth_m / (ux * vy - uy * vx)
    across_n = rotation_nc[:, :2] @ np.array(
        [[vy * share, -uy * share], [-vx * share, ux * share]]
    )
    moved = np.hstack([np.eye(3), -skew(offset_n)])
    covariance: Array = moved @ timed @ moved.T + lens_sigma_px**2 * (across_n @ across_n.T)
    return covariance


def _on_ground(
    off_ray: Array, offset_n: Array, normal_n: Array, up_n: Array, ground_sigma_m: float
) -> Array:
    """Return the covariance (3, 3) of the point where the ray meets the ground."""
    fall = float(normal_n @ offset_n)
    if not abs(fall) > 0:
        return _NO_COVARIANCE
    along_n = offset_n / fall
    on_ground = np.eye(3) - along_n[:, None] * normal_n
    raised_n = (ground_sigma_m * float(normal_n @ up_n)) * along_n
    covariance = on_ground @ off_ray @ on_ground.T + raised_n[:, None] * raised_n
    return np.asarray(0.5 * (covariance + covariance.T))
