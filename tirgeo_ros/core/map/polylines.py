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
"""Hold many polylines in one block of memory, cut them, and simplify them by distance.

``points`` is (k, V), so each coordinate is one contiguous row. Line ``i`` is
``points[:, starts[i]:starts[i + 1]]`` and belongs to ``owner[i]``.

A map's lines are cut into short pieces, each at several levels of detail. The Douglas-Peucker rule
gives for each vertex the largest tolerance at which it is kept. A level of detail has the vertices
that are kept at one tolerance. The ends of a piece are kept at every level, so pieces of one line
meet at any levels. The distance between a line and its simplified line is within the tolerance,
for the vertices of both.

Seen from a drone, most of a large map is far away and flat in the picture: an outline or a road is
lower than half a pixel row, and one row has up to thousands of them. Lines that overlap in a row
are merged into spans.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray

T = TypeVar("T", bound=np.generic)

_OFTEN = 64  # at least this many lines of one length are taken with one NumPy call
# Levels of detail.
#: In metres on the map. Half a pixel of the XT2's camera is 6 cm at 100 m and 6 m at 10 km.
TOLERANCES_M = np.append(0.0, 0.01 * 2.0 ** np.arange(13))
#: Most vertices of a piece: enough to simplify, few enough to cull pieces well.
PIECE_VERTICES = 64
_BLOCK_PIECES = 64
#: A level that drops less than this share of the vertices is not worth its memory.
_LEAST_DROP = 0.25
_MORTON_BITS = 15
# Spans of a pixel row.
_ENDS_PER_UNIT = 2.0**31  # steps per unit on the plane z = 1: each a ten-thousandth of a pixel
_FAR_APART_PX = 1e6  # wider than any picture


@dataclass(frozen=True, slots=True)
class Polylines:
    """Hold lines of one or more points each."""

    points: Array  # (k, V)
    starts: IntArray  # (lines + 1,), the last is V
    owner: IntArray  # (lines,)

    def __len__(self) -> int:
        """Return the number of lines."""
        return len(self.owner)

    def split(self) -> list[Array]:
        """Return each line as an array (n, k)."""
        return self.split_rows(np.ascontiguousarray(self.points.T))

    def split_rows(self, rows: npt.NDArray[T]) -> list[npt.NDArray[T]]:
        """Split an array with one row for each point into one array for each line."""
        ends = self.starts.tolist()
        return [rows[a:b] for a, b in pairwise(ends)]

    def runs_of(self, rows: npt.NDArray[T], which: IntArray) -> list[npt.NDArray[T]]:
        """Split as ``split_rows`` the lines with these ascending indices, in arbitrary order.

        Lines of one length are taken together, in a third of the time that slicing takes.
        """
        if not len(which):
            return []
        if len(which) == len(self) and (np.diff(self.starts) == self.starts[1]).all():
            return list(rows.reshape(len(which), -1, *rows.shape[1:]))
        first, count = self.starts[which], self.starts[which + 1] - self.starts[which]
        times = np.bincount(count)
        lines: list[npt.NDArray[T]] = []
        for length in np.flatnonzero(times >= _OFTEN).tolist():
            index = first[count == length][:, None] + np.arange(length)
            lines.extend(rows.take(index, axis=0))
        rare = times[count] < _OFTEN
        ends = zip(first[rare].tolist(), (first + count)[rare].tolist(), strict=True)
        lines.extend([rows[a:b] for a, b in ends])
        return lines

    def links(self) -> BoolArray:
        """Return (V - 1,) whether each point and the next one belong to the same line."""
        links = np.ones(max(self.points.shape[1] - 1, 0), bool)
        links[self.starts[1:-1] - 1] = False
        return links

    def select(self, which: IntArray) -> Polylines:
        """Return the lines with these indices."""
        index, starts = runs(self.starts[which], self.starts[which + 1] - self.starts[which])
        return Polylines(self.points.take(index, axis=1), starts, self.owner[which])

    def cut(self, enter: Array, leave: Array) -> Polylines:
        """Return the lines with segment ``i`` cut to its part from ``enter[i]`` to ``leave[i]``.

        Both are (V - 1,) fractions from 0, the segment's first point, to 1, its second. A segment
        with ``enter >= leave`` is removed; between the end of one line and the start of the next,
        this must hold. Segments that still meet stay in one line.
        """
        kept = np.flatnonzero(enter < leave)
        opens, ends = enter[kept], leave[kept]
        fresh = np.ones(len(kept), bool)
        fresh[1:] = (np.diff(kept) > 1) | (ends[:-1] < 1) | (opens[1:] > 0)
        last = np.cumsum(1 + fresh) - 1  # index, in the result, of each kept segment's end
        starts = last[fresh] - 1
        count = int(last[-1]) + 1 if len(last) else 0
        source = np.empty(count, np.int64)
        source[last], source[starts] = kept + 1, kept[fresh]
        points = self.points.take(source, axis=1)
        for at, segment, fraction in ((last, kept, ends), (starts, kept[fresh], opens[fresh])):
            inner = (fraction > 0) & (fraction < 1)
            points[:, at[inner]] = self._along(segment[inner], fraction[inner])
        line = np.searchsorted(self.starts, kept[fresh], side="right") - 1
        return Polylines(points, np.append(starts, count), self.owner[line])

    def _along(self, segment: IntArray, fraction: Array) -> Array:
        start, end = self.points[:, segment], self.points[:, segment + 1]
        return np.asarray(start + fraction * (end - start))

    def subdivided(self, pieces: IntArray) -> Polylines:
        """Divide segment ``i`` into ``pieces[i]`` equal pieces; (V - 1,), 1 from line to line."""
        if not (pieces > 1).any():
            return self
        pieces = np.append(pieces, 1)
        after = np.cumsum(pieces)
        many = np.flatnonzero(pieces > 1)
        # First repeat each segment's first point, then move the copies to their places.
        points = np.repeat(self.points, pieces, axis=1)
        segment = np.repeat(many, pieces[many])
        place = np.arange(len(segment)) - np.repeat(np.cumsum(pieces[many]), pieces[many])
        fraction = place / pieces[segment] + 1
        points[:, after[segment] + place] = self._along(segment, fraction)
        starts = np.append(after - pieces, after[-1])[self.starts]
        return replace(self, points=points, starts=starts)


def runs(first: IntArray, count: IntArray) -> tuple[IntArray, IntArray]:
    """Join runs of ``count[i]`` integers from ``first[i]`` on; return them and where each begins.

    The second array has one more entry: the end of the last run.
    """
    starts = np.zeros(len(count) + 1, np.int64)
    np.cumsum(count, out=starts[1:])
    index = np.repeat(first - starts[:-1], count)
    index += np.arange(len(index))
    return index, starts


def joined(first: Polylines, second: Polylines) -> Polylines:
    """Return the lines of both, those of ``first`` before those of ``second``."""
    if not len(second):
        return first
    if not len(first):
        return second
    return Polylines(
        np.concatenate([first.points, second.points], axis=1),
        np.concatenate([first.starts, second.starts[1:] + first.starts[-1]]),
        np.concatenate([first.owner, second.owner]),
    )


@dataclass(frozen=True, slots=True)
class Boxes:
    """Hold axis-aligned boxes: ``bounds`` (6, N), m, has centres, then half sizes, in rows."""

    bounds: Array

    @classmethod
    def around(cls, low: Array, high: Array, starts: IntArray) -> Boxes:
        """Return N boxes, each around a run of boxes from ``low`` to ``high`` (3, V).

        ``starts`` (N + 1,) has the beginning of each run and the end of the last run.
        """
        if len(starts) < 2:
            return cls(np.empty((6, 0)))
        low = np.minimum.reduceat(low, starts[:-1], axis=1)
        high = np.maximum.reduceat(high, starts[:-1], axis=1)
        return cls(np.concatenate([(low + high) / 2, (high - low) / 2]))

    @property
    def centres(self) -> Array:
        """Return the centres (3, N), m."""
        return self.bounds[:3]

    @property
    def halves(self) -> Array:
        """Return half of the sizes (3, N), m."""
        return self.bounds[3:]

    def take(self, which: IntArray) -> Boxes:
        """Return the boxes with these indices."""
        return Boxes(self.bounds.take(which, axis=1))

    def in_view(self, normals: Array, offsets: Array) -> tuple[IntArray, BoolArray]:
        """Return the boxes not wholly outside any plane, and whether each is inside all planes.

        A point is inside where ``normals @ point >= offsets``; (m, 3), (m,).
        """
        reach = np.abs(normals)
        sides = np.hstack([np.vstack([normals, normals]), np.vstack([reach, -reach])])
        inside = (sides @ self.bounds).reshape(2, len(offsets), -1) >= offsets[:, None]
        partly: BoolArray = np.all(inside[0], axis=0)
        number = np.flatnonzero(partly)
        return number, np.all(inside[1], axis=0)[number]

    def distance(self, point: Array) -> Array:
        """Return the distances (N,), m, from a point (3,) to each box; 0 inside."""
        apart = np.abs(self.centres - point[:, None])
        apart -= self.halves
        np.maximum(apart, 0.0, out=apart)
        return np.asarray(np.sqrt(np.einsum("ij,ij->j", apart, apart)))


@dataclass(frozen=True)
class Details:
    """Hold pieces of lines, sorted by layer and location, at the levels of ``TOLERANCES_M``.

    ``points`` (3, M) holds all levels; piece ``i`` at level ``k`` is the run of ``count[k, i]``
    points from ``first[k, i]`` on. ``owner`` has the feature of each piece. ``boxes`` enclose the
    pieces; ``blocks`` are boxes that each enclose 64 of them.
    """

    points: Array
    first: IntArray
    count: IntArray
    owner: IntArray
    boxes: Boxes
    blocks: Boxes

    @classmethod
    def of(cls, lines: Polylines, layer: IntArray) -> Details:
        """Cut and simplify lines (3, V) of two points or more, with their ``layer`` (lines,)."""
        # The pieces of a line share their ends.
        segments = np.diff(lines.starts) - 1
        per_line = -(-segments // (PIECE_VERTICES - 1))
        line = np.repeat(np.arange(len(lines)), per_line)
        place, _ = runs(np.zeros_like(per_line), per_line)
        begin = lines.starts[line] + place * segments[line] // per_line[line]
        end = lines.starts[line] + (place + 1) * segments[line] // per_line[line]
        index, starts = runs(begin, end - begin + 1)
        pieces = Polylines(lines.points.take(index, axis=1), starts, lines.owner[line])
        boxes = Boxes.around(pieces.points, pieces.points, pieces.starts)
        order = np.lexsort((_morton(boxes.centres), layer[line]))
        pieces, boxes = pieces.select(order), boxes.take(order)
        points, first, count = _levels(pieces)
        low, high = boxes.centres - boxes.halves, boxes.centres + boxes.halves
        starts = np.append(np.arange(0, len(pieces), _BLOCK_PIECES), len(pieces))
        blocks = Boxes.around(low, high, starts if len(pieces) else starts[:1])
        return cls(points, first, count, pieces.owner, boxes, blocks)

    def in_view(self, normals: Array, offsets: Array) -> tuple[IntArray, BoolArray]:
        """Return ascending indices of the pieces not wholly outside planes, and which are inside.

        The arguments and the second result are as in ``Boxes.in_view``.
        """
        # Only the first half of ``Boxes.in_view``: which blocks are not wholly outside.
        nearest = np.concatenate([normals, np.abs(normals)], axis=1) @ self.blocks.bounds
        block = np.flatnonzero((nearest >= offsets[:, None]).all(axis=0))
        near = (block[:, None] * _BLOCK_PIECES + np.arange(_BLOCK_PIECES)).ravel()
        near = near[: np.searchsorted(near, len(self.owner))]
        number, whole = self.boxes.take(near).in_view(normals, offsets)
        return near[number], whole

    def vertices(self, piece: IntArray, level: IntArray) -> IntArray:
        """Return the numbers of vertices (N,) of pieces (N,) at their levels (N,)."""
        return self.count.take(self._place(piece, level))

    def _place(self, piece: IntArray, level: IntArray) -> IntArray:
        """Return flat indices into ``first`` and ``count``: ten times faster than two indices."""
        return level * len(self.owner) + piece

    def lines(self, piece: IntArray, level: IntArray) -> Polylines:
        """Return the polylines of pieces (N,), each at its level (N,)."""
        place = self._place(piece, level)
        index, starts = runs(self.first.take(place), self.count.take(place))
        return Polylines(self.points.take(index, axis=1), starts, self.owner[piece])


def levels_at(tolerance_m: Array) -> IntArray:
    """Return the coarsest level (N,) within each tolerance (N,), m."""
    # The tolerances double from level to level, so the binary exponent gives the level.
    _, exponent = np.frexp(tolerance_m * (1 / TOLERANCES_M[1]))
    level = np.minimum(np.maximum(exponent, 0), len(TOLERANCES_M) - 1)
    return np.asarray(level, np.int64)


def worths(lines: Polylines) -> Array:
    """Return the largest tolerance (V,), m, at which each vertex is kept; infinite at line ends.

    All lines are split together, each at the vertex farthest from its chord, until the remaining
    distances are within the smallest tolerance above 0.
    """
    worth = np.zeros(lines.points.shape[1])
    first, last = lines.starts[:-1], lines.starts[1:] - 1
    worth[first] = worth[last] = np.inf
    limit = np.full(len(lines), np.inf)
    while True:
        live = (last - first > 1) & (limit > TOLERANCES_M[1])
        first, last, limit = first[live], last[live], limit[live]
        if not len(first):
            return worth
        farthest, distance = _farthest(lines.points, first, last)
        limit = np.minimum(limit, distance)
        worth[farthest] = limit
        first, last = np.append(first, farthest), np.append(farthest, last)
        limit = np.append(limit, limit)


def _farthest(points: Array, first: IntArray, last: IntArray) -> tuple[IntArray, Array]:
    """Return the vertex farthest from each chord, ``first`` to ``last``, and its distance."""
    inner, starts = runs(first + 1, last - first - 1)
    of = np.repeat(np.arange(len(first)), last - first - 1)
    begin = points[:, first]
    chord = points[:, last] - begin
    squared = np.einsum("ij,ij->j", chord, chord)
    chord = chord[:, of]
    off = points[:, inner] - begin[:, of]
    along = np.einsum("ij,ij->j", off, chord) / np.where(squared > 0, squared, 1.0)[of]
    off -= np.clip(along, 0.0, 1.0) * chord
    distance = np.einsum("ij,ij->j", off, off)
    largest = np.maximum.reduceat(distance, starts[:-1])
    hits = np.flatnonzero(distance == largest[of])[::-1]
    at = np.empty_like(first)
    at[of[hits]] = inner[hits]  # in reversed order, so that the first of equal ones remains
    return at, np.sqrt(largest)


def _levels(pieces: Polylines) -> tuple[Array, IntArray, IntArray]:
    """Return the points of all levels, and the first index and count (levels, N) of each piece.

    If a level would drop too few vertices of a piece, the piece uses the previous level again.
    """
    worth = worths(pieces)
    lengths = np.diff(pieces.starts)
    count, first = [lengths], [pieces.starts[:-1]]
    parts, total = [pieces.points], pieces.points.shape[1]
    for tolerance_m in TOLERANCES_M[1:]:
        stays = worth > tolerance_m
        left = np.diff(np.append(0, np.cumsum(stays))[pieces.starts])
        fewer = left <= (1 - _LEAST_DROP) * count[-1]
        parts.append(pieces.points[:, stays & np.repeat(fewer, lengths)])
        added = np.where(fewer, left, 0)
        count.append(np.where(fewer, left, count[-1]))
        first.append(np.where(fewer, total + np.cumsum(added) - added, first[-1]))
        total += parts[-1].shape[1]
    return np.concatenate(parts, axis=1), np.stack(first), np.stack(count)


def _morton(centres: Array) -> IntArray:
    """Return Morton codes (N,) of centres (3, N): sorting by them keeps most neighbours close."""
    if not centres.size:
        return np.empty(0, np.int64)
    plane = centres[:2] - centres[:2].min(axis=1)[:, None]
    scale = ((1 << _MORTON_BITS) - 1) / max(float(plane.max()), 1e-9)
    cell = (plane * scale).astype(np.int64)
    mixed = np.zeros(cell.shape[1], np.int64)
    for bit in range(_MORTON_BITS):
        mixed |= ((cell[0] >> bit) & 1) << (2 * bit)
        mixed |= ((cell[1] >> bit) & 1) << (2 * bit + 1)
    return mixed


def ends(lines: Polylines, across: Array) -> Polylines:
    """Reduce each line to the two points where ``across`` (V,) is smallest and largest."""
    # A point's index is in the low bits of its key, so that the smallest key identifies the point.
    index_bits = len(across).bit_length()
    key = (across * _ENDS_PER_UNIT).astype(np.int64)
    key <<= index_bits
    key |= np.arange(len(across))
    first = lines.starts[:-1]
    chosen = np.stack([np.minimum.reduceat(key, first), np.maximum.reduceat(key, first)], axis=1)
    chosen &= (1 << index_bits) - 1
    points = lines.points.take(chosen.ravel(), axis=1)
    return Polylines(points, 2 * np.arange(len(lines) + 1), lines.owner)


def merged(spans: Polylines, uv: Array, sheet: IntArray) -> Polylines:
    """Merge spans, lines of two points from left to right, that overlap in a row of the picture.

    ``uv`` (2, V) are their points in pixels. Only spans with the same ``sheet`` (lines,) are
    merged. A merged span has the owner of its leftmost part.
    """
    if not len(spans):
        return spans
    left, right = uv[0, ::2], uv[0, 1::2]
    row = np.rint((uv[1, ::2] + uv[1, 1::2]) / 2)
    # Shift each row of each sheet by its own large offset, so that one sort serves all of them.
    offset = (sheet * (row.max() - row.min() + 1) + row) * _FAR_APART_PX
    left, right = left + offset, right + offset
    order = np.argsort(left)
    left, right = left[order], right[order]
    reach = np.maximum.accumulate(right)
    fresh = np.flatnonzero(left[1:] > reach[:-1]) + 1
    begin, end = np.append(0, fresh), np.append(fresh, len(left)) - 1
    farthest = np.maximum.accumulate(np.where(right == reach, np.arange(len(right)), 0))[end]
    first = order[begin]
    chosen = np.stack([2 * first, 2 * order[farthest] + 1], axis=1).ravel()
    points = spans.points.take(chosen, axis=1)
    return Polylines(points, 2 * np.arange(len(begin) + 1), spans.owner[first])
