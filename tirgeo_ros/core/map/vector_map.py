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
"""Define a map as read from its file, and build it in its tangent plane, draped on the ground.

The ground is one height, an elevation model, or the features' own heights.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, Terrain, is_given
from tirgeo_ros.core.map.polylines import Boxes, Details, Polylines, joined
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray
from tirgeo_ros.core.types.errors import ConfigError

Colour = tuple[int, int, int]  # blue, green, red, 0 to 255

#: Up to this many vertices, lines get one in each cell of the elevation model. A map of a whole
#: county on a 1 m model would need more memory than a computer has.
MOST_VERTICES = 5_000_000
#: Segments are first cut into pieces of this many cells, to leave out pieces outside the model.
_FIRST_CELLS = 256.0


@dataclass(frozen=True, slots=True)
class GeoFeature:
    """Hold a line, an outline or a point of a map; a single point is drawn as a mark."""

    label: str
    closed: bool  # an outline: its last point is joined to its first
    points: Array  # (N, 3) latitude, longitude (rad), ellipsoidal height (m), nan = unknown
    group: int = -1  # parts of one feature share a number >= 0 and one label; closed parts inside
    # others are holes (even-odd rule)


@dataclass(frozen=True, slots=True)
class LayerStyle:
    """Hold how a layer is drawn."""

    line_bgr: Colour = (0, 255, 255)
    width_px: int = 1  # 1 to 5
    fill_bgr: Colour | None = None  # fill of outlines; None: not filled
    fill_opacity: float = 0.25  # 0 to 1
    labels: bool = True
    #: The layer is shown while a pixel at the picture's centre spans this range of ground, m.
    scale_m_px: tuple[float, float] = (0.0, math.inf)


@dataclass(frozen=True, slots=True)
class MapLayer:
    """Hold features of one style; they are drawn over the features of earlier layers."""

    name: str
    features: Sequence[GeoFeature]
    style: LayerStyle = LayerStyle()
    sigma_m: float | None = None  # standard deviation of its horizontal positions; None: unknown
    left_out: tuple[str, ...] = ()  # what is left out or changed from the file, one line each


def check_heights(layers: Sequence[MapLayer], ground: Ground) -> None:
    """Raise ConfigError if the ground is the map's own heights and some of them are unknown."""
    if is_given(ground):
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


