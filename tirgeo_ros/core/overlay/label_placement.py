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
"""Place labels so that they avoid each other, marks and edges, and stay from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.map.vector_map import Colour, VectorMap
from tirgeo_ros.core.map.visibility import VisibleLines
from tirgeo_ros.core.overlay.uncertainty_rendering import Anchors
from tirgeo_ros.core.overlay.written_text import TEXT_BGR, Box, stamp, text_px
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray, Pixels

_PLAIN_PX = 640, 512  # picture size at which the drawing scale is 1
_SMALLEST, _LARGEST = 0.75, 4.0  # limits of the drawing scale
_MARK_PX = 7
_LEAST_WEIGHT_PX = 1e-9  # of a vertex: the visible part of a line may have zero length
#: The largest number of labels that are drawn: more could not be read.
MOST = 40
UNCERTAIN_BGR: Colour = (165, 165, 165)
_CONSIDERED = 3 * MOST
#: A label inside its outline stays there until the outline is smaller than this times the label.
_STAYS_WITHIN = 0.8
#: Free space around a new place, so that the label does not have to move again soon.
_ROOM_PX = 4
_Places = tuple[tuple[int, int], ...]
#: Candidate places, the best first: offsets of the label's middle from the anchor, to the right
#: and down, in units of ``PlacementRequest.half_u`` and ``half_v``.
_BESIDE = ((1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (1, 1), (-1, -1), (-1, 1))
_ALONG = ((0, -1), (0, 1), (1, 0), (-1, 0), (0, 0))
_UNDER = ((0, 1), (0, -1), (1, 0), (-1, 0))
_WITHIN = ((0, 0), (0, -1), (0, 1), (0, -2), (0, 2))  # outside it would seem a neighbour's label


def drawing_scale(image: Pixels) -> float:
    """Return the scale of ink on a picture (h, w, ...), relative to one of 640x512."""
    height, width = image.shape[:2]
    fits = min(width / _PLAIN_PX[0], height / _PLAIN_PX[1])
    return float(min(max(fits, _SMALLEST), _LARGEST))


def mark_radius_px(image: Pixels) -> int:
    """Return half the width of a mark on this picture, px; the mark's inside is not filled."""
    return round(_MARK_PX * drawing_scale(image))


class Features(NamedTuple):
    """Hold visible features with labels, the most important first; one element or column each."""

    feature: IntArray  # (F,) index into the map's labels
    mark: BoolArray  # (F,) whether it is a point mark, which its label must not hide
    inside: BoolArray  # (F,) whether it is a closed outline, which has its label inside
    uv: Array  # (2, F) pixels
    rays: Array  # (3, F) the anchor's place on the map, as in VisibleLines.rays
    half: Array  # (2, F) half of the feature's width and height in the picture, px

    @property
    def anchors(self) -> Anchors:
        """Return the anchors of the labels."""
        return Anchors(self.uv, self.rays, self.feature, self.mark)


_NO_FEATURES = Features(
    np.empty(0, np.int64),
    *(np.empty(0, bool), np.empty(0, bool)),
    *(np.empty((2, 0)), np.empty((3, 0)), np.empty((2, 0))),
)


class AnchorFinder:
    """Find the anchors of one map's labels in any view of it."""

    def __init__(self, vector_map: VectorMap) -> None:
        self._layer = vector_map.layer
        with_labels = np.array([layer.style.labels for layer in vector_map.layers], bool)
        self._labelled = vector_map.labelled & with_labels[vector_map.layer]
        # Outlines are features that have lines, each of them closed.
        lines, self._outline = vector_map.lines, np.zeros(len(vector_map.labels), bool)
        ends = lines.points[:, lines.starts[1:] - 1] == lines.points[:, lines.starts[:-1]]
        self._outline[lines.owner] = True
        self._outline[lines.owner[~ends.all(axis=0)]] = False

    def find(self, lines: VisibleLines, marks: VisibleLines, shown: IntArray) -> Features:
        """Return the features that may get a label, three times as many as can be drawn at most.

        Upper layers come first. Within a layer marks come first, then the features in ``shown``
        (those of the previous frame), then nearer features.
        """
        line = np.flatnonzero(self._labelled[lines.owner])
        mark = np.flatnonzero(self._labelled[marks.owner])
        if not len(line) and not len(mark):
            return _NO_FEATURES
        owner = np.concatenate([marks.owner[mark], lines.owner[line]])
        near = np.concatenate([marks.rays[2, mark], lines.rays[2, lines.starts[line]]])
        was_shown = np.zeros(len(self._layer), bool)
        was_shown[shown] = True
        is_line = np.arange(len(owner)) >= len(mark)
        ordered = owner[np.lexsort((-near, ~was_shown[owner], is_line, -self._layer[owner]))]
        place = np.arange(len(owner))
        first = np.empty(len(self._layer), np.int64)
        first[ordered[::-1]] = place[::-1]  # reversed, so that an owner's first place remains
        chosen = ordered[first[ordered] == place][:_CONSIDERED]

        row = np.full(len(self._layer), -1)
        row[chosen] = np.arange(len(chosen))
        points, half = np.zeros((5, len(chosen))), np.zeros((2, len(chosen)))
        is_mark = np.zeros(len(chosen), bool)
        mark = mark[row[marks.owner[mark]] >= 0]
        of_mark = row[marks.owner[mark]]
        is_mark[of_mark] = True
        points[:2, of_mark], points[2:, of_mark] = marks.points[:, mark], marks.rays[:, mark]
        row[chosen[is_mark]] = -1
        outline = self._outline[chosen] & ~is_mark
        kept = line[row[lines.owner[line]] >= 0]
        if len(kept):
            number = row[lines.owner[kept]]
            order = np.argsort(number, kind="stable")
            number = number[order]
            at = np.unique(number)
            parts = lines.select(kept[order])
            points[:, at], half[:, at] = _anchors(parts, number, outline[at])
        return Features(chosen, is_mark, outline, points[:2], points[2:], half)


