"""Where on the ground a pixel lies (Ren et al. 2022, Eq. 23)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.attitude import matrix_from_quat
from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.samples import Array, CameraPose

#: Rays closer to the horizon than this (rad) say nothing: no attitude is known so well.
_LEVEL_RAD = 1e-4


def locate(
    camera: Camera, pose: CameraPose, uv: Array, ground_d_m: float
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Pixels (N, 2) to points (N, 3) of the ground, NED in the map's plane, and which are valid.

    The ground is the plane at ``ground_d_m``, metres down from the map's origin. A pixel whose
    ray does not reach it (at or above the horizon, or outside the lens model) is not valid, and
    its point nan.
    """
    rays_n = camera.rays(uv) @ matrix_from_quat(pose.q_nc).T
    slope = rays_n[:, 2] / np.linalg.norm(rays_n, axis=1)
    height_m = ground_d_m - pose.position_n[2]
    valid = (np.abs(slope) > _LEVEL_RAD) & (slope * height_m > 0)
    scale = height_m / np.where(valid, rays_n[:, 2], np.nan)
    return pose.position_n + scale[:, None] * rays_n, valid
