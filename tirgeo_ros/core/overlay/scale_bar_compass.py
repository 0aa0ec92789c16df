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
"""Draw a scale bar and a north needle, which help to read the picture as a map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.ground.backprojection import Terrain, locate
from tirgeo_ros.core.ground.frame_geometry import Sight, height_above_m
from tirgeo_ros.core.overlay.written_text import (
    TEXT_BGR,
    Box,
    PlacedText,
    TextBitmap,
    composed,
    passing_stamp,
    stamp,
    status_box,
    text_px,
)
from tirgeo_ros.core.types.arrays import Array, Pixels

_LONGEST_PART, _SHORTEST_PART = 0.25, 0.06  # of the picture's width, limits of the bar
_SAMPLES = 33  # along the longest bar
_NEEDLE = np.array([[0.0, 1.0], [0.32, -0.8], [0.0, -0.45], [-0.32, -0.8]])  # (right, north)
_NEEDLE_TIMES = 1.1  # half the needle's length, in text sizes
_LETTER_TIMES = 1.75  # the letter's distance from the needle's middle, in text sizes
_REACH_TIMES = 2.4  # radius of needle and letter, in text sizes
_TICK_TIMES = 0.3  # height of a tick, in text sizes
_SHIFT = 4  # cv2 takes coordinates in sixteenths of a pixel
_FULL = 255


@dataclass(frozen=True, slots=True)
class ScaleBar:
    """Hold a part of a pixel row that spans a round length on the ground."""

    left: float  # pixels
    right: float
    row: float
    length_m: float

    @property
    def text(self) -> str:
        """Return the length as it is written."""
        if self.length_m >= 1000:
            return f"{self.length_m / 1000:g} km"
        return f"{self.length_m:g} m" if self.length_m >= 1 else f"{self.length_m * 100:g} cm"


def ground_sample_m(sight: Sight) -> float:
    """Return the ground length, m, that the picture's middle pixel spans along its row, or nan."""
    u, v = (sight.camera.width - 1) / 2, (sight.camera.height - 1) / 2
    return float(_away_m(sight, (u - 0.5, u + 0.5, v, 2))[1][-1])


def scale_bar(sight: Sight, left: float, row: float) -> ScaleBar | None:
    """Return a bar that runs to the right from a pixel (left, row); None without ground there.

    Its length is the largest of 1, 2 and 5 times a power of ten, m, that fits into a quarter of
    the picture's width. On an elevation model the ground is assumed level along the bar.
    """
    width = sight.camera.width
    u, away_m = _away_m(sight, (left, left + _LONGEST_PART * width, row, _SAMPLES))
    if not (away_m[1:] > away_m[:-1]).all():  # nan compares false
        return None
    power = 10.0 ** math.floor(math.log10(away_m[-1]))
    length_m = max(step * power for step in (1, 2, 5) if step * power <= away_m[-1])
    right = float(np.interp(length_m, away_m, u))
    is_long = right - left >= _SHORTEST_PART * width
    return ScaleBar(left, right, row, length_m) if is_long else None


@lru_cache(maxsize=8)  # each frame needs the same, and undistortion is slow
def _row(camera: Camera, left: float, right: float, row: float, count: int) -> tuple[Array, Array]:
    """Return pixels (N, 2) at equal steps along a row, and their rays (N, 3), z = 1."""
    uv = np.column_stack([np.linspace(left, right, count), np.full(count, row)])
    return uv, camera.rays(uv)