def _anchors(parts: VisibleLines, number: IntArray, outline: BoolArray) -> tuple[Array, Array]:
    """Return the label anchors (5, F) of F features, and half their extents (2, F).

    ``number`` (lines,) is each part's feature, in ascending order; ``outline`` (F,) is True for
    closed ones. An anchor is the mean of the visible part, weighted by length, so that it moves
    smoothly as parts come into view. It is then moved onto its line, or into its outline.
    """
    fresh = np.append(True, number[1:] != number[:-1])
    begins = parts.starts[:-1][fresh]
    row = np.repeat(np.cumsum(fresh) - 1, np.diff(parts.starts))
    points, links = np.concatenate([parts.points, parts.rays]), parts.links()
    low = np.minimum.reduceat(points[:2], begins, axis=1)
    high = np.maximum.reduceat(points[:2], begins, axis=1)
    # A vertex has the weight of the lengths of its two segments.
    length = np.hypot(*(points[:2, 1:] - points[:2, :-1])) * links
    weight = np.full(points.shape[1], _LEAST_WEIGHT_PX)
    weight[1:] += length
    weight[:-1] += length
    total = np.add.reduceat(points * weight, begins, axis=1)
    places = total / np.add.reduceat(weight, begins)
    inside = outline[row[:-1]]
    for move, begin in ((_move_inside, links & inside), (_move_to_lines, links & ~inside)):
        if begin.any():
            move(places, points, row, np.flatnonzero(begin))
    return places, (high - low) / 2


def _move_to_lines(places: Array, points: Array, row: IntArray, first: IntArray) -> None:
    """Move places (5, F) to the nearest points of the segments that begin at these vertices.

    ``row`` (V,) is the place of each of the vertices ``points`` (5, V).
    """
    start, of = points.take(first, axis=1), row[first]
    along, to_place = points.take(first + 1, axis=1) - start, places[:2, of] - start[:2]
    squared = (along[:2] * along[:2]).sum(axis=0) + 1e-9
    share = np.clip((along[:2] * to_place).sum(axis=0) / squared, 0.0, 1.0)
    point = start + share * along
    away = ((point[:2] - places[:2, of]) ** 2).sum(axis=0)
    farthest_first = np.argsort(-away, kind="stable")  # the nearest is written last and remains
    places[:, of[farthest_first]] = point[:, farthest_first]


def _move_inside(places: Array, points: Array, row: IntArray, first: IntArray) -> None:
    """Move places that are outside their outlines into them, along their pixel rows.

    The arguments are as in ``_move_to_lines``. Where the picture cuts an outline, the pixel row
    may cross it an odd number of times, or an odd number of times on each side. Then inside and
    outside cannot be told apart, and the place stays.
    """
    above = points[1] <= places[1].take(row)
    across = first[above[first] != above[first + 1]]
    of, start = row[across], points.take(across, axis=1)
    rise = points.take(across + 1, axis=1) - start
    point = start + (places[1, of] - start[1]) / rise[1] * rise
    count = places.shape[1]
    before = np.bincount(of, point[0] <= places[0, of], count)
    off = (before % 2 == 0) & (np.bincount(of, minlength=count) % 2 == 0)
    left = np.flatnonzero(off[of])
    order = left[np.lexsort((point[0, left], of[left]))]
    begin, end = point[:, order[::2]], point[:, order[1::2]]
    # To the middle of the widest span, which is written last and remains.
    widest = np.argsort(end[0] - begin[0], kind="stable")
    places[:, of[order[::2]][widest]] = ((begin + end) / 2)[:, widest]


class Label(NamedTuple):
    """Hold a label and its box."""

    row: int  # of its feature, among the features that may get a label
    box: Box


class LabelPlace(NamedTuple):
    """Hold a label's candidate places, and the number of the place that it had."""

    places: _Places
    number: int


class PlacementRequest(NamedTuple):
    """Hold a label's size and anchor, px, and its candidate places."""

    u: float
    v: float
    width: int
    height: int
    half_u: float  # horizontal unit of ``places``, px
    half_v: float
    mark: bool
    places: _Places


