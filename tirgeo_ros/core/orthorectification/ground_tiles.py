"""Divide the ground into square tiles of pixels, and hold the places of the pixels in space.

All rasters of one run share a lattice: pixel (0, 0) has its upper left corner at x = y = 0 of a
projected plane, columns count to the east and rows to the south. Places are computed at nodes,
one for each block of ``STEP_PX`` x ``STEP_PX`` pixels, in its middle, and one more block around
the tile. Values at pixels are interpolated between nodes.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple, Protocol, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.types.arrays import Array

TILE_PX, STEP_PX = 512, 4
NODES = TILE_PX // STEP_PX + 2

#: Column and row of a tile: it begins at TILE_PX times that in pixels.
TileKey: TypeAlias = tuple[int, int]
Floats: TypeAlias = npt.NDArray[np.float32]
_KEPT = 48  # tiles whose nodes are kept: 0.8 MB each


class ProjectedPlane(Protocol):
    """Define a plane in metres: x to the east, y to the north."""

    def metres(self, degrees: Array) -> Array:
        """Return x, y (n, 2) in metres of longitudes and latitudes (n, 2) in degrees."""

    def degrees(self, metres: Array) -> Array:
        """Return longitudes and latitudes (n, 2) in degrees of x, y (n, 2) in metres."""


class GroundNodes(NamedTuple):
    """Hold the ground at the nodes of a tile, NED in the map's plane."""

    points_n: (
        Array  # (NODES, NODES, 3) m; as low as all known ground where its height is not known
    )
    normals_n: Array  # (NODES, NODES, 3) unit vectors, upwards; nan where it is not known


class GroundTiles:
    """Compute the ground's places for a lattice of ``pixel_m``; the newest tiles are kept."""

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
        points_n = self._points_n(latitude, longitude, self._heights_m(latitude, longitude))
        normals_n = np.cross(np.gradient(points_n, axis=0), np.gradient(points_n, axis=1))
        normals_n /= np.linalg.norm(normals_n, axis=2, keepdims=True)
        if isinstance(self.ground, Terrain):
            lowest_n = self._points_n(latitude, longitude, self.ground.lowest_m)
            points_n = np.where(np.isnan(points_n), lowest_n, points_n)
        return GroundNodes(points_n, normals_n)

    def _heights_m(self, latitude: Array, longitude: Array) -> Array | float:
        ground = self.ground
        return ground.height_m(latitude, longitude) if isinstance(ground, Terrain) else ground

    def _points_n(self, latitude: Array, longitude: Array, height_m: Array | float) -> Array:
        points_n = self.plane.ned_from_geodetic(latitude, longitude, height_m)
        return points_n.reshape(NODES, NODES, 3)


def at_pixels(nodes: Array) -> Floats:
    """Return values at pixels (h * STEP_PX, w * STEP_PX) from those at nodes (h, w), bilinear."""
    size = nodes.shape[1] * STEP_PX, nodes.shape[0] * STEP_PX
    return np.asarray(cv2.resize(nodes.astype(np.float32), size, interpolation=cv2.INTER_LINEAR))
