"""Measure clicks per second, on level ground and on an elevation model, beside bare rays.

A click is all of it: pixel and stamp in, place, covariance and ellipse out. A ray is the
intersection of the same pixel with the same ground, and nothing else.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

import numpy as np
import pyproj

from dev.judging import Figure
from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import quat_from_euler, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, locate
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.overlay.clicks import Clicks
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

PLANE = TangentPlane(math.radians(39.85), math.radians(116.7), 30.0)
GROUND_M = 25.0
_CLICKS, _ROUNDS = 100, 15
_STAMP_NS = 1_700_000_000_000_000_000
_NODES = 801  # a side of the model, 1 m apart
_SIGMAS = np.array([0.03, 0.02, 0.05, 0.004, 0.003, 0.006])  # m and rad, of the pose
_RATES = CameraRates(np.array([4.0, 3.0, -0.5]), np.array([0.05, -0.02, 0.2]))


def click_speeds() -> Iterator[Figure]:
    """Yield figures on level ground, then on rolling hills with 1 m cells in UTM."""
    yield from _speeds("level ground", GROUND_M)
    yield from _speeds("a DEM of 1 m", hills())


def hills() -> Terrain:
    """Return hills 8 m high as a GeoTIFF in UTM gives them: PROJ converts each place."""
    to_utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32650", always_xy=True)
    x, y = to_utm.transform(math.degrees(PLANE.longitude_rad), math.degrees(PLANE.latitude_rad))
    west, north = x - _NODES / 2, y + _NODES / 2
    column, row = np.meshgrid(np.arange(_NODES), np.arange(_NODES))
    heights_m = GROUND_M + 8.0 * np.sin(row / 70.0) * np.cos(column / 90.0)

    def grid_of(latitude_rad: Array, longitude_rad: Array) -> tuple[Array, Array]:
        x, y = to_utm.transform(np.degrees(longitude_rad), np.degrees(latitude_rad))
        return x - west, north - y

    return Terrain(heights_m.astype(np.float32), grid_of)


def _speeds(what: str, ground: Ground) -> list[Figure]:
    """Measure both in turn, so that a busy machine slows both alike."""
    pose = _pose()
    pixels = np.random.default_rng(5).uniform([0, 0], [639, 511], (_CLICKS, 2))
    clicks = Clicks(ConfidenceConfig())
    clicks.set_plane(PLANE)
    clicks.set_ground(ground)
    clicks.show(_STAMP_NS, XT2, pose, _RATES)

    def click(uv: Array) -> None:
        answer = clicks.locate((float(uv[0]), float(uv[1])), _STAMP_NS)
        assert isinstance(answer, Located)  # a refusal takes less time

    def ray(uv: Array) -> None:
        assert locate(XT2, pose, uv[None], PLANE, ground)[1] == [None]

    rounds = [(_time_s(click, pixels), _time_s(ray, pixels)) for _ in range(_ROUNDS)]
    click_s, ray_s = (min(times) for times in zip(*rounds, strict=True))
    name = f"clicks on {what}"
    return [
        Figure(name, 1 / click_s, "a second", ">= 1000"),
        Figure(f"{name}: rays alone", 1 / ray_s, "a second"),
        Figure(f"{name}: click over ray", click_s / ray_s, "ratio"),
    ]


def _pose() -> CameraPose:
    """Return a pose 40 m above the plane's origin, looking 30 deg down."""
    q_nc = quat_multiply(quat_from_euler(*np.radians([3.0, -30.0, 120.0])), Q_BODY_OPTICAL)
    return CameraPose(_STAMP_NS, np.array([0.0, 0.0, -40.0]), q_nc, np.diag(_SIGMAS**2))


def _time_s(work: Callable[[Array], None], pixels: Array) -> float:
    """Return the CPU time for one pixel, s; other processes don't count."""
    begun = time.process_time()
    for uv in pixels:
        work(uv)
    return (time.process_time() - begun) / len(pixels)
