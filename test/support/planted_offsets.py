"""Observations with a planted cause of their offsets, as an evaluation has them."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.frames.axes import BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import (
    matrix_from_rotvec,
    quat_from_matrix,
    rotation_y,
    rotation_z,
)
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.tools.evaluate.result import pixel_moves

CLICK_PX = 0.5
COUNT = 24
HEIGHT_M = 40.0


def pose(position_n, rotation_nc):
    return CameraPose(0, position_n, quat_from_matrix(rotation_nc), np.eye(6))


def flight(*, seed=3, headings=(0, 90, 180, 270), depressions=(35, 80), scatter_px=0.0, **planted):
    """Moves of observations, one a picture, on legs of several headings with a planted cause.

    ``boresight`` rad about the camera's axes, ``latency`` s, ``datum`` m east and north,
    ``height`` m that the ground is taken too high.
    """
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < COUNT:
        heading = math.radians(headings[len(found) % len(headings)])
        speed_m_s = rng.uniform(2, 10)
        velocity_n = speed_m_s * np.array([math.cos(heading), math.sin(heading), 0])
        rate_n = np.array([0, 0, rng.normal(0, 0.15)])
        position_n = np.array([*rng.normal(0, 20, 2), -HEIGHT_M])
        look = (
            rotation_z(heading)
            @ rotation_y(-math.radians(rng.uniform(*depressions)))
            @ BODY_OPTICAL
        )
        late_s = planted.get("latency", 0.0)
        true = matrix_from_rotvec(-late_s * rate_n) @ look
        true = true @ matrix_from_rotvec(np.array(planted.get("boresight", (0, 0, 0))))
        uv = rng.uniform([40, 40], [600, 472])
        ray_n = true @ XT2.rays(uv[None])[0]
        ground_down_m = planted.get("height", 0.0)  # the true one is lower than it is taken
        camera_n = position_n - late_s * velocity_n
        point_n = camera_n + ray_n * (ground_down_m - camera_n[2]) / ray_n[2]
        east, north = planted.get("datum", (0.0, 0.0))
        surveyed_n = np.array([point_n[0] - north, point_n[1] - east, 0.0])
        seen = uv + rng.normal(0, CLICK_PX + scatter_px, 2)
        rates = CameraRates(velocity_n, rate_n)
        moves = pixel_moves(XT2, pose(position_n, look), rates, tuple(seen), surveyed_n)
        if moves is not None:
            found.append(moves)
    return found
