"""A map painted into a picture: areas, lines, marks, their uncertainty and their labels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.confidence import CameraRates
from tirgeo_ros.core.config.pictures import ConfidenceConfig
from tirgeo_ros.core.labels import UNCERTAIN_BGR, Label, Labels
from tirgeo_ros.core.map_layers import LayerStyle
from tirgeo_ros.core.polylines import BoolArray, Polylines, joined, runs
from tirgeo_ros.core.samples import Array, CameraPose
from tirgeo_ros.core.strokes import Painter, mark_radius_px, marks_as_lines
from tirgeo_ros.core.text import TEXT_BGR, Box, Pixels, stamp, text_px
from tirgeo_ros.core.uncertainty_marks import (
    Anchors,
    Confidence,
    Ellipses,
    feature_anchors,
    layer_sigmas,
)
from tirgeo_ros.core.vector_map import VectorMap
from tirgeo_ros.core.view import Seen, View


class MapPainter:
    """Paints one map, frame after frame."""

    def __init__(
        self, config: ConfidenceConfig, vector_map: VectorMap, painter: Painter | None = None
    ) -> None:
        self._map = vector_map
        self._styles: Sequence[LayerStyle] = [layer.style for layer in vector_map.layers]
        self._sigmas = layer_sigmas(vector_map)
        self._painter = painter or Painter()
        self._confidence = Confidence(config)
        self._labels = Labels(vector_map)

    @property
    def minds_scale(self) -> bool:
        """Whether some layers are shown at some scales only."""
        return any(style.scale_m_px != LayerStyle().scale_m_px for style in self._styles)

    def paint(
        self,
        image: Pixels,
        view: View,
        pose: CameraPose,
        rates: CameraRates | None,
        scale_m_px: float,
        taken: Sequence[Box],
    ) -> None:
        """Paint into (h, w, 3) BGR, with labels off the boxes that are taken.

        ``scale_m_px`` is what a pixel in the middle spans of the ground, nan for none; ``rates``
        are the camera's at the pose, None where they are not known.
        """
        shown = self._shown(scale_m_px)
        areas, lines, marks = (
            self._picked(found(self._map, pose), shown)
            for found in (view.areas, view.lines, view.marks)
        )
        of = self._map.layer
        frame = self._confidence.frame(view.camera, pose, rates)
        sigmas = self._sigmas[lines.owner]
        self._painter.areas(image, areas, of[areas.owner], self._styles)
        self._confidence.paint_bands(image, frame, lines, of[lines.owner], self._styles, sigmas)
        drawn, opacity = self._confidence.faded(frame, lines, sigmas)
        labels = self._labels.place(image, lines, marks, taken)
        anchors = self._anchors(view, lines, marks, labels)
        ellipses = self._confidence.ellipses(frame, anchors, self._sigmas[anchors.owner])
        self._stroke(image, drawn, opacity, marks, ellipses)
        self._write(image, labels, set(anchors.owner[ellipses.uncertain].tolist()))

    def _shown(self, scale_m_px: float) -> BoolArray:
        """(features,) whether they are of a layer that is shown at this scale."""
        if math.isnan(scale_m_px):  # it sees no ground: as coarse as can be
            scale_m_px = math.inf
        ranges = np.array([style.scale_m_px for style in self._styles], float).reshape(-1, 2)
        shown = (ranges[:, 0] <= scale_m_px) & (scale_m_px <= ranges[:, 1])
        return np.asarray(shown[self._map.layer])

    @staticmethod
    def _picked(seen: Seen, shown: BoolArray) -> Seen:
        of_lines = shown[seen.owner]
        return seen if of_lines.all() else _selected(seen, of_lines)

    @staticmethod
    def _anchors(view: View, lines: Seen, marks: Seen, labels: list[Label]) -> Anchors:
        """Of all marks, and of the lines that have a label."""
        with_label = np.isin(lines.owner, [label.feature for label in labels])
        chosen = _selected(lines, with_label)
        of_lines = feature_anchors(chosen, view.inside(chosen.points))
        uv = np.concatenate([marks.points, of_lines.uv], axis=1)
        rays = np.concatenate([marks.rays, of_lines.rays], axis=1)
        return Anchors(uv, rays, np.concatenate([marks.owner, of_lines.owner]))

    def _stroke(
        self, image: Pixels, lines: Polylines, opacity: Array, marks: Seen, ellipses: Ellipses
    ) -> None:
        diamonds = marks_as_lines(marks, mark_radius_px(image))
        ink = joined(joined(lines, diamonds), ellipses.outlines)
        strength = np.concatenate([opacity, np.ones(len(diamonds)), ellipses.opacity])
        self._painter.strokes(image, ink, self._map.layer[ink.owner], self._styles, strength)

    def _write(self, image: Pixels, labels: list[Label], uncertain: set[int]) -> None:
        for label in labels:
            colour = UNCERTAIN_BGR if label.feature in uncertain else TEXT_BGR
            text = stamp(self._map.labels[label.feature], text_px(image), colour)
            text.lay(image, label.box.left, label.box.top)


def _selected(seen: Seen, which: BoolArray) -> Seen:
    numbers = np.flatnonzero(which)
    first = seen.starts[numbers]
    index, starts = runs(first, seen.starts[numbers + 1] - first)
    points, rays = (each.take(index, axis=1) for each in (seen.points, seen.rays))
    return Seen(points, starts, seen.owner[numbers], rays)
