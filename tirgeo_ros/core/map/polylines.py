"""Hold many polylines in one block of memory, to cut and subdivide them together.

``points`` is (k, V), so each coordinate is one contiguous row. Line ``i`` is
``points[:, starts[i]:starts[i + 1]]`` and belongs to ``owner[i]``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray

T = TypeVar("T", bound=np.generic)

_OFTEN = 64  # from this many lines of one length on, one NumPy call takes them all


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
        """Return as ``split_rows`` the lines with these rising indices, in arbitrary order.

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

    def parted(self, count: int) -> tuple[Polylines, Polylines]:
        """Split into the first ``count`` lines and the others."""
        starts, owner, at = self.starts, self.owner, int(self.starts[count])
        return (
            Polylines(self.points[:, :at], starts[: count + 1], owner[:count]),
            Polylines(self.points[:, at:], starts[count:] - at, owner[count:]),
        )

    def cut(self, enter: Array, leave: Array) -> Polylines:
        """Return the lines with segment ``i`` cut to its part from ``enter[i]`` to ``leave[i]``.

        Both are (V - 1,) fractions from 0, the segment's first point, to 1, its second. Nothing is
        kept where ``enter >= leave``; this must hold between the end of one line and the next.
        Segments that still meet stay in one line.
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
        """Divide segment ``i`` into ``pieces[i]`` equal pieces; (V - 1,), 1 between two lines."""
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
        return replace(
            self, points=points, starts=np.append(after - pieces, after[-1])[self.starts]
        )


def runs(first: IntArray, count: IntArray) -> tuple[IntArray, IntArray]:
    """Return runs of ``count[i]`` integers from ``first[i]`` on, joined, and where each begins.

    The second array has one entry more: the end of the last run.
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
