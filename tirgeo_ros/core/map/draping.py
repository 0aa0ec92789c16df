"""Drape features on the ground: at one height, on an elevation model, or at their own heights."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ConfigError

#: One ellipsoidal height (m) for all features, nan for their own heights, or an elevation model.
Ground = float | Terrain

#: A 1 m model under the map of a whole county would need more memory than there is. Above this
#: number, lines get fewer vertices than cells.
MOST_VERTICES = 5_000_000
#: Segments are first cut into pieces of this many cells, to leave out pieces outside the model.
_FIRST_CELLS = 256.0


def check_heights(layers: Sequence[MapLayer], ground: Ground) -> None:
    """Raise ConfigError if the ground is the map's own heights and some of them are unknown."""
    if isinstance(ground, Terrain) or math.isfinite(ground):
        return
    for layer in layers:
        unknown = sum(not np.isfinite(feature.points[:, 2]).all() for feature in layer.features)
        if unknown:
            name = f" layer {layer.name!r}:" if layer.name else ""
            raise ConfigError(
                f"map:{name} {unknown} of {len(layer.features)} features have no height; set "
                "ground_height_m (--ground-height) to the ellipsoidal height of the ground, or "
                "give an elevation model (dem)"
            )


def lay(lines: Polylines, plane: TangentPlane, ground: Ground) -> tuple[Polylines, float]:
    """Drape lines (3, V) of latitude, longitude (rad), height (m) on the ground.

    Return them as north, east, down in the plane, m. On an elevation model the lines get a vertex
    for each cell, so that they follow it, or ``MOST_VERTICES`` in all; vertices are nan where it
    has no height. The second result is the number of cells from vertex to vertex, 1 or more.
    """
    if not isinstance(ground, Terrain):
        height = lines.points[2]
        height = np.full_like(height, ground) if math.isfinite(ground) else height
        return _placed(lines, plane, lines.points[0], lines.points[1], height), 1.0
    latitude, longitude = lines.points[:2]
    flat = _placed(lines, plane, latitude, longitude, np.zeros_like(latitude))
    step = 1.0
    for cells in (_FIRST_CELLS, 1.0):
        spans = _cells_spanned(latitude, longitude, ground) * flat.links() / cells
        step = max(1.0, float(spans.sum()) / MOST_VERTICES)
        flat = flat.subdivided(np.maximum(np.ceil(spans / step), 1.0).astype(np.int64))
        latitude, longitude, _ = plane.geodetic_from_ned(flat.points.T)
    laid = _placed(flat, plane, latitude, longitude, ground.height_m(latitude, longitude))
    return laid, step


def _cells_spanned(latitude: Array, longitude: Array, terrain: Terrain) -> Array:
    """Return (V - 1,) the number of cells from each point to the next; 0 outside the model."""
    rows, columns = terrain.heights_m.shape
    column, row = (
        np.nan_to_num(each, nan=-1.0, posinf=-1.0, neginf=-1.0)
        for each in terrain.grid_of(latitude, longitude)
    )
    # If clamping to the grid makes both ends equal, the segment lies outside the grid.
    rim = np.stack([np.clip(column, 0, columns - 1), np.clip(row, 0, rows - 1)])
    crosses = (np.diff(rim, axis=1) != 0).any(axis=0)
    return np.where(crosses, np.hypot(np.diff(column), np.diff(row)), 0.0)


def _placed(
    lines: Polylines, plane: TangentPlane, latitude: Array, longitude: Array, height: Array
) -> Polylines:
    points_n = plane.ned_from_geodetic(latitude, longitude, height)
    return Polylines(np.ascontiguousarray(points_n.T), lines.starts, lines.owner)
