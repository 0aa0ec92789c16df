"""Where in the picture the labels of a map's features belong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.polylines import BoolArray, IntArray, Polylines, runs
from tirgeo_ros.core.samples import Array
from tirgeo_ros.core.vector_map import VectorMap
from tirgeo_ros.core.view import Seen


@dataclass(frozen=True, slots=True)
class Anchors:
    """Features with labels that are seen, the most important first; columns of one row each."""

    feature: IntArray  # (F,) index of the map's labels
    mark: BoolArray  # (F,) whether it is a mark, which its label must not hide
    inside: BoolArray  # (F,) whether it is an outline: its label belongs in it
    uv: Array  # (2, F) pixels
    rays: Array  # (3, F) the place on the map, as Seen has it
    half: Array  # (2, F) half of the feature's width and height in the picture, px


class AnchorFinder:
    """Finds the anchors of one map's labels in any view of it."""

    def __init__(self, vector_map: VectorMap) -> None:
        self._layer = vector_map.layer
        with_labels = np.array([layer.style.labels for layer in vector_map.layers], bool)
        self._labelled = vector_map.labelled & with_labels[vector_map.layer]
        self._outline = _outlines(vector_map.lines, len(vector_map.labels))

    def find(self, lines: Seen, marks: Seen, shown: IntArray, most: int) -> Anchors:
        """Anchors of at most so many features of what is seen (2, V), in pixels.

        Upper layers come first; in a layer marks, then what was ``shown`` before (features), then
        what is nearer.
        """
        line = np.flatnonzero(self._labelled[lines.owner])
        mark = np.flatnonzero(self._labelled[marks.owner])
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
            segments = _Segments.of(lines, kept, row[lines.owner[kept]])
            at = segments.numbers
            points[:, at], half[:, at] = segments.anchors(outline)
        return Anchors(chosen, is_mark, outline, points[:2], points[2:], half)

    def _first(
        self, mark: IntArray, line: IntArray, near: Array, shown: IntArray, most: int
    ) -> IntArray:
        """The owners of marks and lines, of these nearnesses, in order of importance."""
        owner = np.concatenate([mark, line])
        is_line = np.arange(len(owner)) >= len(mark)
        was_shown = np.zeros(len(self._layer), bool)
        was_shown[shown] = True
        order = np.lexsort((-near, ~was_shown[owner], is_line, -self._layer[owner]))
        ordered = owner[order]
        place = np.arange(len(owner))
        first = np.empty(len(self._layer), np.int64)
        first[ordered[::-1]] = place[::-1]  # the last to be written stays
        return np.asarray(ordered[first[ordered] == place][:most])


def _columns(seen: Seen, vertex: IntArray) -> Array:
    """(5, N): pixels and rays of some vertices."""
    return np.concatenate([seen.points.take(vertex, axis=1), seen.rays.take(vertex, axis=1)])


def _outlines(lines: Polylines, features: int) -> BoolArray:
    """(features,): whether a feature has lines and all of them end where they begin."""
    ends = lines.points[:, lines.starts[1:] - 1] == lines.points[:, lines.starts[:-1]]
    outline = np.zeros(features, bool)
    outline[lines.owner] = True
    outline[lines.owner[~ends.all(axis=0)]] = False
    return outline


