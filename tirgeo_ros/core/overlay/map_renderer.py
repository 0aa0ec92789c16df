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
"""Paint lines, areas and marks of a map with OpenCV."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.map.polylines import Polylines, joined
from tirgeo_ros.core.map.vector_map import Colour, LayerStyle
from tirgeo_ros.core.overlay.label_placement import (
    UNCERTAIN_BGR,
    Labels,
    drawing_scale,
    mark_radius_px,
)
from tirgeo_ros.core.overlay.map_shapes import MapShapes
from tirgeo_ros.core.overlay.uncertainty_rendering import ELLIPSE_BGR, outlines, with_ellipses
from tirgeo_ros.core.overlay.written_text import TEXT_BGR, Box, stamp, text_px
from tirgeo_ros.core.types.arrays import Array, IntArray, Pixels

#: Number of opacity steps of lines.
FADES = 4

#: A part of a picture: rows and columns.
_Part = tuple[slice, slice]

_SHIFT = 4  # cv2 takes coordinates in sixteenths of a pixel
_DIAMOND = np.array([[0.0, 1.0, 0.0, -1.0, 0.0], [-1.0, 0.0, 1.0, 0.0, -1.0]])
_HALO_PX = 1.0  # on each side of a line
_BLUR_PX = 0.7  # an anti-aliased line is this much wider than its nominal width
_BLUR_REACH_PX = 2.0  # distance from its middle at which a line of one pixel still has ink
_FULL = 255
_WIDE_PART = 0.6  # ink over more than this share of the width is drawn on whole rows
#: OpenCV's anti-aliased line of one pixel is too weak against its halo when a phone shrinks the
#: picture. This factor makes it opaque, except at its faintest edge.
_STRONGER = 1.6


def marks_as_lines(marks: Polylines, radius_px: float) -> Polylines:
    """Return an open diamond around each mark, which is a line of one point (2, V) in pixels."""
    if not len(marks):
        return marks
    corners = marks.points[:2, :, None] + radius_px * _DIAMOND[:, None, :]
    count = _DIAMOND.shape[1]
    starts = np.arange(len(marks) + 1) * count
    return Polylines(corners.reshape(2, -1), starts, marks.owner)


class LineRenderer:
    """Draw on one picture after another with the same masks: new ones cost as much as drawing.

    Not thread-safe.
    """

    def __init__(self) -> None:
        self._mask = self._grown = np.empty((0, 0), np.uint8)
        self._layer = np.empty((0, 0, 3), np.uint8)
        self._planes: list[Pixels] = []

    def areas(
        self,
        image: Pixels,
        areas: Polylines,
        layer: IntArray,
        styles: Sequence[LayerStyle],
    ) -> None:
        """Fill areas with the colours of their layers, in place; skip layers without a fill.

        ``areas`` (2, V) are rings in pixels. Rings of one owner form one area, where a ring inside
        another is a hole (even-odd rule). ``layer`` (rings,) is the index of each ring's style.
        Areas of one layer that overlap are drawn as one; areas of different layers blend.
        """
        if not len(areas):
            return
        rings = areas.split_rows(_fixed_point(areas.points[:2]))
        for number in np.unique(layer).tolist():
            style = styles[number]
            if style.fill_bgr is None or style.fill_opacity <= 0:
                continue
            mask = self._clean_mask(image)
            of_owner: dict[int, list[npt.NDArray[np.int32]]] = defaultdict(list)
            for ring in np.flatnonzero(layer == number).tolist():
                of_owner[int(areas.owner[ring])].append(rings[ring])
            for own in of_owner.values():
                cv2.fillPoly(mask, own, (_FULL,), cv2.LINE_8, _SHIFT)
            # Blend the colour over the picture where the mask is full.
            cv2.convertScaleAbs(image, alpha=1 - style.fill_opacity, dst=self._layer)
            cv2.copyTo(self._layer, mask, image)
            light = np.array([*style.fill_bgr, 0.0]) * style.fill_opacity
            cv2.add(image, light, dst=image, mask=mask)

    def strokes(
        self,
        image: Pixels,
        lines: Polylines,
        layer: IntArray,
        styles: Sequence[LayerStyle],
        opacity: Array | None = None,
    ) -> None:
        """Draw lines (2, V), in pixels, in the colours and widths of their layers, with a halo.

        ``layer`` (lines,) is the index of each line's style. ``opacity`` (lines,) is from 0, not
        drawn, to 1, rounded to quarters. Upper layers are drawn over lower ones.
        """
        scale = drawing_scale(image)
        opacity = np.ones(len(lines)) if opacity is None else opacity
        fade = np.rint(np.clip(opacity, 0, 1) * FADES).astype(np.int64)
        for (colour, width), numbers in _by_pen(layer, styles, scale).items():
            shift = 0.5 if width % 2 == 0 else 0.0  # an even kernel dilates to the right and down
            alone = len(numbers) == len(lines)
            chosen = lines if alone else lines.select(numbers)
            halo = max(round(_HALO_PX * scale), 1)
            inked = _inked(image, chosen.points, _BLUR_REACH_PX + width + halo)
            if inked is not None:
                _draw(self._clean_mask(image), chosen, shift, fade if alone else fade[numbers])
                self._ink(image, inked, colour, width, halo)

    def thin_strokes(self, image: Pixels, lines: Polylines, colour: Colour) -> None:
        """Draw thin lines (2, V), px, in one colour with a halo, 3 times as fast as strokes."""
        scale = drawing_scale(image)
        width, halo = _pen_px(1, scale), max(round(_HALO_PX * scale), 1)
        inked = _inked(image, lines.points, _BLUR_REACH_PX + width + halo)
        if inked is None:
            return
        runs = lines.split_rows(_fixed_point(lines.points[:2]))
        cv2.polylines(self._clean_mask(image), runs, False, (_FULL,), width, cv2.LINE_8, _SHIFT)
        part, mask, grown = image[inked], self._mask[inked], self._grown[inked]
        cv2.dilate(mask, _disc(1 + 2 * halo), dst=grown)
        cv2.subtract(part, np.full(4, float(_FULL)), dst=part, mask=grown)
        cv2.add(part, np.array([*colour, 0.0]), dst=part, mask=mask)

    def _clean_mask(self, image: Pixels) -> Pixels:
        shape = image.shape[:2]
        if self._mask.shape == shape:
            self._mask.fill(0)
            return self._mask
        self._mask, self._grown = np.zeros(shape, np.uint8), np.empty(shape, np.uint8)
        self._layer = np.empty((*shape, 3), np.uint8)
        self._planes = [np.empty(shape, np.uint8) for _ in range(3)]
        return self._mask

    def _ink(self, image: Pixels, inked: _Part, colour: Colour, width: int, halo_px: int) -> None:
        """Draw the mask's lines on the picture: subtract the halo, then add the colour.

        Both are proportional to the mask's value, so that a faint line is translucent.
        """
        image, mask, grown, coat = (
            each[inked] for each in (image, self._mask, self._grown, self._layer)
        )
        cv2.convertScaleAbs(mask, alpha=_STRONGER, dst=mask)
        if width > 1:
            cv2.dilate(mask, _disc(width), dst=mask)
        cv2.dilate(mask, _disc(1 + 2 * halo_px), dst=grown)
        cv2.cvtColor(grown, cv2.COLOR_GRAY2BGR, dst=coat)
        cv2.subtract(image, coat, dst=image)
        planes = []
        for level, plane in zip(colour, self._planes, strict=True):
            part = mask if level == _FULL else plane[inked]
            if level == 0:  # levels 0 and 255 need no multiplication
                part.fill(0)
            elif level != _FULL:
                cv2.convertScaleAbs(mask, alpha=level / _FULL, dst=part)
            planes.append(part)
        cv2.merge(planes, dst=coat)
        cv2.add(image, coat, dst=image)


def _inked(image: Pixels, points: Array, reach_px: float) -> _Part | None:
    """Return the rows and columns of a picture in which lines through points (2, V) have ink."""
    if not points.size:
        return None
    low, high = points[:2].min(axis=1) - reach_px, points[:2].max(axis=1) + reach_px
    part = []
    for size, least, most in zip(image.shape[1::-1], low.tolist(), high.tolist(), strict=True):
        first = min(max(math.floor(least), 0), size)
        part.append(slice(first, max(min(math.ceil(most) + 1, size), first)))
    columns, rows = part
    if rows.start == rows.stop or columns.start == columns.stop:
        return None
    # Whole rows are contiguous in memory: OpenCV takes half the time for them.
    wide = columns.stop - columns.start > _WIDE_PART * image.shape[1]
    return rows, slice(0, image.shape[1]) if wide else columns


def _by_pen(
    layer: IntArray, styles: Sequence[LayerStyle], scale: float
) -> dict[tuple[Colour, int], IntArray]:
    """Return the lines of each colour and width, ordered by the uppermost layer that uses them."""
    of_pen: dict[tuple[Colour, int], list[int]] = {}
    for number in np.flatnonzero(np.bincount(layer)).tolist():
        style = styles[number]
        pen = style.line_bgr, _pen_px(style.width_px, scale)
        of_pen[pen] = [*of_pen.pop(pen, []), number]
    if len(of_pen) == 1:
        return {pen: np.arange(len(layer)) for pen in of_pen}
    return {
        pen: np.flatnonzero(np.logical_or.reduce([layer == number for number in used]))
        for pen, used in of_pen.items()
    }


def _pen_px(width_px: int, scale: float) -> int:
    """Return the nominal width, px, that gives a line, blur included, the scaled width."""
    return max(round(scale * (width_px + _BLUR_PX) - _BLUR_PX), 1)


def _draw(mask: Pixels, lines: Polylines, shift_px: float, fade: IntArray) -> None:
    """Draw the faintest lines first, so that a faint line does not weaken a strong one."""
    rows = _fixed_point(lines.points[:2] - shift_px if shift_px else lines.points[:2])
    for step in np.flatnonzero(np.bincount(fade)).tolist():
        level = _FULL if step == FADES else round(_FULL / _STRONGER * step / FADES)
        if level:
            runs = lines.runs_of(rows, np.flatnonzero(fade == step))
            cv2.polylines(mask, runs, False, (level,), 1, cv2.LINE_AA, _SHIFT)


def _fixed_point(uv: Array) -> npt.NDArray[np.int32]:
    """Convert points (2, V) in pixels to rows (V, 2) in cv2's fixed-point units."""
    scaled = uv * (1 << _SHIFT)
    np.rint(scaled, out=scaled)
    rows = np.empty(scaled.shape[::-1], np.int32)
    rows[:, 0], rows[:, 1] = scaled
    return rows


