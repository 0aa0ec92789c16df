# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Measure overlay frames beside the bare array and drawing calls in them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from statistics import median

import cv2
import numpy as np

from dev.judging import Figure
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.rotations import (
    BODY_OPTICAL,
    matrix_from_quat,
    quat_from_matrix,
    rotation_y,
    rotation_z,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import locate
from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.map.vector_map import GeoFeature, LayerStyle, MapLayer, VectorMap
from tirgeo_ros.core.map.visibility import View
from tirgeo_ros.core.overlay.frame_shapes import Unpainted
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.overlay.picture_painter import PicturePainter
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.arrays import Array, Pixels
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.messages.shapes_codec import written_shapes

_CORNERS = 10  # vertices of an outline
_IN_VIEW, _OUT_OF_VIEW, _LABELS = 1000, 9500, 20
_TOWN_VERTICES = 1_000_000
PLANE = TangentPlane(0.6955, 2.0368, 11.5)
ABOVE_M, PITCH_DEG = 20.0, -30.0  # of the camera that looks at the beds
_FRAME_NS = 100_000_000
_REPEATS = 60
_QUALITY = [cv2.IMWRITE_JPEG_QUALITY, OverlayConfig().jpeg_quality]
#: Six tenths of the vertices are of rectangular buildings of 8 to 20 m, anyhow placed and turned;
#: the rest are of winding roads right across the town, a vertex each 4 m.
_BUILDINGS = 0.6
_ROAD_VERTICES = 2000
_SPACING_M = 7.9  # side of the town over the square root of its vertices


def overlay_times() -> Iterator[Figure]:
    """Beds near by, then a town from above, on one OpenCV thread.

    1e4 vertices of outlines are in view 20 m below, 1e5 behind; then 1e5 of a town of 1e6.
    """
    yield from _times("beds", [beds()], _pose(ABOVE_M, PITCH_DEG), "<= 1.8")
    yield from _times("town", town(_TOWN_VERTICES, PLANE), _pose(120.0, -5.0), "<= 0.8")


def _pose(height_m: float, pitch_deg: float) -> CameraPose:
    """Looking to the north."""
    q_nc = quat_from_matrix(rotation_y(np.radians(pitch_deg)) @ BODY_OPTICAL)
    return CameraPose(0, np.array([0.0, 0.0, -height_m]), q_nc, np.eye(6) * 1e-4)


def _times(what: str, layers: list[MapLayer], pose: CameraPose, wanted: str) -> list[Figure]:
    """Return medians over many frames."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        picture = np.random.default_rng(1).integers(60, 180, (XT2.height, XT2.width), np.uint8)
        lines, vertices = _in_view(VectorMap.from_layers(layers, PLANE).lines, pose)
        whole_s = _median_s(_whole_frame(layers, pose, picture))
        jpeg_s = _median_s(_whole_frame(layers, pose, picture, _as_jpeg))
        page_s = _median_s(_whole_frame(layers, pose, picture, _for_the_page))
        bare_s = _median_s(lambda: _bare_frame(lines, pose, picture))
    finally:
        cv2.setNumThreads(threads)
    name = f"overlay of {what}"
    return [
        Figure(f"{name}, {vertices} vertices in view", whole_s * 1e3, "ms"),
        Figure(f"{name}: bare NumPy and OpenCV calls", bare_s * 1e3, "ms"),
        Figure(f"{name}: frame over bare calls", whole_s / bare_s, "ratio", wanted),
        Figure(f"{name}: for the page over painted as JPEG", page_s / jpeg_s, "ratio", "< 1"),
    ]


def beds() -> MapLayer:
    """Outlines of 0.3 m: the first lie in the picture, the others behind it."""
    rng = np.random.default_rng(1)
    uv = rng.uniform([20, 20], [XT2.width - 20, XT2.height - 20], (_IN_VIEW, 2))
    places_n, reasons = locate(XT2, _pose(ABOVE_M, PITCH_DEG), uv, PLANE, PLANE.height_m)
    assert not any(reasons)
    behind = rng.uniform([-400, -200, 0], [-50, 200, 0], (_OUT_OF_VIEW, 3))
    turn = np.linspace(0, 2 * np.pi, _CORNERS, endpoint=False)
    ring = 0.3 * np.stack([np.cos(turn), np.sin(turn), np.zeros(_CORNERS)], -1)
    outlines_n = np.concatenate([places_n, behind])[:, None] + ring
    labels = [f"bed {k}" for k in range(_LABELS)] + [""] * (len(outlines_n) - _LABELS)
    places = np.stack(PLANE.geodetic_from_ned(outlines_n), -1)
    return MapLayer(
        "beds",
        [GeoFeature(label, True, place) for label, place in zip(labels, places)],  # noqa: B905 as long as each other
    )


def town(vertices: int, plane: TangentPlane) -> list[MapLayer]:
    """Return a town of about ``vertices`` around the plane's origin, without labels."""
    rng = np.random.default_rng(1)
    side_m = _SPACING_M * vertices**0.5
    square = np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, 0.5], [0.5, -0.5]])
    buildings, roads = list[Array](), list[Array]()
    for _ in range(int(vertices * _BUILDINGS / 4)):
        turn, size_m = rng.uniform(0, 2 * np.pi), rng.uniform(8, 20, 2)
        turned = square * size_m @ rotation_z(turn)[:2, :2].T
        buildings.append(turned + rng.uniform(-side_m / 2, side_m / 2, 2))
    along = np.linspace(-side_m / 2, side_m / 2, _ROAD_VERTICES)
    for number in range(max(int(vertices * (1 - _BUILDINGS) / _ROAD_VERTICES), 1)):
        aside = np.cumsum(rng.normal(0, 0.3, _ROAD_VERTICES))
        road = np.column_stack([along, aside + rng.uniform(-side_m / 2, side_m / 2)])
        roads.append(road[:, ::-1] if number % 2 else road)
    style = LayerStyle((255, 255, 255))
    return [
        MapLayer("roads", _features(roads, plane, closed=False)),
        MapLayer("buildings", _features(buildings, plane, closed=True), style),
    ]