@dataclass(frozen=True, slots=True)
class _Segments:
    """Segments of lines in the order of their features; pixels and rays of their ends."""

    start: Array  # (5, S)
    end: Array  # (5, S)
    begins: IntArray  # (F,) where each feature's segments begin
    row: IntArray  # (S,) to which of the F each belongs
    numbers: IntArray  # (F,) the features

    @classmethod
    def of(cls, lines: Seen, which: IntArray, number: IntArray) -> _Segments:
        """Of lines, with the number of each one's feature."""
        order = np.argsort(number, kind="stable")
        which, number = which[order], number[order]
        first = lines.starts[which]
        count = lines.starts[which + 1] - first
        vertex, starts = runs(first, count)
        linked = np.ones(len(vertex), bool)
        linked[starts[1:] - 1] = False
        start = np.flatnonzero(linked)
        numbers, begins, row = _runs(np.repeat(number, count - 1))
        points = _columns(lines, vertex)
        return cls(points.take(start, 1), points.take(start + 1, 1), begins, row, numbers)

    def anchors(self, outline: BoolArray) -> tuple[Array, Array]:
        """Where the labels belong (5, F) and half the features' extents (2, F).

        An outline's in it, a line's on it; both near the middle of what is seen of them, weighed
        by length, so that they glide, not jump, as parts come into view.
        """
        middle, half = self._middle(), self._half()
        inside = outline[self.numbers]
        places = middle if inside.all() else self._nearest(middle[:2])
        if inside.any():
            places = np.where(inside, self._inner(middle), places)
        return places, half

    def _middle(self) -> Array:
        length = np.hypot(*(self.end - self.start)[:2]) + 1e-9
        weighed = np.vstack([(self.start + self.end) * (length / 2), length])
        total = np.add.reduceat(weighed, self.begins, axis=1)
        return np.asarray(total[:-1] / total[-1])

    def _half(self) -> Array:
        start, end = self.start[:2], self.end[:2]
        low = np.minimum.reduceat(np.minimum(start, end), self.begins, axis=1)
        high = np.maximum.reduceat(np.maximum(start, end), self.begins, axis=1)
        return np.asarray((high - low) / 2)

    def _nearest(self, uv: Array) -> Array:
        """For each feature the point (5, F) of its segments that is nearest to uv (2, F)."""
        along, to_uv = self.end - self.start, uv[:, self.row] - self.start[:2]
        squared = (along[:2] * along[:2]).sum(axis=0) + 1e-9
        share = np.clip((along[:2] * to_uv).sum(axis=0) / squared, 0.0, 1.0)
        point = self.start + share * along
        away = ((point[:2] - uv[:, self.row]) ** 2).sum(axis=0)
        order = np.lexsort((away, self.row))
        return np.asarray(point[:, order[self.begins]])

    def _inner(self, places: Array) -> Array:
        """Where places (5, F) are, or moved along their rows into the outlines that they are off.

        An outline that the picture cuts is crossed by a row an odd number of times, or is so on
        both sides; then there is nothing to be said, and the place stays.
        """
        level = places[1, self.row]
        across = np.flatnonzero((self.start[1] <= level) != (self.end[1] <= level))
        row, start = self.row[across], self.start[:, across]
        rise = self.end[:, across] - start
        point = start + (level[across] - start[1]) / rise[1] * rise
        order = np.lexsort((point[0], row))
        point, row = point[:, order], row[order]
        _, begins, of_run = _runs(row)
        count = np.diff(np.append(begins, len(row)))
        place = np.arange(len(row)) - begins[of_run]
        enters = np.flatnonzero((place % 2 == 0) & (count % 2 == 0)[of_run])
        return _moved_inside(places, point[:, enters], point[:, enters + 1], row[enters])


def _moved_inside(places: Array, left: Array, right: Array, row: IntArray) -> Array:
    """Places (5, F), in the middle of the widest span from left to right if they are in none."""
    held = np.zeros(places.shape[1], bool)
    held[row[(left[0] <= places[0, row]) & (places[0, row] <= right[0])]] = True
    widest = np.argsort(right[0] - left[0], kind="stable")  # the last to be written stays
    widest = widest[~held[row[widest]]]
    moved = places.copy()
    moved[:, row[widest]] = ((left + right) / 2)[:, widest]
    return moved


def _runs(numbers: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Of sorted numbers: the different ones, where each begins, and the run of each."""
    fresh = np.ones(len(numbers), bool)
    fresh[1:] = numbers[1:] != numbers[:-1]
    begins = np.flatnonzero(fresh)
    return numbers[begins], begins, np.cumsum(fresh) - 1
