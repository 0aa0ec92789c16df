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
"""Resample a picture to the tiles of the ground that it shows, and blend the views of a tile.

All rasters of one run share a lattice: pixel (0, 0) has its upper left corner at x = y = 0 of a
projected plane, columns count to the east and rows to the south. Ground points are computed at
nodes: one in the middle of each block of ``STEP_PX`` x ``STEP_PX`` pixels of the tile, and of the
blocks around the tile. Values at pixels are interpolated between nodes.

Each pixel of a tile is projected into the picture, through the lens model, and takes the value
there. Its score says how good the view is: the ground sample distance, m, times 1 + rho^2, where
rho is 0 in the picture's middle and 1 in its corners. In a rim of the picture the score grows
evenly, to three times as much at the edge, so that a mosaic fades from one picture to the next
before the edge. The lowest score is the best view.

The ground sample distance is the root of the area that a pixel covers: z^3 / (fx fy h), where z
is the depth along the optical axis and h the camera's height above the surface's tangent plane.

In a mosaic the value of a pixel is the mean of all views with the weights (best score / score)^32.
A view whose score is 10 % higher than the best has a weight of 5 %, at 15 % it is 1 %: two views
count only near a seam, where they are equally good. In the rim of a picture the seam is an eighth
of the rim wide. The sums are kept relative to the best score so far, so that the order of the
pictures does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Protocol, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, Terrain, hidden, locate
from tirgeo_ros.core.types.arrays import Array, BoolArray, RawPixels
from tirgeo_ros.core.types.poses import CameraPose

TILE_PX, STEP_PX = 512, 4
NODES = TILE_PX // STEP_PX + 2

#: Column and row of a tile: its first pixel is at TILE_PX times these.
TileKey: TypeAlias = tuple[int, int]
Floats: TypeAlias = npt.NDArray[np.float32]
_KEPT = 48  # tiles whose nodes are kept: 0.8 MB each
# The view of one picture.
#: Nodes up to this many pixels outside the picture are used too: pixels of the picture may lie
#: between them.
_MARGIN_PX = 32.0
_RIM, _AT_EDGE = 1 / 8, 3.0  # rim over shorter side; factor of the score at the edge
_LEAST_PX = 16  # shorter side of a reduced picture
_SEEDS = 5  # pixels along each side of the picture from which its tiles are searched
#: On an elevation model, tiles are searched up to where level ground is seen at this share of the
#: least angle: behind a slope seen at too small an angle, another one may face the camera.
_FLATTER = 0.5
#: Step, in nodes, between the lines of sight that are checked for obstacles.
_SIGHT_STEP = 4
# The mosaic.
_SQUARINGS = 5  # (best / score) to the power of 2^5


class ProjectedPlane(Protocol):
    """Define a plane in metres: x to the east, y to the north."""

    def metres(self, degrees: Array) -> Array:
        """Return x, y (n, 2) in metres of longitudes and latitudes (n, 2) in degrees."""

    def degrees(self, metres: Array) -> Array:
        """Return longitudes and latitudes (n, 2) in degrees of x, y (n, 2) in metres."""


class GroundNodes(NamedTuple):
    """Hold the ground at the nodes of a tile, NED in the map's plane."""

    #: (NODES, NODES, 3) m; where the ground's height is unknown, at its lowest known height.
    points_n: Array
    normals_n: Array  # (NODES, NODES, 3) unit vectors, upwards; nan where the height is unknown


