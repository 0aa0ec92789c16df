"""Find the anchor points, in the picture, of the labels of a map's features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.map.visibility import VisibleLines
from tirgeo_ros.core.overlay.line_sampling import picked
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray

_LEAST_WEIGHT_PX = 1e-9  # of a vertex: the visible part of a line may have zero length


@dataclass(frozen=True, slots=True)
class Features:
    """Hold visible features with labels, the most important first; one row or column each."""

    feature: IntArray  # (F,) index of the map's labels
    mark: BoolArray  # (F,) whether it is a point mark, which its label must not hide
    inside: BoolArray  # (F,) whether it is a closed outline, whose label belongs inside it
    uv: Array  # (2, F) pixels
    rays: Array  # (3, F) the anchor's place on the map, as in Seen.rays
    half: Array  # (2, F) half of the feature's width and height in the picture, px


_NOTHING = np.empty(0, np.int64), np.empty(0, bool), np.empty(0, bool)
_NOWHERE = np.empty((2, 0)), np.empty((3, 0)), np.empty((2, 0))


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

    def find(
        self, lines: VisibleLines, marks: VisibleLines, shown: IntArray, most: int
    ) -> Features:
        """Return the anchors of at most ``most`` of the visible features; points are in pixels.

        Upper layers come first. Within a layer marks come first, then the features in ``shown``
        (those of the previous frame), then nearer features.
        """
        line = np.flatnonzero(self._labelled[lines.owner])
        mark = np.flatnonzero(self._labelled[marks.owner])
        if not len(line) and not len(mark):
            return Features(*_NOTHING, *_NOWHERE)
        mark_owner, line_owner = marks.owner[mark], lines.owner[line]
        near = np.concatenate([marks.rays[2, mark], lines.rays[2, lines.starts[line]]])
        chosen = self._first(mark_owner, line_owner, near, shown, most)
        row = np.full(len(self._layer), -1)
        row[chosen] = np.arange(len(chosen))
        points, half = np.zeros((5, len(chosen))), np.zeros((2, len(chosen)))
        is_mark = np.zeros(len(chosen), bool)
        if len(mark):
            of_mark = row[mark_owner]
            is_mark[of_mark[of_mark >= 0]] = True
            points[:, of_mark[of_mark >= 0]] = _columns(marks, mark[of_mark >= 0])
            row[chosen[is_mark]] = -1
        kept = line[row[line_owner] >= 0]
        outline = self._outline[chosen] & ~is_mark
        if len(kept):
            number = row[lines.owner[kept]]
            order = np.argsort(number, kind="stable")
            parts, number = picked(lines, kept[order]), number[order]
            at = np.unique(number)
            points[:, at], half[:, at] = _anchors(parts, number, outline[at])
        return Features(chosen, is_mark, outline, points[:2], points[2:], half)

    def _first(
        self, mark: IntArray, line: IntArray, near: Array, shown: IntArray, most: int
    ) -> IntArray:
        """Return the owners of marks and lines by importance; ``near`` is their inverse depth."""
        owner = np.concatenate([mark, line])
        is_line = np.arange(len(owner)) >= len(mark)
        was_shown = np.zeros(len(self._layer), bool)
        was_shown[shown] = True
        order = np.lexsort((-near, ~was_shown[owner], is_line, -self._layer[owner]))
        ordered = owner[order]
        place = np.arange(len(owner))
        first = np.empty(len(self._layer), np.int64)
        first[ordered[::-1]] = place[::-1]  # where an owner repeats, its first place is kept
        return np.asarray(ordered[first[ordered] == place][:most])


def _columns(seen: VisibleLines, vertex: IntArray) -> Array:
    """Return pixels and rays (5, N) of the given vertices."""
    return np.concatenate([seen.points.take(vertex, axis=1), seen.rays.take(vertex, axis=1)])


def _anchors(parts: VisibleLines, number: IntArray, outline: BoolArray) -> tuple[Array, Array]:
    """Return the label anchors (5, F) of F features, and half their extents (2, F).

    ``number`` (lines,) is each part's feature, in rising order; ``outline`` (F,) are closed ones.
    An anchor is the mean of the visible part, weighted by length, so that it moves smoothly as
    parts come into view. That of a line is moved to the line, that of an outline into it.
    """
    fresh = np.append(True, number[1:] != number[:-1])
    begins = parts.starts[:-1][fresh]
    row = np.repeat(np.cumsum(fresh) - 1, np.diff(parts.starts))
    points, links = np.concatenate([parts.points, parts.rays]), parts.links()
    low = np.minimum.reduceat(points[:2], begins, axis=1)
    high = np.maximum.reduceat(points[:2], begins, axis=1)
    # A vertex weighs as much as half the segments on both sides.
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
    farthest_first = np.argsort(-away, kind="stable")  # the nearest is written last and stays
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
    # To the middle of the widest span, which is written last and stays.
    widest = np.argsort(end[0] - begin[0], kind="stable")
    places[:, of[order[::2]][widest]] = ((begin + end) / 2)[:, widest]
