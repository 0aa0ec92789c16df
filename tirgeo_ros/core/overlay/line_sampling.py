"""Sample lines in the picture at the points where their uncertainty is computed; fade them by it.

The uncertainty changes slowly along a line, so one value every few pixels is enough. A short line
has one opacity; a longer one is cut where its opacity changes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.map.polylines import Polylines, joined, runs
from tirgeo_ros.core.map.visibility import VisibleLines
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray

#: The uncertainty changes little over this length of a line.
STEP_PX = 48.0


class Samples(NamedTuple):
    """Hold some vertices of lines, including the first and the last of each line."""

    vertex: IntArray  # (S,) index of the vertex
    line: IntArray  # (S,) index of the line

    def links(self) -> BoolArray:
        """Return (S - 1,): whether a sample and the next one are of the same line."""
        return np.asarray(self.line[1:] == self.line[:-1])


def short(lines: VisibleLines) -> BoolArray:
    """Return (lines,): whether the uncertainty changes little along the whole line."""
    way = np.empty(lines.points.shape[1])
    way[:-1] = _lengths(lines)
    way[lines.starts[1:] - 1] = 0.0
    return np.asarray(np.add.reduceat(way, lines.starts[:-1]) <= 2 * STEP_PX)


def picked(lines: VisibleLines, which: IntArray) -> VisibleLines:
    """Return the lines with these indices."""
    first = lines.starts[which]
    index, starts = runs(first, lines.starts[which + 1] - first)
    points, rays = (rows.take(index, axis=1) for rows in (lines.points, lines.rays))
    return VisibleLines(points, starts, lines.owner[which], rays)


def sampled(lines: VisibleLines, step_px: float) -> tuple[VisibleLines, Samples]:
    """Return the lines and the vertices at which each further step along a line begins.

    Lengths are measured along the larger axis. Segments much longer than STEP_PX get more
    vertices, because the uncertainty may change along them. The points already contain the
    lens distortion.
    """
    length = _lengths(lines)
    long = np.flatnonzero((length > 2 * STEP_PX) & lines.links())
    if len(long):
        pieces = np.ones(len(length), np.int64)
        pieces[long] = np.ceil(length[long] / STEP_PX)
        both = np.concatenate([lines.points, lines.rays])
        finer = Polylines(both, lines.starts, lines.owner).subdivided(pieces)
        lines = VisibleLines(finer.points[:2], finer.starts, finer.owner, finer.points[2:])
        length = _lengths(lines)
    way = (np.cumsum(length) / step_px).astype(np.int64)
    chosen = np.zeros(lines.points.shape[1], bool)
    chosen[1:-1] = way[1:] != way[:-1]
    chosen[lines.starts[:-1]] = chosen[lines.starts[1:] - 1] = True
    vertex = np.flatnonzero(chosen)
    return lines, Samples(vertex, np.searchsorted(lines.starts, vertex, side="right") - 1)


def _lengths(lines: VisibleLines) -> Array:
    step = lines.points[:, 1:] - lines.points[:, :-1]
    np.abs(step, out=step)
    return np.asarray(np.maximum(step[0], step[1], out=step[0]))


def cut(lines: Polylines, some: Samples, value: Array) -> tuple[Polylines, IntArray]:
    """Cut the lines where the value of the interval between two samples changes.

    ``value`` is (S - 1,). Return the parts and the first sample of each.
    """
    links = some.links()
    changes = value[1:] != value[:-1]
    opens, closes = links.copy(), links.copy()
    opens[1:] &= changes | ~links[:-1]
    first = np.flatnonzero(opens)
    if len(first) == len(lines) and not (changes & links[1:] & links[:-1]).any():
        return lines, first
    closes[:-1] &= changes | ~links[1:]
    begin, end = some.vertex[first], some.vertex[np.flatnonzero(closes) + 1]
    index, starts = runs(begin, end - begin + 1)
    owner = lines.owner[some.line[first]]
    return Polylines(lines.points[:2].take(index, axis=1), starts, owner), first


def fading(
    lines: VisibleLines,
) -> tuple[Array, IntArray, Callable[[Array], tuple[Polylines, Array]]]:
    """Choose the points of lines at which their opacity is needed: rays (3, N), features (N,).

    They are a middle vertex of each short line, then the middles of the longer lines' intervals.
    The third result returns, for the opacity (N,) of the points, the lines cut where it changes,
    and their opacities.
    """
    whole = short(lines)
    few = lines if whole.all() else picked(lines, np.flatnonzero(whole))
    half_way = few.rays.take((few.starts[:-1] + few.starts[1:]) // 2, axis=1)
    if whole.all():
        return half_way, few.owner, lambda opacity: (few, opacity)
    many, samples = sampled(picked(lines, np.flatnonzero(~whole)), STEP_PX)
    ways = np.flatnonzero(samples.links())  # the sample at which each interval begins
    first, last = samples.vertex[ways], samples.vertex[ways + 1]
    middle = (many.rays.take(first, axis=1) + many.rays.take(last, axis=1)) / 2
    rays = np.concatenate([half_way, middle], axis=1)
    owner = np.concatenate([few.owner, many.owner[samples.line[ways]]])

    def cut_by(opacity: Array) -> tuple[Polylines, Array]:
        of_short, of_ways = np.split(opacity, [len(few)])
        along = np.ones(len(samples.line) - 1)
        along[ways] = of_ways
        parts, way = cut(many, samples, along)
        return joined(parts, few), np.concatenate([along[way], of_short])

    return rays, owner, cut_by
