"""Paint a map into a picture: areas, lines, marks, their uncertainty and their labels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.projection_covariance import CameraRates, FrameConfidence
from tirgeo_ros.core.config.overlay import ConfidenceConfig
from tirgeo_ros.core.map.layers import LayerStyle
from tirgeo_ros.core.map.polylines import joined
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.map.visibility import View, VisibleLines
from tirgeo_ros.core.overlay.label_placement import UNCERTAIN_BGR, Labels
from tirgeo_ros.core.overlay.line_renderer import LineRenderer, mark_radius_px, marks_as_lines
from tirgeo_ros.core.overlay.line_sampling import picked
from tirgeo_ros.core.overlay.text_rendering import TEXT_BGR, Box, stamp, text_px
from tirgeo_ros.core.overlay.uncertainty_rendering import (
    ELLIPSE_BGR,
    marked,
    with_marks,
)
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.poses import CameraPose


class SeenMap(NamedTuple):
    """Hold the visible part of a map."""

    areas: VisibleLines
    lines: VisibleLines
    marks: VisibleLines
    hidden: bool  # whether features in view were left out because of their layers' scale range

    @property
    def empty(self) -> bool:
        """Return whether there is nothing to draw."""
        return not (len(self.areas) or len(self.lines) or len(self.marks))


class LayerPainter:
    """Paint one map, frame after frame."""

    def __init__(
        self, config: ConfidenceConfig, vector_map: VectorMap, painter: LineRenderer | None = None
    ) -> None:
        self._map = vector_map
        self._styles: Sequence[LayerStyle] = [layer.style for layer in vector_map.layers]
        ranges = [style.scale_m_px for style in self._styles]
        self._scales_m_px = np.array(ranges, float).reshape(-1, 2)
        # Position sigma of each feature's layer, m; nan if not given.
        given = [np.nan if one.sigma_m is None else one.sigma_m for one in vector_map.layers]
        sigmas = np.array(given, float)[vector_map.layer]
        self._sigmas = None if np.isnan(sigmas).all() else sigmas
        self._painter = painter or LineRenderer()
        self.confidence = config
        self._labels = Labels(vector_map)
        #: Whether some layers have a limited scale range.
        self.minds_scale = any(some != LayerStyle().scale_m_px for some in ranges)

    def see(self, view: View, pose: CameraPose, scale_m_px: float, far_m: float) -> SeenMap:
        """Return what is in view: areas, and lines and marks up to ``far_m`` ahead.

        ``scale_m_px`` is the ground length that a pixel in the middle spans, nan without ground.
        """
        found = (
            view.areas(self._map, pose),
            view.lines(self._map, pose, far_m),
            view.marks(self._map, pose, far_m),
        )
        areas, lines, marks = (self._shown(seen, scale_m_px) for seen in found)
        left = len(areas) + len(lines) + len(marks)
        return SeenMap(areas, lines, marks, hidden=left < sum(map(len, found)))

    def paint(
        self,
        image: Pixels,
        view: View,
        pose: CameraPose,
        rates: CameraRates | None,
        seen: SeenMap,
        taken: Sequence[Box],
    ) -> list[Box]:
        """Paint what is in view into (h, w, 3) BGR; return the boxes of its labels.

        Labels avoid the boxes in ``taken``. ``rates`` are the camera's at the pose, or None.
        """
        areas, lines, marks, _ = seen
        of = self._map.layer
        frame = FrameConfidence(self.confidence, view.camera, pose, rates)
        self._painter.areas(image, areas, of[areas.owner], self._styles, view.reached)
        labels, points = self._labels.place(image, lines, marks, taken)
        anchors, radius_px = with_marks(points, marks), mark_radius_px(image)
        lines_px, opacity, outlines, unknown = marked(
            self.confidence, frame, lines, anchors, radius_px, self._sigmas
        )
        diamonds = marks_as_lines(marks, radius_px)
        # Ellipses first, so that the marks, which are the true places, are drawn over them.
        self._painter.thin_strokes(image, outlines, ELLIPSE_BGR)
        ink = joined(lines_px, diamonds)
        strength = np.concatenate([opacity, np.ones(len(diamonds))])
        self._painter.strokes(image, ink, of[ink.owner], self._styles, strength)
        size_px, uncertain = text_px(image), set(anchors.owner[unknown].tolist())
        for feature, box in labels:
            colour = UNCERTAIN_BGR if feature in uncertain else TEXT_BGR
            stamp(self._map.labels[feature], size_px, colour).lay(image, box.left, box.top)
        return [label.box for label in labels]

    def _shown(self, seen: VisibleLines, scale_m_px: float) -> VisibleLines:
        """Return the features whose layers are shown at this scale."""
        if not self.minds_scale or not len(seen):
            return seen
        if math.isnan(scale_m_px):  # no ground in the middle: treat as the coarsest scale
            scale_m_px = math.inf
        low, high = self._scales_m_px.T
        shown = ((low <= scale_m_px) & (scale_m_px <= high))[self._map.layer[seen.owner]]
        return seen if shown.all() else picked(seen, np.flatnonzero(shown))