def _features(parts: list[Array], plane: TangentPlane, *, closed: bool) -> list[GeoFeature]:
    flat = np.concatenate(parts)
    points_n = np.column_stack([flat, np.zeros(len(flat))])
    latitude, longitude, _ = plane.geodetic_from_ned(points_n)
    places = np.column_stack([latitude, longitude, np.full(len(flat), plane.height_m)])
    cuts = np.cumsum([len(part) for part in parts])[:-1]
    return [GeoFeature("", closed, points) for points in np.split(places, cuts)]


def _in_view(lines: Polylines, pose: CameraPose) -> tuple[Polylines, int]:
    """The lines with most of their points in the image, and the number of points in it."""
    points_c = (lines.points.T - pose.position_n) @ matrix_from_quat(pose.q_nc)
    uv, valid = XT2.project(points_c)
    valid[valid] = View(XT2).inside(uv[valid].T)
    share = np.add.reduceat(valid, lines.starts[:-1], dtype=float) / np.diff(lines.starts)
    ahead = np.minimum.reduceat(points_c[:, 2], lines.starts[:-1]) > 1
    return lines.select(np.flatnonzero(ahead & (share > 0.5))), int(valid.sum())


def _painted(painter: PicturePainter, picture: Unpainted) -> object:
    return painter.paint(picture).image


def _as_jpeg(painter: PicturePainter, picture: Unpainted) -> object:
    return cv2.imencode(".jpg", painter.paint(picture).image, _QUALITY)


def _for_the_page(painter: PicturePainter, picture: Unpainted) -> object:
    clean = painter.clean(picture)
    shapes = written_shapes(painter.shapes(picture), clean.pixels, clean.celsius)
    return shapes.to_bytes(), cv2.imencode(".jpg", clean.pixels, _QUALITY)


def _whole_frame(
    layers: list[MapLayer],
    pose: CameraPose,
    picture: Pixels,
    finish: Callable[[PicturePainter, Unpainted], object] = _painted,
) -> Callable[[], object]:
    overlay = Overlay(OverlayConfig(), layers)
    overlay.set_plane(PLANE)
    overlay.set_camera(XT2)
    stamp_ns = 0

    def frame() -> object:
        nonlocal stamp_ns
        stamp_ns += _FRAME_NS
        exposed_ns = exposure_ns(stamp_ns, OverlayConfig().video_latency_s)
        overlay.poses.add(CameraPose(exposed_ns, pose.position_n, pose.q_nc, pose.covariance))
        overlay.add_frame(stamp_ns, picture, stamp_ns)
        result = overlay.take_unpainted(stamp_ns)
        assert result is not None
        assert result.pose is not None
        return finish(overlay.painter, result)

    return frame


def _bare_frame(lines: Polylines, pose: CameraPose, picture: Pixels) -> Pixels:
    """Project and draw what is in view, with no regard to what might not be."""
    rotation_cn = matrix_from_quat(pose.q_nc).T
    x, y, z = rotation_cn @ (lines.points - pose.position_n[:, None])
    x, y = x / z, y / z
    k1, k2, p1, p2 = XT2.distortion[:4]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * k2)
    u = XT2.fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + XT2.cx
    v = XT2.fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + XT2.cy
    runs = lines.split_rows(np.rint(np.stack([u, v], -1) * 16).astype(np.int32))
    image = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
    cv2.polylines(image, runs, False, (0, 255, 255), 1, cv2.LINE_AA, 4)
    return np.asarray(image, np.uint8)


def _median_s(work: Callable[[], object]) -> float:
    times = []
    for _ in range(_REPEATS):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return median(times)
