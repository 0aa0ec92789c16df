"""Place labels so that they avoid each other, marks and edges, and stay from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.map.layers import Colour
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.map.visibility import VisibleLines
from tirgeo_ros.core.overlay.label_anchors import AnchorFinder
from tirgeo_ros.core.overlay.line_renderer import mark_radius_px
from tirgeo_ros.core.overlay.text_rendering import TEXT_BGR, Box, stamp, text_px
from tirgeo_ros.core.overlay.uncertainty_rendering import Anchors
from tirgeo_ros.core.types.arrays import Array, Pixels

#: The largest number of labels that are drawn: more could not be read.
MOST = 40

UNCERTAIN_BGR: Colour = (165, 165, 165)

_CONSIDERED = 3 * MOST
#: A label inside its outline stays inside until the outline is smaller than this times the label.
_STAYS_WITHIN = 0.8
#: Free space that a new place needs around it, so that the label is not displaced again soon.
_ROOM_PX = 4

_Places = tuple[tuple[int, int], ...]
#: Candidate places, the best first: offsets of the label's middle from the anchor, to the right
#: and down, in units of ``PlacementRequest.half_u`` and ``half_v``.
_BESIDE = ((1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (1, 1), (-1, -1), (-1, 1))
_ALONG = ((0, -1), (0, 1), (1, 0), (-1, 0), (0, 0))
_UNDER = ((0, 1), (0, -1), (1, 0), (-1, 0))
_WITHIN = ((0, 0), (0, -1), (0, 1), (0, -2), (0, 2))  # outside, it would seem to name another


class Label(NamedTuple):
    """Hold a label and its box."""

    feature: int  # index of the map's labels
    box: Box


class Labels:
    """Place the labels of one map, frame after frame."""

    def __init__(self, vector_map: VectorMap) -> None:
        self._texts = vector_map.labels
        self._anchors = AnchorFinder(vector_map)
        #: By feature, of the labels shown in the last frame.
        self._places: dict[int, LabelPlace] = {}

    def place(
        self, image: Pixels, lines: VisibleLines, marks: VisibleLines, taken: Sequence[Box] = ()
    ) -> tuple[list[Label], Anchors]:
        """Return the placed labels and the anchor points of their features.

        A label keeps its place relative to its feature as long as possible.
        """
        shown = np.array([*self._places], np.int64)
        features = self._anchors.find(lines, marks, shown, _CONSIDERED)
        room = FreeSpace(image, marks.points[:2], taken)
        places, self._places = self._places, {}
        labels, rows = [], []
        columns = features.feature, features.mark, features.inside, features.uv.T, features.half.T
        rows_of = zip(*(each.tolist() for each in columns), strict=True)
        for row, (number, is_mark, inside, (u, v), half) in enumerate(rows_of):
            size = stamp(self._texts[number], room.text_px, TEXT_BGR).size
            last = places.get(number)
            if is_mark:
                wish = wish_beside(u, v, size, room.mark_px)
            else:
                wish = _wish_on((u, v), half, size, last, inside=inside)
            found = room.find(wish, last)
            if found is None:
                continue
            self._places[number] = LabelPlace(wish.places, found[0])
            labels.append(Label(number, found[1]))
            rows.append(row)
            if len(labels) == MOST:
                break
        chosen = np.array(rows, np.int64)
        points = features.uv.take(chosen, axis=1), features.rays.take(chosen, axis=1)
        return labels, Anchors(*points, features.feature[chosen], features.mark[chosen])


class LabelPlace(NamedTuple):
    """Hold which of a tuple of candidate places a label had."""

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


def wish_beside(u: float, v: float, size: tuple[int, int], mark_px: float) -> PlacementRequest:
    """Return the wish of a label of this size for a place beside a mark."""
    half_u, half_v = size[0] / 2 + mark_px, size[1] / 2 + mark_px
    return PlacementRequest(u, v, *size, half_u, half_v, True, _BESIDE)


def _wish_on(
    uv: tuple[float, float],
    half: Sequence[float],
    size: tuple[int, int],
    last: LabelPlace | None,
    *,
    inside: bool,
) -> PlacementRequest:
    """Return the wish of a label on its line or inside its outline, or under a small outline."""
    half_u, half_v = size[0] / 2, size[1] / 2
    places: _Places = _ALONG
    if inside:
        fits = _STAYS_WITHIN if last is not None and last.places is _WITHIN else 1.0
        places = _WITHIN
        if half[0] < fits * half_u or half[1] < fits * half_v:
            half_u, half_v, places = half_u + half[0], half_v + half[1], _UNDER
    return PlacementRequest(*uv, *size, half_u, half_v, False, places)


class FreeSpace:
    """Track the free room of a picture: ``marks`` (2, V) to avoid if possible, and taken boxes."""

    def __init__(self, image: Pixels, marks: Array, taken: Sequence[Box]) -> None:
        self._height, self._width = image.shape[:2]
        self.text_px = text_px(image)
        self.mark_px = mark_radius_px(image)
        self._marks = marks
        self._taken = list(taken)

    def find(
        self, wish: PlacementRequest, last: LabelPlace | None = None
    ) -> tuple[int, Box] | None:
        """Return a place (``last`` if free) and its box, and take the box; None without room."""
        if wish.width > self._width or wish.height > self._height:
            return None
        found = None
        if last is not None and last.places is wish.places:
            box = self._box(wish, last.number)
            found = (last.number, box) if self._is_free(box, wish, 0) else None
        if found is None:
            boxes = ((number, self._box(wish, number)) for number in range(len(wish.places)))
            free = [each for each in boxes if self._is_free(each[1], wish, _ROOM_PX)]
            bare = (each for each in free if not self._covers_mark(each[1]))
            found = next(bare, free[0] if free else None)
        if found is not None:
            self._taken.append(found[1])
        return found

    def _box(self, wish: PlacementRequest, place: int) -> Box:
        """Return the box of a place, shifted into the picture."""
        u, v, width, height, half_u, half_v, _, places = wish
        to_right, down = places[place]
        left = round(u + to_right * half_u - width / 2)
        top = round(v + down * half_v - height / 2)
        if left < 0 or left + width > self._width:
            left = 0 if left < 0 else self._width - width
        if top < 0 or top + height > self._height:
            top = 0 if top < 0 else self._height - height
        return Box(left, top, left + width, top + height)

    def _is_free(self, box: Box, wish: PlacementRequest, room: int) -> bool:
        u, v = round(wish.u), round(wish.v)
        if wish.mark and box.meets(Box(u - 1, v - 1, u + 2, v + 2)):
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
