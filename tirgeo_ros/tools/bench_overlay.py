"""The time of a whole overlay frame beside that of the bare array and drawing calls in it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.attitude import matrix_from_quat, quat_from_matrix, rotation_y
from tirgeo_ros.core.camera import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames import BODY_OPTICAL
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.locating import locate
from tirgeo_ros.core.map_layers import GeoFeature, MapLayer
from tirgeo_ros.core.overlay import Overlay
from tirgeo_ros.core.samples import Array, CameraPose

Pixels = npt.NDArray[np.uint8]

CORNERS = 10  # vertices of an outline
IN_VIEW, OUT_OF_VIEW, LABELS = 1000, 9500, 20
_PLANE = TangentPlane(0.6955, 2.0368, 11.5)
#: 20 m above the ground, looking 30 deg down to the north.
_POSE = CameraPose(
    0,
    np.array([0.0, 0.0, -20.0]),
    quat_from_matrix(rotation_y(np.radians(-30)) @ BODY_OPTICAL),
    np.eye(6) * 1e-4,
)
_FRAME_NS = 100_000_000
_REPEATS = 60


@dataclass(frozen=True)
class OverlayTimes:
    """Medians over many frames, in seconds."""

    whole_s: float
    bare_s: float
    vertices: int


def overlay_times() -> OverlayTimes:
    """Measure with 1e4 vertices in view, more of the map out of it, on one OpenCV thread."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        rng = np.random.default_rng(1)
        outlines_n = _outlines(rng)
        picture = rng.integers(60, 180, (XT2.height, XT2.width), np.uint8)
        return OverlayTimes(
            _median_s(_whole_frame(outlines_n, picture)),
            _median_s(lambda: _bare_frame(outlines_n[:IN_VIEW], picture)),
            IN_VIEW * CORNERS,
        )
    finally:
        cv2.setNumThreads(threads)


def _outlines(rng: np.random.Generator) -> Array:
    """(features, CORNERS, 3) NED; the first IN_VIEW lie in the picture, the others behind it."""
    uv = rng.uniform([20, 20], [XT2.width - 20, XT2.height - 20], (IN_VIEW, 2))
    seen, reasons = locate(XT2, _POSE, uv, _PLANE, _PLANE.height_m)
    assert not any(reasons)
    behind = rng.uniform([-400, -200, 0], [-50, 200, 0], (OUT_OF_VIEW, 3))
    turn = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    ring = 0.3 * np.stack([np.cos(turn), np.sin(turn), np.zeros(CORNERS)], -1)
    return np.asarray(np.concatenate([seen, behind])[:, None] + ring)


def _whole_frame(outlines_n: Array, picture: Pixels) -> Callable[[], object]:
    labels = [f"bed {k}" for k in range(LABELS)] + [""] * (len(outlines_n) - LABELS)
    places = np.stack(_PLANE.geodetic_from_ned(outlines_n), -1)
    features = [GeoFeature(*each) for each in zip(labels, [True] * len(labels), places)]  # noqa: B905 as long as each other
    overlay = Overlay(OverlayConfig(), [MapLayer("beds", features)])
    overlay.set_plane(_PLANE)
    overlay.set_camera(XT2)
    stamp_ns = 0

    def frame() -> object:
        nonlocal stamp_ns
        stamp_ns += _FRAME_NS
        exposure_ns = stamp_ns - round(OverlayConfig().video_latency_s * 1e9)
        overlay.add_pose(CameraPose(exposure_ns, _POSE.position_n, _POSE.q_nc, _POSE.covariance))
        overlay.add_frame(stamp_ns, picture, stamp_ns)
        result = overlay.take(stamp_ns)
        assert result is not None
        assert result.pose is not None
        return result

    return frame


def _bare_frame(outlines_n: Array, picture: Pixels) -> Pixels:
    """Project and draw what is in view, with no regard to what might not be."""
    points_c = (outlines_n.reshape(-1, 3) - _POSE.position_n) @ matrix_from_quat(_POSE.q_nc)
    x, y = points_c[:, 0] / points_c[:, 2], points_c[:, 1] / points_c[:, 2]
    k1, k2, p1, p2 = XT2.distortion[:4]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * k2)
    u = XT2.fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + XT2.cx
    v = XT2.fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + XT2.cy
    runs = np.rint(np.stack([u, v], -1) * 16).astype(np.int32).reshape(-1, CORNERS, 2)
    image = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
    cv2.polylines(image, list(runs), True, (0, 255, 255), 1, cv2.LINE_AA, 4)
    return np.asarray(image, np.uint8)


def _median_s(work: Callable[[], object]) -> float:
    times = []
    for _ in range(_REPEATS):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return median(times)
