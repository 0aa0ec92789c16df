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
"""Drape the layers of a map on the ground, and compute what a camera sees of them, in pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates, FrameConfidence
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, is_given
from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.map.vector_map import LayerStyle, MapLayer, VectorMap, check_heights
from tirgeo_ros.core.map.visibility import View, VisibleLines, why_absent
from tirgeo_ros.core.overlay.label_placement import AnchorFinder, Features
from tirgeo_ros.core.overlay.uncertainty_rendering import Anchors, Marked, marked, with_marks
from tirgeo_ros.core.overlay.written_text import LONGEST, can_shape, writable
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import cut
from tirgeo_ros.core.types.poses import CameraPose


@dataclass(frozen=True, slots=True)
class DrapedMap:
    """Hold a map draped on the ground, without the layers that it was made from."""

    plane: TangentPlane
    map: VectorMap
    features: int  # number of features in the layers
    level_m: float  # median of the map's own heights; nan if a ground is given
    first_n: Array | None = None  # (3,) the layers' first point, on the ellipsoid; NED, m


def drape_layers(layers: Sequence[MapLayer], plane: TangentPlane, ground: Ground) -> DrapedMap:
    """Drape layers on the ground, which is slow. Raises ConfigError as VectorMap does."""
    check_heights(layers, ground)
    features = sum(len(layer.features) for layer in layers)
    vector_map = VectorMap.from_layers(layers, plane, ground)
    # Labels that no typeface here can write are left out, and a note says so.
    labels, labelled = vector_map.labels, vector_map.labelled.copy()
    lost = [i for i in np.flatnonzero(labelled).tolist() if not writable(labels[i])]
    if lost:
        labelled[lost] = False
        needed = "a typeface with their letters" + ("" if can_shape() else ", or libfribidi0")
        example = cut(labels[lost[0]], LONGEST)
        note = f"map: labels not drawn: {len(lost)}, such as {example!r}; install {needed}"
        notes = (*vector_map.notes, note)
        vector_map = replace(vector_map, labelled=labelled, notes=notes)
    places = [feature.points for layer in layers for feature in layer.features]
    level_m = math.nan
    if places and not is_given(ground):
        level_m = float(np.median(np.concatenate(places)[:, 2]))
    first_n = None
    if places:
        latitude, longitude, _ = places[0][0]
        first_n = plane.ned_from_geodetic(latitude, longitude, 0.0)
    return DrapedMap(plane, vector_map, features, level_m, first_n)


class VisibleMap(NamedTuple):
    """Hold the visible part of a map."""

    areas: VisibleLines
    lines: VisibleLines
    marks: VisibleLines
    hidden: bool  # whether features in view are left out because of their layers' scale range

    @property
    def empty(self) -> bool:
        """Return whether there is nothing to draw."""
        return not (len(self.areas) or len(self.lines) or len(self.marks))


@dataclass(frozen=True, slots=True)
class MapShapes:
    """Hold what is seen of a map in one picture, in its pixels.

    Pixel (0, 0) is the middle of the first one. Each line and mark is of a feature, its
    ``owner``, an index into ``map.labels`` and ``map.layer``. Nothing here depends on the painter.
    """

    map: VectorMap
    areas: Polylines  # (2, V) rings; those of one owner form one area, by the even-odd rule
    marks: Polylines  # (2, N) of one point each
    labelled: Features  # candidates for labels, the most important first
    anchors: Anchors  # of the labelled features, then of the nearest other marks
    marked: Marked  # lines (2, V) with their opacity, ellipses of the anchors
    ellipses: bool  # whether they are drawn


class MapShaper:
    """Compute the shapes of one draped map, frame after frame."""

    def __init__(self, config: ConfidenceConfig, draped: DrapedMap) -> None:
        self.draped, self.confidence = draped, config
        self._map = vector_map = draped.map
        ranges = [layer.style.scale_m_px for layer in vector_map.layers]
        self._scales_m_px = np.array(ranges, float).reshape(-1, 2)
        # Position sigma of each feature's layer, m; nan if the style has none.
        layer_m = [math.nan if m.sigma_m is None else m.sigma_m for m in vector_map.layers]
        sigmas_m = np.array(layer_m, float)[vector_map.layer]
        self._sigmas_m = None if np.isnan(sigmas_m).all() else sigmas_m
        self._anchors = AnchorFinder(vector_map)
        #: Whether a layer has a limited scale range.
        self.depends_on_scale = any(limits != LayerStyle().scale_m_px for limits in ranges)

    def visible(self, view: View, pose: CameraPose, scale_m_px: float, far_m: float) -> VisibleMap:
        """Return what is in view: areas, and lines and marks up to ``far_m`` ahead.

        ``scale_m_px`` is the ground length that the middle pixel spans, nan without ground.
        """
        of_map = self._map, pose
        in_view = view.areas(*of_map), view.lines(*of_map, far_m), view.marks(*of_map, far_m)
        areas, lines, marks = (self._at_scale(each, scale_m_px) for each in in_view)
        shown = len(areas) + len(lines) + len(marks)
        return VisibleMap(areas, lines, marks, hidden=shown < sum(map(len, in_view)))

    def shapes(
        self,
        camera: Camera,
        pose: CameraPose,
        rates: CameraRates | None,
        visible: VisibleMap,
        shown: IntArray,
    ) -> MapShapes:
        """Return the shapes of what is in view.

        ``rates`` are the camera's at the pose, or None. ``shown`` are the features that had a
        label in the previous frame.
        """
        areas, lines, marks, _ = visible
        frame = FrameConfidence(self.confidence, camera, pose, rates)
        labelled = self._anchors.find(lines, marks, shown)
        anchors = with_marks(labelled.anchors, marks)
        faded = marked(self.confidence, frame, lines, anchors, self._sigmas_m)
        ellipses = self.confidence.ellipses
        return MapShapes(self._map, areas, marks, labelled, anchors, faded, ellipses)

    def why_absent(
        self,
        visible: VisibleMap,
        camera: Camera,
        pose: CameraPose,
        scale_m_px: float,
        far_m: float,
    ) -> str:
        """Return why no part of the map is in view; empty if a part is, or if the map is empty."""
        draped = self.draped
        if not visible.empty or not draped.features:
            return ""
        if not visible.hidden:
            map_of = draped.map, draped.plane, draped.first_n
            return f"NO MAP IN VIEW: {why_absent(*map_of, camera, pose, far_m)}"
        sample = f"{100 * scale_m_px:.2g} cm" if scale_m_px < 1 else f"{scale_m_px:.3g} m"
        sample += " a pixel"
        if math.isnan(scale_m_px):
            sample = "the picture's middle sees no ground"
        return f"NO MAP IN VIEW: no layer is shown at this scale ({sample})"

    def _at_scale(self, lines: VisibleLines, scale_m_px: float) -> VisibleLines:
        """Return the features whose layers are shown at this scale."""
        if not self.depends_on_scale or not len(lines):
            return lines
        if math.isnan(scale_m_px):  # no ground in the middle: treat as the coarsest scale
            scale_m_px = math.inf
        low, high = self._scales_m_px.T
        shown = ((low <= scale_m_px) & (scale_m_px <= high))[self._map.layer[lines.owner]]
        return lines if shown.all() else lines.select(np.flatnonzero(shown))
