"""Many polylines in one block of memory, cut and subdivided together.

Component by component: ``points`` is (k, V), so each coordinate is one contiguous row. Line ``i``
is ``points[:, starts[i]:starts[i + 1]]`` and belongs to ``owner[i]``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.samples import Array

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Polylines:
    """Lines of one or more points each."""

    points: Array  # (k, V)
    starts: IntArray  # (lines + 1,), the last is V
    owner: IntArray  # (lines,)

    def __len__(self) -> int:
        """Return the number of lines."""
        return len(self.owner)

    def split(self) -> list[Array]:
        """Each line as an array (n, k)."""
        rows = self.points.T
        return [rows[a:b] for a, b in zip(self.starts[:-1], self.starts[1:], strict=True)]

    def links(self) -> BoolArray:
        """(V - 1,): whether a point and the next one are of the same line."""
        links = np.ones(max(self.points.shape[1] - 1, 0), bool)
        links[self.starts[1:-1] - 1] = False
        return links

    def select(self, which: IntArray) -> Polylines:
        """The lines of these numbers."""
        if len(which) == len(self):
            return self
        lengths = self.starts[which + 1] - self.starts[which]
        starts = np.concatenate([[0], np.cumsum(lengths)])
        index = np.arange(starts[-1]) + np.repeat(self.starts[which] - starts[:-1], lengths)
        return Polylines(self.points[:, index], starts, self.owner[which])

    def cut(self, enter: Array, leave: Array) -> Polylines:
        """What is left when segment ``i`` keeps only its part from ``enter`` to ``leave``.

        (V - 1,) fractions from 0, the first point, to 1, the second; nothing is kept where
        ``enter >= leave``, which must hold between two lines. Segments that still meet stay
        in one line.
        """
        kept = np.flatnonzero(enter < leave)
        opens, ends = enter[kept], leave[kept]
        fresh = np.ones(len(kept), bool)
        fresh[1:] = (np.diff(kept) > 1) | (ends[:-1] < 1) | (opens[1:] > 0)
        last = np.cumsum(1 + fresh) - 1  # where the end of each kept segment goes
        points = np.empty((len(self.points), int(last[-1]) + 1 if len(last) else 0))
        points[:, last] = self._along(kept, ends)
        starts = last[fresh] - 1
        points[:, starts] = self._along(kept[fresh], opens[fresh])
        line = np.searchsorted(self.starts, kept[fresh], side="right") - 1
        return Polylines(points, np.append(starts, points.shape[1]), self.owner[line])

    def _along(self, segment: IntArray, fraction: Array) -> Array:
        start, end = self.points[:, segment], self.points[:, segment + 1]
        # Whole ends are copied, so that a line which is not cut comes out bit for bit.
        return np.where(fraction == 1, end, start + fraction * (end - start))

    def subdivided(self, pieces: IntArray) -> Polylines:
        """Segment ``i`` in ``pieces[i]`` equal pieces; (V - 1,), 1 between two lines."""
        if not (pieces > 1).any():
            return self
        pieces = np.append(pieces, 1)
        before = np.cumsum(pieces) - pieces
        source = np.repeat(np.arange(len(pieces)), pieces)
        fraction = (np.arange(len(source)) - before[source]) / pieces[source]
        step = np.diff(self.points, axis=1, append=0.0)
        points = self.points[:, source] + fraction * step[:, source]
        return replace(self, points=points, starts=np.append(before, len(source))[self.starts])