def drape(lines: Polylines, plane: TangentPlane, ground: Ground) -> tuple[Polylines, float]:
    """Drape lines (3, V) of latitude, longitude (rad), height (m) on the ground.

    Return them as north, east, down in the plane, m. On an elevation model the lines get a vertex
    for each cell, so that they follow it, but at most ``MOST_VERTICES``; a vertex is nan where the
    model has no height. The second result is the number of cells between two vertices, 1 or more.
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
    draped = _placed(flat, plane, latitude, longitude, ground.height_m(latitude, longitude))
    return draped, step


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


@dataclass(frozen=True)
class VectorMap:
    """Hold a map in the tangent plane: north, east, down from its origin, metres.

    The owners of ``lines`` and ``marks`` (3, V) are indices of features. ``labels`` has one entry
    for each feature; ``labelled`` (features,) is False where it is empty. Outlines are lines that
    end where they begin. ``layers`` are in the order of drawing, without their features; ``layer``
    (features,) is the index of each feature's layer, in ascending order.
    ``details`` are the lines at their levels of detail. ``rings`` are the outlines of layers with
    a fill, and ``ring_boxes`` enclose them. ``without_ground`` is the number of features with
    parts on unknown ground; these parts are left out. ``notes`` are messages for the user.
    """

    labels: tuple[str, ...]
    labelled: BoolArray
    layers: tuple[MapLayer, ...]
    layer: IntArray
    lines: Polylines
    marks: Polylines
    details: Details
    rings: Polylines
    ring_boxes: Boxes
    without_ground: int
    notes: tuple[str, ...]

    @classmethod
    def from_layers(
        cls, layers: Sequence[MapLayer], plane: TangentPlane, ground: Ground = math.nan
    ) -> VectorMap:
        """Drape layers on the ground in a plane; raise ConfigError for unknown heights."""
        check_heights(layers, ground)
        of_layers = [[f for f in layer.features if len(f.points)] for layer in layers]
        labels, layer, owner = _owners(of_layers)
        features = list(chain.from_iterable(of_layers))
        single = np.array([len(feature.points) == 1 for feature in features], bool)
        parts = [
            np.concatenate([each.points, each.points[:1]])
            if each.closed and not np.array_equal(each.points[0], each.points[-1])
            else each.points
            for each in features
        ]
        lines, cells = drape(_joined(parts, owner, np.flatnonzero(~single)), plane, ground)
        marks, _ = drape(_joined(parts, owner, np.flatnonzero(single)), plane, ground)
        filled = np.array([each.style.fill_bgr is not None for each in layers], bool)
        rings = np.array([feature.closed for feature in features], bool)[~single]
        rings &= filled[layer[lines.owner]]
        lines, rings, lost = _on_ground(lines, rings)
        marks, _, lost_marks = _on_ground(marks, np.zeros(len(marks), bool))
        without_ground = len(np.union1d(lost, lost_marks))
        notes = []
        if without_ground:
            notes.append(
                f"map: {without_ground} of {len(labels)} features lie where the elevation model "
                "has no height, and are not drawn there"
            )
        if cells > 1:
            notes.append(
                "map: the lines are too long for a vertex in each cell of the elevation model: "
                f"they have one every {cells:.1f} cells; cut the map to the area of the flight"
            )
        filled_rings = lines.select(np.flatnonzero(rings))
        places = filled_rings.points
        return cls(
            labels=labels,
            labelled=np.array([bool(label) for label in labels], bool),
            layers=tuple(replace(each, features=()) for each in layers),
            layer=layer,
            lines=lines,
            marks=marks,
            details=Details.of(lines, layer[lines.owner]),
            rings=filled_rings,
            ring_boxes=Boxes.around(places, places, filled_rings.starts),
            without_ground=without_ground,
            notes=tuple(notes),
        )


def _owners(
    of_layers: Sequence[Sequence[GeoFeature]],
) -> tuple[tuple[str, ...], IntArray, IntArray]:
    """Return the labels and layers of all features, and the feature's index for each part.

    Parts of one group in one layer are one feature.
    """
    keys = [
        (layer, f.group, -1) if f.group >= 0 else (layer, -1, i)
        for layer, features in enumerate(of_layers)
        for i, f in enumerate(features)
    ]
    index = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    labels = [""] * len(index)
    for key, feature in zip(keys, chain.from_iterable(of_layers), strict=True):
        labels[index[key]] = labels[index[key]] or feature.label
    layer = np.array([key[0] for key in index], np.int64)
    return tuple(labels), layer, np.array([index[key] for key in keys], np.int64)


def _joined(parts: Sequence[Array], owner: IntArray, which: IntArray) -> Polylines:
    """Return the parts with these indices as lines (3, V): latitude, longitude, height."""
    chosen = [parts[i] for i in which.tolist()]
    starts = np.cumsum([0, *map(len, chosen)], dtype=np.int64)
    geodetic = np.concatenate([np.empty((0, 3)), *chosen])
    return Polylines(np.ascontiguousarray(geodetic.T), starts, owner[which])


def _on_ground(lines: Polylines, rings: BoolArray) -> tuple[Polylines, BoolArray, IntArray]:
    """Return the finite parts of lines, whether each is a whole ring, and the features cut."""
    finite: BoolArray = np.isfinite(lines.points.sum(axis=0))
    if finite.all():
        return lines, rings, np.empty(0, np.int64)
    unknown = np.cumsum(np.append(0, ~finite))
    whole = np.diff(unknown[lines.starts]) == 0
    broken = lines.select(np.flatnonzero(~whole))
    finite = np.isfinite(broken.points.sum(axis=0))
    leave = broken.links() & finite[:-1] & finite[1:]
    left = broken.cut(np.zeros(len(leave)), leave.astype(float))
    lines = joined(lines.select(np.flatnonzero(whole)), left)
    rings = np.append(rings[whole], np.zeros(len(left), bool))
    return lines, rings, np.unique(broken.owner)
