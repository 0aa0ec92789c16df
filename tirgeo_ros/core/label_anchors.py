"""Where in the picture the labels of a map's features belong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.polylines import BoolArray, IntArray, Polylines
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
        lines, marks = self._named(lines), self._named(marks)
        chosen = self._first(lines, marks, shown, most)
        is_mark = np.isin(chosen, marks.owner)
        uv, half = np.zeros((2, len(chosen))), np.zeros((2, len(chosen)))
        index = np.full(len(self._layer), -1)
        index[chosen] = np.arange(len(chosen))
        of_mark = index[marks.owner]
        uv[:, of_mark[of_mark >= 0]] = marks.points[:2, of_mark >= 0]
        index[chosen[is_mark]] = -1
        of_line = index[lines.owner]
        kept = np.flatnonzero(of_line >= 0)
        if len(kept):
            segments = _Segments.of(lines.select(kept), of_line[kept])
            uv[:, segments.numbers], half[:, segments.numbers] = segments.anchors(
                self._outline[chosen]
            )
        return Anchors(chosen, is_mark, self._outline[chosen] & ~is_mark, uv, half)

    def _named(self, lines: Seen) -> Seen:
        which = np.flatnonzero(self._labelled[lines.owner])
        picked = lines.select(which)
        near = lines.rays[2, lines.starts[which]]
        return Seen(picked.points, picked.starts, picked.owner, near[None])

    def _first(self, lines: Seen, marks: Seen, shown: IntArray, most: int) -> IntArray:
        """The features in order of importance. ``rays`` holds the nearness of each line here."""
        owner = np.concatenate([marks.owner, lines.owner])
        near = np.concatenate([marks.rays[0], lines.rays[0]])
        line = np.repeat([False, True], [len(marks), len(lines)])
        order = np.lexsort((-near, ~np.isin(owner, shown), line, -self._layer[owner]))
        _, first = np.unique(owner[order], return_index=True)
        return np.asarray(owner[order][np.sort(first)][:most])


def _outlines(lines: Polylines, features: int) -> BoolArray:
    """(features,): whether a feature has lines and all of them end where they begin."""
    ends = lines.points[:, lines.starts[1:] - 1] == lines.points[:, lines.starts[:-1]]
    outline = np.zeros(features, bool)
    outline[lines.owner] = True
    outline[lines.owner[~ends.all(axis=0)]] = False
    return outline


@dataclass(frozen=True, slots=True)
class _Segments:
    """Segments of lines in pixels, in the order of their features."""

    start: Array  # (2, S)
    end: Array  # (2, S)
    begins: IntArray  # (F,) where each feature's segments begin
    row: IntArray  # (S,) to which of the F each belongs
    numbers: IntArray  # (F,) the features

    @classmethod
    def of(cls, lines: Polylines, number: IntArray) -> _Segments:
        """Of lines, with the number of each one's feature."""
        linked = np.flatnonzero(lines.links())
        of_point = np.repeat(number, np.diff(lines.starts))[linked]
        order = np.argsort(of_point, kind="stable")
        linked = linked[order]
        numbers, begins, row = _runs(of_point[order])
        points = lines.points
        return cls(points[:, linked], points[:, linked + 1], begins, row, numbers)

    def anchors(self, outline: BoolArray) -> tuple[Array, Array]:
        """Where the labels belong (2, F) and half the features' extents (2, F).

        An outline's in it, a line's on it; both near the middle of what is seen of them, weighed
        by length, so that they glide, not jump, as parts come into view.
        """
        middle, half = self._middle(), self._half()
        inner, inside = self._inner(middle), outline[self.numbers]
        return np.where(inside, inner, self._nearest(middle)), half

    def _middle(self) -> Array:
        length = np.hypot(*(self.end - self.start)) + 1e-9
        weighed = np.vstack([(self.start + self.end) * (length / 2), length])
        total = np.add.reduceat(weighed, self.begins, axis=1)
        return np.asarray(total[:2] / total[2])

    def _half(self) -> Array:
        low = np.minimum.reduceat(np.minimum(self.start, self.end), self.begins, axis=1)
        high = np.maximum.reduceat(np.maximum(self.start, self.end), self.begins, axis=1)
        return np.asarray((high - low) / 2)

    def _nearest(self, uv: Array) -> Array:
        """For each feature the point of its segments that is nearest to uv (2, F)."""
        along, to_uv = self.end - self.start, uv[:, self.row] - self.start
        squared = (along * along).sum(axis=0) + 1e-9
        share = np.clip((along * to_uv).sum(axis=0) / squared, 0.0, 1.0)
        point = self.start + share * along
        away = ((point - uv[:, self.row]) ** 2).sum(axis=0)
        order = np.lexsort((away, self.row))
        return np.asarray(point[:, order[self.begins]])

    def _inner(self, uv: Array) -> Array:
        """Where uv (2, F) is, or moved along its row into the outline if that is not in it.

        An outline that the picture cuts is crossed by a row an odd number of times, or is so on
        both sides; then there is nothing to be said, and uv stays.
        """
        level = uv[1, self.row]
        across = np.flatnonzero((self.start[1] <= level) != (self.end[1] <= level))
        row, rise = self.row[across], (self.end - self.start)[:, across]
        share = (level[across] - self.start[1, across]) / rise[1]
        u = self.start[0, across] + share * rise[0]
        order = np.lexsort((u, row))
        u, row = u[order], row[order]
        _, begins, of_run = _runs(row)
        count = np.diff(np.append(begins, len(row)))
        place = np.arange(len(row)) - begins[of_run]
        enters = np.flatnonzero((place % 2 == 0) & (count % 2 == 0)[of_run])
        return _moved_inside(uv, u[enters], u[enters + 1], row[enters])


def _moved_inside(uv: Array, left: Array, right: Array, row: IntArray) -> Array:
    """Uv (2, F), in the middle of its widest span from left to right if it is in none."""
    held = np.zeros(uv.shape[1], bool)
    held[row[(left <= uv[0, row]) & (uv[0, row] <= right)]] = True
    widest = np.argsort(right - left, kind="stable")  # the last to be written stays
    widest = widest[~held[row[widest]]]
    moved = uv.copy()
    moved[0, row[widest]] = ((left + right) / 2)[widest]
    return moved


def _runs(numbers: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Of sorted numbers: the different ones, where each begins, and the run of each."""
    fresh = np.ones(len(numbers), bool)
    fresh[1:] = numbers[1:] != numbers[:-1]
    begins = np.flatnonzero(fresh)
    return numbers[begins], begins, np.cumsum(fresh) - 1