class Labels:
    """Place the labels of one map, frame after frame."""

    def __init__(self) -> None:
        #: The places, by feature, of the labels shown in the last frame.
        self._places: dict[int, LabelPlace] = {}

    @property
    def shown(self) -> IntArray:
        """Return the features whose labels were shown in the last frame."""
        return np.array([*self._places], np.int64)

    def place(
        self,
        image: Pixels,
        texts: Sequence[str],
        features: Features,
        marks: Array,
        taken: Sequence[Box] = (),
    ) -> list[Label]:
        """Return the placed labels, which avoid the ``taken`` boxes and, if possible, the marks.

        ``texts`` are those of all features of the map, ``marks`` (2, V) pixels. A label keeps its
        place relative to its feature as long as possible.
        """
        last_places, self._places = self._places, {}
        room = FreeSpace(image, marks[:2], taken)
        labels = list[Label]()
        columns = features.feature, features.mark, features.inside, features.uv.T, features.half.T
        rows_of = zip(*(each.tolist() for each in columns), strict=True)
        for row, (number, is_mark, inside, (u, v), half) in enumerate(rows_of):
            size = stamp(texts[number], room.text_px, TEXT_BGR).size
            last = last_places.get(number)
            if is_mark:
                request = request_beside(u, v, size, room.mark_px)
            else:  # on its line, inside its outline, or under a small outline
                half_u, half_v = size[0] / 2, size[1] / 2
                places: _Places = _WITHIN if inside else _ALONG
                stays = last is not None and last.places is _WITHIN
                fits = _STAYS_WITHIN if stays else 1.0
                if inside and (half[0] < fits * half_u or half[1] < fits * half_v):
                    half_u, half_v, places = half_u + half[0], half_v + half[1], _UNDER
                request = PlacementRequest(u, v, *size, half_u, half_v, False, places)
            placed = room.find(request, last)
            if placed is None:
                continue
            self._places[number] = LabelPlace(request.places, placed[0])
            labels.append(Label(row, placed[1]))
            if len(labels) == MOST:
                break
        return labels


def request_beside(u: float, v: float, size: tuple[int, int], mark_px: float) -> PlacementRequest:
    """Return a label's request for a place beside a mark; ``size`` is its width and height."""
    half_u, half_v = size[0] / 2 + mark_px, size[1] / 2 + mark_px
    return PlacementRequest(u, v, *size, half_u, half_v, True, _BESIDE)


class FreeSpace:
    """Track a picture's free space: ``taken`` boxes, and ``marks`` (2, V) to avoid if possible."""

    def __init__(self, image: Pixels, marks: Array, taken: Sequence[Box]) -> None:
        self._height, self._width = image.shape[:2]
        self.text_px = text_px(image)
        self.mark_px = mark_radius_px(image)
        self._marks = marks
        self._taken = list(taken)

    def find(
        self, request: PlacementRequest, last: LabelPlace | None = None
    ) -> tuple[int, Box] | None:
        """Take and return a place (``last`` if free) and its box; None without room."""
        if request.width > self._width or request.height > self._height:
            return None
        placed = None
        if last is not None and last.places is request.places:
            box = self._box(request, last.number)
            placed = (last.number, box) if self._is_free(box, request, 0) else None
        if placed is None:
            boxes = ((number, self._box(request, number)) for number in range(len(request.places)))
            free = [each for each in boxes if self._is_free(each[1], request, _ROOM_PX)]
            bare = (each for each in free if not self._covers_mark(each[1]))
            placed = next(bare, free[0] if free else None)
        if placed is not None:
            self._taken.append(placed[1])
        return placed

    def _box(self, request: PlacementRequest, place: int) -> Box:
        """Return the box of a place, shifted into the picture."""
        u, v, width, height, half_u, half_v, _, places = request
        to_right, down = places[place]
        left = round(u + to_right * half_u - width / 2)
        top = round(v + down * half_v - height / 2)
        if left < 0 or left + width > self._width:
            left = 0 if left < 0 else self._width - width
        if top < 0 or top + height > self._height:
            top = 0 if top < 0 else self._height - height
        return Box(left, top, left + width, top + height)

    def _is_free(self, box: Box, request: PlacementRequest, room: int) -> bool:
        u, v = round(request.u), round(request.v)
        if request.mark and box.meets(Box(u - 1, v - 1, u + 2, v + 2)):
            return False
        # Box.meets written out, because this runs thousands of times per frame.
        left, top, right, bottom = box
        if room:
            left, top, right, bottom = left - room, top - room, right + room, bottom + room
        for x0, y0, x1, y1 in self._taken:  # any() with a generator takes twice the time
            if left < x1 and x0 < right and top < y1 and y0 < bottom:
                return False
        return True

    def _covers_mark(self, box: Box) -> bool:
        u, v = self._marks
        inside = (u > box.left) & (u < box.right) & (v > box.top) & (v < box.bottom)
        return bool(inside.any())