class GroundTiles:
    """Compute the ground at the nodes of a lattice of ``pixel_m``; the newest tiles are kept."""

    def __init__(
        self, projected: ProjectedPlane, pixel_m: float, plane: TangentPlane, ground: Ground
    ) -> None:
        self.pixel_m, self.plane, self.ground = pixel_m, plane, ground
        self._projected = projected
        self.nodes = lru_cache(maxsize=_KEPT)(self._nodes)

    def keys(self, points_n: Array) -> set[TileKey]:
        """Return the tiles in which points (N, 3), NED in the map's plane, lie."""
        latitude, longitude, _ = self.plane.geodetic_from_ned(points_n)
        x, y = self._projected.metres(np.degrees(np.stack([longitude, latitude], axis=1))).T
        places = np.floor(np.stack([x, -y], axis=1) / (self.pixel_m * TILE_PX))
        return {(int(column), int(row)) for column, row in places}

    def _nodes(self, key: TileKey) -> GroundNodes:
        """Return the ground at a tile's nodes."""
        blocks = np.arange(-1, NODES - 1) * STEP_PX + STEP_PX / 2
        x, y = (
            sign * (number * TILE_PX + blocks) * self.pixel_m
            for sign, number in zip((1, -1), key, strict=True)
        )
        metres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        longitude, latitude = np.radians(self._projected.degrees(metres)).T
        ground = self.ground
        heights = ground.height_m(latitude, longitude) if isinstance(ground, Terrain) else ground
        points_n = self._points_n(latitude, longitude, heights)
        normals_n = np.cross(np.gradient(points_n, axis=0), np.gradient(points_n, axis=1))
        normals_n /= np.linalg.norm(normals_n, axis=2, keepdims=True)
        if isinstance(ground, Terrain):
            lowest_n = self._points_n(latitude, longitude, ground.lowest_m)
            points_n = np.where(np.isnan(points_n), lowest_n, points_n)
        return GroundNodes(points_n, normals_n)

    def _points_n(self, latitude: Array, longitude: Array, height_m: Array | float) -> Array:
        points_n = self.plane.ned_from_geodetic(latitude, longitude, height_m)
        return points_n.reshape(NODES, NODES, 3)


def at_pixels(nodes: Array) -> Floats:
    """Return values at pixels (h * STEP_PX, w * STEP_PX) from those at nodes (h, w), bilinear."""
    size = nodes.shape[1] * STEP_PX, nodes.shape[0] * STEP_PX
    return np.asarray(cv2.resize(nodes.astype(np.float32), size, interpolation=cv2.INTER_LINEAR))


class Patch(NamedTuple):
    """Hold the part of a tile that a picture shows, as rows and columns of the tile."""

    rows: slice
    columns: slice
    values: RawPixels  # (h, w) or (h, w, 3), of the picture's type
    seen: BoolArray  # (h, w)
    score: Floats  # (h, w); inf where it is not seen


class _NodeView(NamedTuple):
    """Hold what a picture shows at the nodes of a tile; nan where it shows nothing."""

    uv: Array  # (NODES, NODES, 2) pixels
    score: Array  # (NODES, NODES), without the rim
    near: BoolArray  # (NODES, NODES) in the picture or near its edge, even if it is not seen