@lru_cache(maxsize=32)
def _disc(width: int) -> Pixels:
    """Return the kernel that dilates a line of one pixel to this width."""
    if width <= 3:  # a square is faster, and as round as so few pixels can be
        return np.ones((width, width), np.uint8)
    offset = np.arange(width) - (width - 1) / 2
    return (offset[:, None] ** 2 + offset**2 <= (width / 2) ** 2 - 0.25).astype(np.uint8)


class MapRenderer:
    """Paint the shapes of one map, frame after frame."""

    def __init__(self) -> None:
        self.lines = LineRenderer()
        self.labels = Labels()

    def paint(self, image: Pixels, shapes: MapShapes, taken: Sequence[Box]) -> list[Box]:
        """Paint shapes into (h, w, 3) BGR; return the boxes of the labels.

        Labels avoid the boxes in ``taken``.
        """
        of, texts, anchors = shapes.map.layer, shapes.map.labels, shapes.anchors
        styles = [layer.style for layer in shapes.map.layers]
        self.lines.areas(image, shapes.areas, of[shapes.areas.owner], styles)
        labels = self.labels.place(image, texts, shapes.labelled, shapes.marks.points, taken)
        # Ellipses first, so that the marks, which are the true places, are drawn over them.
        if shapes.ellipses:
            chosen = with_ellipses(anchors, np.array([label.row for label in labels], np.int64))
            dashes = outlines(anchors, shapes.marked, chosen, mark_radius_px(image))
            self.lines.thin_strokes(image, dashes, ELLIPSE_BGR)
        diamonds = marks_as_lines(shapes.marks, mark_radius_px(image))
        ink = joined(shapes.marked.lines, diamonds)
        strength = np.concatenate([shapes.marked.opacity, np.ones(len(diamonds))])
        self.lines.strokes(image, ink, of[ink.owner], styles, strength)
        for row, box in labels:
            colour = UNCERTAIN_BGR if shapes.marked.uncertain[row] else TEXT_BGR
            text = texts[anchors.owner[row]]
            stamp(text, text_px(image), colour).draw(image, box.left, box.top)
        return [label.box for label in labels]