def _away_m(sight: Sight, part: tuple[float, float, float, int]) -> tuple[Array, Array]:
    """Return the columns (N,) of a part of a row, and distances (N,) from its first ground point.

    ``part`` is its first and last column, its row and N. All distances are nan if a pixel of the
    part sees no ground. The ground is taken as flat, on an elevation model at the height of the
    middle pixel. Neglecting the curvature of earth and map plane changes a length by less than
    0.1 %, seen from 100 m up, 1 km from the map's origin.
    """
    camera, pose, plane, ground, *_ = sight
    uv, rays = _row(camera, *part)
    if isinstance(ground, Terrain):
        points, _ = locate(camera, pose, uv[len(uv) // 2, None], plane, ground)
        height_m = float(points[0, 2] - pose.position_n[2])
    else:
        height_m = height_above_m(pose, plane, ground)
    with np.errstate(divide="ignore", invalid="ignore"):
        ways = height_m / (rays @ matrix_from_quat(pose.q_nc)[2])
        points_c = ways[:, None] * rays
    if not ((ways > 0) & np.isfinite(ways)).all():
        return uv[:, 0], np.full(len(ways), np.nan)
    away = points_c - points_c[0]
    return uv[:, 0], np.sqrt((away * away).sum(axis=1))


@dataclass(frozen=True, slots=True)
class PlacedBar:
    """Hold a scale bar and its place, above the left end of the status line."""

    bar: ScaleBar
    box: Box

    def paint(self, image: Pixels) -> None:
        """Draw the bar, in whole pixels, on the picture (h, w, 3) for which it was placed."""
        bar, size_px = self.bar, text_px(image)
        wide = 1 + round(size_px / 8)
        left, right = round(bar.left), round(bar.right) + 1
        tick, row = round(bar.row - _TICK_TIMES * size_px), round(bar.row) + 1
        parts = [
            Box(left, row - wide, right, row),
            Box(left, tick, left + wide, row),
            Box(right - wide, tick, right, row),
        ]
        halo = _halo_px(size_px)
        for x0, y0, x1, y1 in parts:
            image[y0 - halo : y1 + halo, max(x0 - halo, 0) : x1 + halo] = 0
        for x0, y0, x1, y1 in parts:
            image[y0:y1, x0:x1] = TEXT_BGR
        text = stamp(bar.text, size_px, TEXT_BGR)
        text.draw(image, round((bar.left + bar.right - text.size[0]) / 2), self.box.top)


def seen_bar(picture: Pixels, sight: Sight) -> ScaleBar | None:
    """Return the scale bar of a picture (h, w, ...), above the left end of the status line.

    None without room, or ground in view.
    """
    size_px = text_px(picture)
    row = status_box(picture).top - 0.6 * size_px
    return scale_bar(sight, 0.8 * size_px, row) if row >= 3 * size_px else None


def place_scale_bar(image: Pixels, bar: ScaleBar) -> PlacedBar:
    """Place a bar of ``seen_bar`` on its picture (h, w, ...)."""
    size_px = text_px(image)
    width, height = stamp(bar.text, size_px, TEXT_BGR).size
    top = round(bar.row - _TICK_TIMES * size_px) - height
    right = max(bar.right, (bar.left + bar.right + width) / 2)
    return PlacedBar(bar, Box(0, top, math.ceil(right + size_px / 2), status_box(image).top))


def place_rose(image: Pixels, heading_rad: float) -> PlacedText | None:
    """Return the compass rose of a picture (h, w, ...); None without room.

    Up is the camera's heading, rounded to whole degrees as in the number below the rose.
    """
    rose = _rose(round(math.degrees(heading_rad)) % 360, text_px(image))
    height, width = image.shape[:2]
    box = Box(width - rose.size[0], 0, width, rose.size[1])
    if box.left < width // 2 or box.bottom > height // 2:
        return None
    return PlacedText((rose,), box)


@lru_cache(maxsize=16)  # 40 kB each: 360 of them would take 15 MB
def _rose(heading_deg: int, size_px: int) -> TextBitmap:
    heading_rad, reach = math.radians(heading_deg), round(_REACH_TIMES * size_px)
    to_north = np.array([-math.sin(heading_rad), -math.cos(heading_rad)])
    to_right = np.array([-to_north[1], to_north[0]])
    needle = reach + _NEEDLE_TIMES * size_px * (_NEEDLE @ np.stack([to_right, to_north]))
    mask = np.zeros((2 * reach, 2 * reach), np.uint8)
    corners = np.rint(needle * (1 << _SHIFT)).astype(np.int32)
    cv2.fillPoly(mask, [corners], (_FULL,), cv2.LINE_AA, _SHIFT)
    side = 2 * _halo_px(size_px) + 1
    halo = cv2.dilate(mask, np.ones((side, side), np.uint8))
    letter = stamp("N", size_px, TEXT_BGR)
    at = np.rint(reach + _LETTER_TIMES * size_px * to_north - np.array(letter.size) / 2)
    written = passing_stamp(f"{heading_deg:03d}\u00b0", size_px, TEXT_BGR)
    parts = [
        (TextBitmap.of(mask, halo, TEXT_BGR), 0, 0),
        (letter, int(at[0]), int(at[1])),
        (written, round(reach - written.size[0] / 2), 2 * reach - size_px // 4),
    ]
    return composed(2 * reach, 2 * reach + written.size[1], parts)


def _halo_px(size_px: int) -> int:
    return max(round(size_px / 10), 1)
