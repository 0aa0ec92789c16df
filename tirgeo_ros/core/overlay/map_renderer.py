"""Drape the layers of a map in a plane, and draw them as a camera sees them."""

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
from tirgeo_ros.core.map.polylines import joined
from tirgeo_ros.core.map.vector_map import LayerStyle, MapLayer, VectorMap, check_heights
from tirgeo_ros.core.map.visibility import View, VisibleLines, why_absent
from tirgeo_ros.core.overlay.label_placement import UNCERTAIN_BGR, Labels
from tirgeo_ros.core.overlay.line_renderer import LineRenderer, mark_radius_px, marks_as_lines
from tirgeo_ros.core.overlay.uncertainty_rendering import ELLIPSE_BGR, marked, with_marks
from tirgeo_ros.core.overlay.written_text import (
    LONGEST,
    TEXT_BGR,
    Box,
    can_shape,
    stamp,
    text_px,
    writable,
)
from tirgeo_ros.core.types.arrays import Array, Pixels
from tirgeo_ros.core.types.errors import cut
from tirgeo_ros.core.types.poses import CameraPose


@dataclass(frozen=True, slots=True)
class DrapedMap:
    """Hold a map draped in a plane, without the layers that it was made from."""

    plane: TangentPlane
    map: VectorMap
    features: int  # number of features in the layers
    level_m: float  # median of the map's own heights; nan where a ground is given
    first_n: Array | None = None  # (3,) the first of the layers' points, on the ellipsoid


def drape_layers(layers: Sequence[MapLayer], plane: TangentPlane, ground: Ground) -> DrapedMap:
    """Drape layers in a plane, the slow part of a map. Raises ConfigError as VectorMap does."""
    check_heights(layers, ground)
    features = sum(len(layer.features) for layer in layers)
    vector_map = VectorMap.from_layers(layers, plane, ground)
    # Labels that cannot be written here are left out, with a note of them.
    labels, labelled = vector_map.labels, vector_map.labelled.copy()
    lost = [i for i in np.flatnonzero(labelled).tolist() if not writable(labels[i])]
    if lost:
        labelled[lost] = False
        needed = "a typeface with their letters" + ("" if can_shape() else ", or libfribidi0")
        example = cut(labels[lost[0]], LONGEST)
        note = f"map: labels not drawn: {len(lost)}, as {example!r}; they need {needed}"
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
    hidden: bool  # whether features in view were left out because of their layers' scale range

    @property
    def empty(self) -> bool:
        """Return whether there is nothing to draw."""
        return not (len(self.areas) or len(self.lines) or len(self.marks))


class MapRenderer:
    """Draw one draped map, frame after frame."""

    def __init__(self, config: ConfidenceConfig, draped: DrapedMap) -> None:
        self._map = vector_map = draped.map
        self._styles: Sequence[LayerStyle] = [layer.style for layer in vector_map.layers]
        ranges = [style.scale_m_px for style in self._styles]
        self._scales_m_px = np.array(ranges, float).reshape(-1, 2)
        # Position sigma of each feature's layer, m; nan if the style has none.
        layer_m = [math.nan if m.sigma_m is None else m.sigma_m for m in vector_map.layers]
        sigmas_m = np.array(layer_m, float)[vector_map.layer]
        self._sigmas_m = None if np.isnan(sigmas_m).all() else sigmas_m
        self.lines = LineRenderer()
        self.confidence = config
        self._labels = Labels(vector_map)
        self._draped = draped
        #: Whether some layers have a limited scale range.
        self.minds_scale = any(some != LayerStyle().scale_m_px for some in ranges)

    def visible(self, view: View, pose: CameraPose, scale_m_px: float, far_m: float) -> VisibleMap:
        """Return what is in view: areas, and lines and marks up to ``far_m`` ahead.

        ``scale_m_px`` is the ground length that a pixel in the middle spans, nan without ground.
        """
        in_view = (
            view.areas(self._map, pose),
            view.lines(self._map, pose, far_m),
            view.marks(self._map, pose, far_m),
        )
        areas, lines, marks = (self._at_scale(each, scale_m_px) for each in in_view)
        shown = len(areas) + len(lines) + len(marks)
        return VisibleMap(areas, lines, marks, hidden=shown < sum(map(len, in_view)))

    def paint(
        self,
        image: Pixels,
        view: View,
        pose: CameraPose,
        rates: CameraRates | None,
        visible: VisibleMap,
        taken: Sequence[Box],
    ) -> list[Box]:
        """Paint what is in view into (h, w, 3) BGR; return the boxes of its labels.

        Labels avoid the boxes in ``taken``. ``rates`` are the camera's at the pose, or None.
        """
        areas, lines, marks, _ = visible
        of = self._map.layer
        frame = FrameConfidence(self.confidence, view.camera, pose, rates)
        self.lines.areas(image, areas, of[areas.owner], self._styles)
        labels, points = self._labels.place(image, lines, marks, taken)
        anchors, radius_px = with_marks(points, marks), mark_radius_px(image)
        lines_px, opacity, outlines, unknown = marked(
            self.confidence, frame, lines, anchors, radius_px, self._sigmas_m
        )
        diamonds = marks_as_lines(marks, radius_px)
        # Ellipses first, so that the marks, which are the true places, are drawn over them.
        self.lines.thin_strokes(image, outlines, ELLIPSE_BGR)
        ink = joined(lines_px, diamonds)
        strength = np.concatenate([opacity, np.ones(len(diamonds))])
        self.lines.strokes(image, ink, of[ink.owner], self._styles, strength)
        size_px, uncertain = text_px(image), set(anchors.owner[unknown].tolist())
        for feature, box in labels:
            colour = UNCERTAIN_BGR if feature in uncertain else TEXT_BGR
            stamp(self._map.labels[feature], size_px, colour).lay(image, box.left, box.top)
        return [label.box for label in labels]

    def why_absent(
        self,
        visible: VisibleMap,
        camera: Camera,
        pose: CameraPose,
        scale_m_px: float,
        far_m: float,
    ) -> str:
        """Return why none of the map is in view; empty if some is, or there is none to draw."""
        draped = self._draped
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
        if not self.minds_scale or not len(lines):
            return lines
        if math.isnan(scale_m_px):  # no ground in the middle: treat as the coarsest scale
            scale_m_px = math.inf
        low, high = self._scales_m_px.T
        shown = ((low <= scale_m_px) & (scale_m_px <= high))[self._map.layer[lines.owner]]
        return lines if shown.all() else lines.select(np.flatnonzero(shown))
