"""Tracks made from known poses, lens and ground: planted errors come back, with their sigmas."""

import math

import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.motion_fit import BORESIGHT, FOCAL, HEIGHT, LATENCY
from tirgeo_ros.core.checks.picture_motion import PictureMotion
from tirgeo_ros.core.checks.picture_tracks import Tracks
from tirgeo_ros.core.frames.axes import BODY_OPTICAL, Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    quat_from_euler,
    quat_from_rotvec,
    quat_multiply,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import locate
from tirgeo_ros.core.ground.dem import Terrain, graticule
from tirgeo_ros.core.types.poses import CameraPose

CAMERA = Camera(640, 512, 800.0, 800.0, 319.5, 255.5)
PLANE = TangentPlane(math.radians(48.0), math.radians(11.0), 100.0)
LATENCY_S = 0.05
NOISE_PX = 0.3
ASIDE = (0.02, -0.05, 0.06)


def slope(degrees):
    """Ground at 100 m that rises to the north."""
    step_deg, nodes = 0.001, 101
    rise_m = math.tan(math.radians(degrees)) * math.radians(step_deg) * 6.37e6
    column = 100.0 + rise_m * (nodes // 2 - np.arange(nodes))
    heights = np.repeat(column[:, None], nodes, axis=1)
    return Terrain(heights, graticule((47.95, 10.95), (step_deg, step_deg), nodes))


def pose(t_s, aside=(0.0, 0.0, 0.0)):
    """Flight at 5 m/s and 40 m that swings by 40 deg to both sides, looking 45 deg down."""
    yaw = math.radians(40.0) * math.sin(0.8 * t_s)
    q_nc = quat_multiply(quat_from_euler(0.0, math.radians(-45.0), yaw), Q_BODY_OPTICAL)
    q_nc = quat_multiply(q_nc, quat_from_rotvec(BODY_OPTICAL.T @ np.array(aside)))
    position_n = np.array([5.0 * t_s, 3.0 * math.sin(0.5 * t_s), -40.0])
    return CameraPose(round(t_s * 1e9), position_n, q_nc, np.eye(6) * 1e-6)


def fitted(ground, believed, *, latency_s=LATENCY_S, camera=CAMERA, aside=(0.0, 0.0, 0.0)):
    """The fit over 30 s of tracks on ``ground``, believed to be ``believed``."""
    rng = np.random.default_rng(1)
    motion = PictureMotion(latency_s, believed)
    motion.plane, motion.camera = PLANE, camera
    for k in range(1500):
        motion.pose(pose(0.02 * k))
        if k % 22 == 11 and k < 1450:
            motion.tracks(tracks(0.02 * k, ground, aside, rng))
    fit = motion.fit()
    assert fit is not None
    return fit


def tracks(t_s, ground, aside, rng):
    uv = rng.uniform((40, 150), (600, 470), (12, 2))
    first, second = pose(t_s - LATENCY_S, aside), pose(t_s + 0.1 - LATENCY_S, aside)
    points, _ = locate(CAMERA, first, uv, PLANE, ground)
    moved, _ = CAMERA.project((points - second.position_n) @ matrix_from_quat(second.q_nc))
    moved += rng.normal(0.0, NOISE_PX, moved.shape)
    return Tracks(round(t_s * 1e9), round((t_s + 0.1) * 1e9), uv, moved)


def check(fit, planted):
    """All errors within five of their sigmas and what approximations of the fit leave."""
    # 2 ms, 1 %, 3 % and 0.3 deg: poses are means over 80 ms, terrain is level around each point.
    least = np.array([0.002, 0.01, 0.03, 0.005, 0.005, 0.005])
    assert (np.abs(fit.values - planted) < np.maximum(least, 5 * fit.sigmas)).all()
    assert fit.sigmas[LATENCY] < 0.005
    assert fit.sigmas[FOCAL] < 0.01
    assert fit.sigmas[HEIGHT] < 0.03
    assert (fit.sigmas[BORESIGHT] < math.radians(0.6)).all()


def longer(factor):
    return Camera(640, 512, 800.0 * factor, 800.0 * factor, 319.5, 255.5)


@pytest.mark.parametrize(
    ("changes", "error", "planted"),
    [
        ({}, 0, 0.0),
        ({"latency_s": LATENCY_S - 0.2}, LATENCY, 0.2),
        ({"latency_s": LATENCY_S + 0.1}, LATENCY, -0.1),
        ({"camera": longer(1.3)}, FOCAL, -math.log(1.3)),
        ({"camera": longer(0.7)}, FOCAL, -math.log(0.7)),
        ({"believed": 53.0}, HEIGHT, math.log(40.0 / 87.0)),
        ({"believed": 120.0}, HEIGHT, math.log(40.0 / 20.0)),
        ({"aside": ASIDE}, BORESIGHT, ASIDE),
    ],
)
def test_a_planted_error_comes_back(changes, error, planted):
    values = np.zeros(6)
    values[error] = planted
    check(fitted(**{"ground": 100.0, "believed": 100.0} | changes), values)
