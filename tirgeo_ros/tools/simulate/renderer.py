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
"""Render what a thermal camera sees of the park: paint the ground, place targets, take pictures.

It is night after a warm day: paving and kerbs are warm, grass is cool, beds are warm or cool. For
distant ground there are copies of lower resolution. The share of a pixel that a target covers
determines the pixel's grey level. So a target smaller than a pixel is faint, and its middle is
where the camera projects it. Lens, blur and noise are those of the true camera.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels
from tirgeo_ros.tools.simulate.park import LEVEL, Park, Relief, collection, point_feature
from tirgeo_ros.tools.simulate.processes import generator
from tirgeo_ros.tools.simulate.scenario import ParkScenario, Scenario, VideoScenario

Floats = npt.NDArray[np.float32]

#: Grey level of the grass, and grey levels per kelvin.
GRASS, GREY_PER_K = 92.0, 10.0
_PAVING, _KERB, _SOIL = 158.0, 192.0, 118.0
_BED_SPAN, _HOT = 58.0, 150.0
_KERB_M, _SLAB_M = 0.2, 2.0
_LEVELS = 4
_SHIFT = 4  # positions are drawn in sixteenths of a cell
#: Size of grain (m) and its standard deviation (grey levels), the largest first.
_GRAINS = ((40.0, 5.0), (9.0, 5.0), (2.5, 4.0), (0.7, 4.0), (0.2, 4.0))

# Targets.

#: Ranges for seeded targets: contrast to the grass (K) and size (m).
_SEEDED = {
    "person": ((10.0, 14.0), (0.45, 0.55)),
    "fire": ((300.0, 500.0), (1.0, 3.0)),
    "vehicle": ((3.0, 6.0), (4.3, 4.7)),
}
_VEHICLE_WIDTH = 2.0 / 4.5  # per length
_PARTS = 8  # of a pixel, in each direction
_COARSEST_M = 5.0  # pixels that cover more ground than this show no target
_OFFSETS = (np.arange(_PARTS, dtype=np.float32) + 0.5) / _PARTS - 0.5

# Pictures.

#: For 16 bits: a scene uses a small part of the range, as with a radiometric camera.
COUNTS_OF_0, COUNTS_PER_GREY = 20000.0, 16.0
_FAR_M = 2000.0  # ground at a greater depth is not visible


class Ground(NamedTuple):
    """Hold the painted ground: level k has cells of ``resolution_m`` times 2^k."""

    levels: list[Pixels]  # rows from north to south, columns from west to east
    north_edge_m: float
    west_edge_m: float
    resolution_m: float


def paint(park: Park, scenario: ParkScenario, seed: int) -> Ground:
    """Paint a park with its texture."""
    canvas = _Canvas(scenario)
    for path in park.paths:
        canvas.line(path.line, path.width_m + 2 * _KERB_M, _KERB)
    for path in park.paths:
        canvas.line(path.line, path.width_m, _PAVING)
    rng = generator(seed, "slabs")  # of different grey levels
    for path in park.paths:
        ahead = path.line[1] - path.line[0]
        length_m = float(np.linalg.norm(ahead))
        along = ahead / length_m
        aside = np.array([-along[1], along[0]]) * 0.5 * path.width_m
        for at in np.arange(0.0, length_m - _SLAB_M, _SLAB_M):
            first, last = path.line[0] + along * at, path.line[0] + along * (at + _SLAB_M - 0.1)
            slab = np.array([first - aside, first + aside, last + aside, last - aside])
            canvas.fill([slab], _PAVING + rng.normal(0.0, 5.0))
    for bed in park.beds:
        # The map's outline is the border between bed and kerb.
        rings = [bed.outline, *bed.holes]
        for ring in rings:
            canvas.line(ring, 2 * _KERB_M, _KERB, closed=True)
        canvas.fill(rings, _SOIL + _BED_SPAN * bed.warmth)
    for center in park.hydrants.values():
        canvas.disc(center, 0.3, 30.0)
    for lamp in park.lamps:
        canvas.disc(lamp.center, lamp.radius_m, 105.0 + _HOT * lamp.warmth)
    levels = [_textured(canvas.grey, scenario, seed)]
    for _ in range(_LEVELS - 1):
        finer = levels[-1]
        half = cv2.resize(finer, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        levels.append(half.astype(np.uint8))
    return Ground(levels, canvas.north_edge_m, canvas.west_edge_m, scenario.resolution_m)


class _Canvas:
    """Draw on a picture with ground coordinates, to a sixteenth of a cell."""

    def __init__(self, scenario: ParkScenario) -> None:
        (south, north), (west, east) = scenario.north_m, scenario.east_m
        self.resolution_m = scenario.resolution_m
        self.north_edge_m = north + scenario.margin_m
        self.west_edge_m = west - scenario.margin_m
        side = 2 * scenario.margin_m
        # Every level has whole cells, so that the levels are exactly aligned.
        step = 2 ** (_LEVELS - 1)
        rows = step * round((north - south + side) / self.resolution_m / step)
        columns = step * round((east - west + side) / self.resolution_m / step)
        self.grey: Pixels = np.full((rows, columns), round(GRASS), np.uint8)

    def _cells(self, points: Array) -> npt.NDArray[np.int32]:
        """Return ground points (N, 2) in sixteenths of a cell, columns first, 0 = the middle."""
        columns = (points[:, 1] - self.west_edge_m) / self.resolution_m - 0.5
        rows = (self.north_edge_m - points[:, 0]) / self.resolution_m - 0.5
        cells = np.round(np.stack([columns, rows], -1) * 2**_SHIFT)
        return np.asarray(cells, np.int32)

    def fill(self, rings: Sequence[Array], grey: float) -> None:
        """Fill the first ring; the other rings are holes in it."""
        cells = [self._cells(ring) for ring in rings]
        cv2.fillPoly(self.grey, cells, grey, cv2.LINE_AA, _SHIFT)

    def line(self, line: Array, width_m: float, grey: float, *, closed: bool = False) -> None:
        width = max(1, round(width_m / self.resolution_m))
        cv2.polylines(self.grey, [self._cells(line)], closed, grey, width, cv2.LINE_AA, _SHIFT)

    def disc(self, center: Array, radius_m: float, grey: float) -> None:
        x, y = self._cells(center[None, :])[0].tolist()
        radius = round(radius_m / self.resolution_m * 2**_SHIFT)
        cv2.circle(self.grey, (x, y), radius, min(grey, 255.0), -1, cv2.LINE_AA, _SHIFT)


def _textured(grey: Pixels, scenario: ParkScenario, seed: int) -> Pixels:
    """Return the painting with grain of several sizes."""
    rng = generator(seed, "grain")
    rows, columns = grey.shape
    total = np.zeros((rows, columns), np.int16)  # hundredths of a grey level
    for size_m, std in _GRAINS:
        cell = max(1.0, size_m / scenario.resolution_m)
        coarse = rng.standard_normal((int(rows / cell) + 2, int(columns / cell) + 2), np.float32)
        grain = cv2.resize(coarse * (100 * std), (columns, rows), interpolation=cv2.INTER_CUBIC)
        total += grain.astype(np.int16)
    total //= 100
    total += grey
    return np.asarray(np.clip(total, 0, 255), np.uint8)


@dataclass(frozen=True, eq=False)
class Target:
    """Hold a warm object on the ground: a square, for a fire a disc, for a vehicle a rectangle."""

    id: str  # ``person 1``
    kind: str  # person, fire, vehicle
    center: Array  # (2,) m, north and east of the site's origin
    warmer_k: float  # contrast to the grass
    size_m: float  # side of a person, diameter of a fire, length of a vehicle
    heading_rad: float

    def covers(self, along: Floats, across: Floats) -> npt.NDArray[np.bool_]:
        """Return whether it covers places, m from its middle along and across its heading."""
        if self.kind == "fire":
            return np.asarray(along**2 + across**2 < (self.size_m / 2) ** 2)
        width_m = self.size_m * (_VEHICLE_WIDTH if self.kind == "vehicle" else 1)
        return np.asarray((np.abs(along) < self.size_m / 2) & (np.abs(across) < width_m / 2))


def targets_of(scenario: Scenario, seed: int) -> list[Target]:
    """Return the targets of a scenario: of each kind the given ones, then the seeded ones."""
    scene, park = scenario.scene, scenario.park
    low, high = np.transpose([park.north_m, park.east_m])
    targets = []
    for kind, placed, count in (
        ("person", scene.people_at, scene.people),
        ("fire", scene.fires_at, scene.fires),
        ("vehicle", scene.vehicles_at, scene.vehicles),
    ):
        rows = list(np.reshape(placed, (-1, 4)))
        for number in range(len(rows) + count):
            # Each target has its own generator, so that one more does not move the others.
            rng = generator(seed, f"{kind} {number + 1}")
            heading = rng.uniform(0.0, 2 * math.pi)
            drawn = [*rng.uniform(low, high), *(rng.uniform(*limits) for limits in _SEEDED[kind])]
            row = np.array(rows[number] if number < len(rows) else drawn)
            warmer_k, size_m = row[2:].tolist()
            name = f"{kind} {number + 1}"
            targets.append(Target(name, kind, row[:2], warmer_k, size_m, heading))
    return targets


def targets_text(targets: list[Target], plane: TangentPlane, relief: Relief = LEVEL) -> str:
    """Return the targets as GeoJSON points with ``id``, ``kind``, contrast (K) and size (m)."""
    features = []
    for target in targets:
        properties: dict[str, object] = {
            "id": target.id,
            "kind": target.kind,
            "warmer_k": round(target.warmer_k, 3),
            "size_m": round(target.size_m, 3),
        }
        features.append(point_feature(properties, target.center, plane, relief))
    return collection(features)


def draw_targets(picture: Floats, targets: Sequence[Target], north: Floats, east: Floats) -> None:
    """Draw targets into a picture (h, w) of grey levels, later ones over earlier ones.

    ``north`` and ``east`` (h, w) are the ground position that each pixel's middle sees, m.
    """
    if not targets:
        return
    middle = slice(picture.shape[1] // 2, picture.shape[1] // 2 + 2)
    ground = north[:, middle], east[:, middle]
    sides = [np.hypot(*(np.gradient(axis_m, axis=axis) for axis_m in ground)) for axis in (0, 1)]
    pixel_m = (sides[0] + sides[1])[:, :1]  # longest extent of a pixel of each row
    for target in targets:
        reach_m = pixel_m + target.size_m
        near = np.abs(north - target.center[0]) < reach_m
        near &= np.abs(east - target.center[1]) < reach_m
        near &= pixel_m < _COARSEST_M
        if near.any():
            marked = [np.flatnonzero(near.any(axis=axis)) for axis in (1, 0)]
            part = tuple(slice(max(int(k[0]) - 1, 0), int(k[-1]) + 2) for k in marked)
            share = _share(target, north[part], east[part])
            picture[part] += share * (GRASS + GREY_PER_K * target.warmer_k - picture[part])


def _share(target: Target, north: Floats, east: Floats) -> Floats:
    """Return the share (h, w) of each pixel that the target covers."""
    cos, sin = np.cos(target.heading_rad), np.sin(target.heading_rad)
    n, e = north - target.center[0], east - target.center[1]
    inside = target.covers(_in_parts(cos * n + sin * e), _in_parts(cos * e - sin * n))
    return np.asarray(inside.mean(axis=(0, 1)), np.float32)


def _in_parts(values: Floats) -> Floats:
    """Interpolate values (h, w) at the parts of each pixel: (parts, parts, h, w)."""
    by_row, by_column = np.gradient(values)
    rows, columns = np.meshgrid(_OFFSETS, _OFFSETS, indexing="ij")
    return np.asarray(
        values + rows[..., None, None] * by_row + columns[..., None, None] * by_column
    )


class Renderer:
    """Render frames; a frame depends only on its pose and its random generator."""

    def __init__(
        self,
        camera: Camera,
        ground: Ground,
        scenario: VideoScenario,
        targets: Sequence[Target] = (),
        relief: Relief = LEVEL,
    ) -> None:
        """Compute the ray of every pixel once."""
        self._shape = camera.height, camera.width
        self._targets = targets
        self._relief = relief
        self._ground = ground
        self._scenario = scenario
        v, u = np.mgrid[: camera.height, : camera.width]
        rays_c = camera.rays(np.stack([u.ravel(), v.ravel()], -1).astype(float))
        self._rays_c: Floats = rays_c.astype(np.float32)
        self._pixel_angle = 1 / min(camera.fx, camera.fy)
        off_axis = np.sum(self._rays_c[:, :2] ** 2, axis=1).reshape(self._shape)
        share = off_axis / off_axis.max()
        self._gain = (1 - scenario.vignetting * share).astype(np.float32)

    def frame(self, position_p: Array, q_pc: Array, rng: np.random.Generator) -> RawPixels:
        """Return a picture (h, w) of the ground from a pose (3,), (4,) in the plane ``p``."""
        rays_p = self._rays_c @ matrix_from_quat(q_pc).T.astype(np.float32)
        # Single precision is enough: 1e-5 m at some 100 m.
        place = position_p.astype(np.float32)
        height, descent = self._relief.descent(place, rays_p)
        on_ground = descent > height / _FAR_M
        depth = np.asarray(height / np.where(on_ground, descent, np.float32(1)), np.float32)
        north = (place[0] + depth * rays_p[:, 0]).reshape(self._shape)
        east = (place[1] + depth * rays_p[:, 1]).reshape(self._shape)
        middle = slice(self._shape[1] // 2, None, self._shape[1])
        # A pixel's size on the ground in every row: its sides' geometric mean. Along the view it
        # is stretched by the cosecant of the depression angle.
        slope = rays_p[middle, 2] / np.linalg.norm(rays_p[middle], axis=1)
        footprint = depth[middle] * self._pixel_angle / np.sqrt(np.maximum(slope, 1e-3))
        picture = self._sampled(north, east, footprint)
        draw_targets(picture, self._targets, north, east)
        picture[~on_ground.reshape(self._shape)] = 20.0  # the sky
        return self._sensed(picture, rng)

    def _sampled(self, north: Floats, east: Floats, footprint: Floats) -> Floats:
        """Sample the ground row by row, at the level whose cells have a pixel's size."""
        ground = self._ground
        levels = np.log2(np.maximum(footprint / ground.resolution_m, 1.0))
        levels = np.clip(np.floor(levels + 0.3), 0, len(ground.levels) - 1).astype(int)
        picture = np.empty(self._shape, np.float32)
        for level in np.unique(levels):
            rows = np.flatnonzero(levels == level)
            cell = ground.resolution_m * 2 ** int(level)
            column = (east[rows] - ground.west_edge_m) / cell - 0.5
            row = (ground.north_edge_m - north[rows]) / cell - 0.5
            picture[rows] = cv2.remap(
                ground.levels[level], column, row, cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT
            )
        return picture

    def _sensed(self, picture: Floats, rng: np.random.Generator) -> RawPixels:
        """Apply optics and detector: blur, vignetting, noise, whole numbers."""
        scenario = self._scenario
        if scenario.blur_px > 0:
            cv2.GaussianBlur(picture, (0, 0), scenario.blur_px, dst=picture)
        picture = picture * self._gain
        picture += scenario.noise_grey * rng.standard_normal(self._shape, np.float32)
        if scenario.bits == 16:
            counts = COUNTS_OF_0 + COUNTS_PER_GREY * picture
            return np.asarray(np.clip(np.rint(counts), 0, 65535), np.uint16)
        return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)