class FrameView:
    """Resample one picture, (h, w) or (h, w, 3).

    Ground that is seen at an angle below ``grazing_rad`` is left out. With ``nearest`` each pixel
    takes the value of one pixel of the picture. Otherwise values are interpolated, and a picture
    that is much finer than the lattice is first reduced by averaging 2, 4, ... pixels.
    """

    def __init__(
        self,
        tiles: GroundTiles,
        camera: Camera,
        pose: CameraPose,
        pixels: RawPixels,
        grazing_rad: float,
        *,
        nearest: bool = False,
    ) -> None:
        self._tiles, self._camera, self._pose = tiles, camera, pose
        self._terrain = tiles.ground if isinstance(tiles.ground, Terrain) else None
        self._least_sine = math.sin(grazing_rad)
        self._rotation_nc = matrix_from_quat(pose.q_nc)
        self._seeds_n = seeds(camera, pose, tiles.plane, tiles.ground)
        self._way = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
        self._factor = 1
        if not nearest:  # the power of two by which the picture's middle is finer than the lattice
            gsd_m = level_gsd_m(camera, pose, tiles.plane, self._seeds_n, grazing_rad)
            finite = gsd_m[np.isfinite(gsd_m)]
            times = tiles.pixel_m / float(np.median(finite)) if finite.size else 1.0
            most = max(min(camera.width, camera.height) // _LEAST_PX, 1)
            self._factor = int(2 ** math.floor(math.log2(min(max(times, 1.0), most))))
        if self._factor > 1:
            # Whole blocks only: the rest of a row is less than a pixel of the reduced picture.
            width, height = camera.width // self._factor, camera.height // self._factor
            pixels = pixels[: height * self._factor, : width * self._factor]
            pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
        self._pixels = pixels

    def patches(self) -> Iterator[tuple[TileKey, Patch]]:
        """Yield the picture's part of each tile: first the tiles of its seeds, then neighbours."""
        on_ground = np.isfinite(self._seeds_n[:, 0])
        waiting = sorted(self._tiles.keys(self._seeds_n[on_ground]))
        begun = set(waiting)
        while waiting:
            key = waiting.pop()
            view = self._at_nodes(self._tiles.nodes(key))
            if not view.near.any():
                continue
            (column, row), near = key, view.near
            reaches = {
                (column, row - 1): near[0],
                (column, row + 1): near[-1],
                (column - 1, row): near[:, 0],
                (column + 1, row): near[:, -1],
            }
            for neighbour, edge in reaches.items():
                if edge.any() and neighbour not in begun:
                    begun.add(neighbour)
                    waiting.append(neighbour)
            patch = self._patch(view)
            if patch is not None:
                yield key, patch

    def _at_nodes(self, nodes: GroundNodes) -> _NodeView:
        camera = self._camera
        offset_n = nodes.points_n - self._pose.position_n
        uv, valid = camera.project(offset_n.reshape(-1, 3) @ self._rotation_nc)
        uv, valid = uv.reshape(NODES, NODES, 2), valid.reshape(NODES, NODES)
        margin_px = _MARGIN_PX * self._factor
        with np.errstate(invalid="ignore"):
            above_m = -np.einsum("ijk,ijk->ij", nodes.normals_n, offset_n)
            least_m = self._least_sine * np.linalg.norm(offset_n, axis=2)
            reach = np.array([camera.width, camera.height]) + margin_px
            near = valid & ((uv > -margin_px) & (uv < reach)).all(axis=2)
            near &= offset_n[..., 2] > least_m * (_FLATTER if self._terrain else 1.0)
            seen = near & (above_m > least_m)
            if self._terrain and seen.any():
                few_n = nodes.points_n[::_SIGHT_STEP, ::_SIGHT_STEP]
                places = self._tiles.plane, self._pose.position_n, few_n.reshape(-1, 3)
                is_hidden = hidden(self._terrain, *places).reshape(few_n.shape[:2])
                is_hidden = is_hidden.repeat(_SIGHT_STEP, axis=0).repeat(_SIGHT_STEP, axis=1)
                seen &= ~is_hidden[:NODES, :NODES]
            gsd_m = _gsd_m(camera, offset_n @ self._rotation_nc[:, 2], above_m)
            aside = uv / (0.5 * np.array([camera.width - 1, camera.height - 1])) - 1
            score = gsd_m * (1 + 0.5 * np.square(aside).sum(axis=2))
        uv[~seen] = np.nan
        return _NodeView(uv, score, near)

    def _patch(self, view: _NodeView) -> Patch | None:
        """Return the picture's part of a tile, in the box of its near nodes; None without one."""
        box = _span(view.near, 1), _span(view.near, 0)
        u, v, score = (
            _cropped(at_pixels(values[box]), box)
            for values in (view.uv[..., 0], view.uv[..., 1], view.score)
        )
        right, bottom = self._camera.width - 0.5, self._camera.height - 0.5
        inside_px = np.minimum(np.minimum(u + 0.5, right - u), np.minimum(v + 0.5, bottom - v))
        seen = inside_px >= 0  # False for nan
        if not seen.any():
            return None
        rim_px = _RIM * min(self._camera.width, self._camera.height)
        outside = np.maximum(1 - inside_px[seen] / np.float32(rim_px), 0)
        scores = np.full(seen.shape, np.inf, np.float32)
        scores[seen] = score[seen] * np.float32(_AT_EDGE) ** outside
        columns, rows = (
            np.where(seen, (places + 0.5) / self._factor - 0.5, -1.0).astype(np.float32)
            for places in (u, v)
        )
        values = cv2.remap(self._pixels, columns, rows, self._way, borderMode=cv2.BORDER_REPLICATE)
        return Patch(_pixels_of(box[0]), _pixels_of(box[1]), np.asarray(values), seen, scores)


def seeds(camera: Camera, pose: CameraPose, plane: TangentPlane, ground: Ground) -> Array:
    """Return ground points (N, 3), NED, at pixels all over a picture; nan without ground there."""
    u, v = (np.linspace(0.0, size - 1.0, _SEEDS) for size in (camera.width, camera.height))
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    return locate(camera, pose, uv, plane, ground)[0]


def level_gsd_m(
    camera: Camera, pose: CameraPose, plane: TangentPlane, points_n: Array, grazing_rad: float
) -> Array:
    """Return ground sample distances (N,), m, as if the ground were level at points (N, 3).

    They are nan where the line of sight meets level ground at less than ``grazing_rad``.
    """
    latitude, longitude, _ = plane.geodetic_from_ned(points_n)
    offset_n = points_n - pose.position_n
    above_m = -(plane.up_n(latitude, longitude) * offset_n).sum(axis=1)
    depth_m = offset_n @ matrix_from_quat(pose.q_nc)[:, 2]
    with np.errstate(invalid="ignore"):
        seen = above_m > math.sin(grazing_rad) * np.linalg.norm(offset_n, axis=1)
        return np.where(seen, _gsd_m(camera, depth_m, above_m), np.nan)


def _gsd_m(camera: Camera, depth_m: Array, above_m: Array) -> Array:
    """Return ground sample distances from depths and heights over the surface, of any shape."""
    return np.sqrt(depth_m**3 / (camera.fx * camera.fy * above_m))


def _span(near: BoolArray, across: int) -> slice:
    """Return the nodes from the first to the last that is near, and one more on each side."""
    first, last = np.flatnonzero(np.any(near, axis=across))[[0, -1]].tolist()
    return slice(max(first - 1, 0), min(last + 2, NODES))


def _pixels_of(span: slice) -> slice:
    """Return a tile's pixels in the blocks of a span of nodes; the outermost are outside it."""
    first, last = (span.start - 1) * STEP_PX, (span.stop - 1) * STEP_PX
    return slice(max(first, 0), min(last, TILE_PX))


def _cropped(pixels: Floats, box: tuple[slice, slice]) -> Floats:
    """Return interpolated pixels without those outside the tile."""
    rows, columns = (
        slice(_pixels_of(span).start - first, _pixels_of(span).stop - first)
        for span, first in ((span, (span.start - 1) * STEP_PX) for span in box)
    )
    return pixels[rows, columns]


@dataclass(frozen=True)
class MosaicTile:
    """Hold sums over the views of a tile: of weighted values, of weights, and the best score."""

    total: Floats  # (TILE_PX, TILE_PX, bands)
    weight: Floats  # (TILE_PX, TILE_PX); 0 where nothing was seen
    best: Floats  # (TILE_PX, TILE_PX); inf where nothing was seen

    @classmethod
    def empty(cls, bands: int) -> MosaicTile:
        """Return a tile that no picture has shown yet."""
        size = TILE_PX, TILE_PX
        total, weight = np.zeros((*size, bands), np.float32), np.zeros(size, np.float32)
        return cls(total, weight, np.full(size, np.inf, np.float32))

    def add(self, patch: Patch, *, hard: bool = False) -> None:
        """Blend a view in; with ``hard`` only the best view counts, and its values are kept."""
        box = patch.rows, patch.columns
        values = patch.values.reshape(*patch.seen.shape, -1)
        if hard:
            better = patch.score < self.best[box]
            self.total[box][better], self.weight[box][better] = values[better], 1.0
        else:
            seen = patch.seen
            former, score = self.best[box][seen], patch.score[seen]
            best: Floats = np.minimum(former, score)
            kept, weight = _weight(best, former), _weight(best, score)
            self.weight[box][seen] = kept * self.weight[box][seen] + weight
            former_total = self.total[box][seen]
            self.total[box][seen] = kept[:, None] * former_total + weight[:, None] * values[seen]
        self.best[box] = np.minimum(self.best[box], patch.score)

    def values(self) -> tuple[Floats, BoolArray]:
        """Return the mosaic (TILE_PX, TILE_PX, bands), and which of its pixels were seen."""
        # The best view has the weight 1, so the divisor 1 only replaces 0.
        values = self.total / np.maximum(self.weight, np.float32(1))[..., None]
        return np.asarray(values, np.float32), self.weight > 0


def _weight(best: Floats, score: Floats) -> Floats:
    """Return the weights of scores relative to the best ones."""
    weight: Floats = best / score
    for _ in range(_SQUARINGS):
        weight *= weight
    return weight
