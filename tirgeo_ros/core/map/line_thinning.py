"""Reduce the number of drawn lines: merge those that lie in one row of the picture into spans.

Seen from a drone, most of a large map is far away and flat in the picture: outlines and roads
lower than half a row, with up to thousands of them in a row.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.types.arrays import Array, IntArray

_FAR_APART_PX = 1e6  # wider than any picture


def ends(lines: Polylines, across: Array) -> Polylines:
    """Reduce each line to the two points where ``across`` (V,) is smallest and largest."""
    first, count = lines.starts[:-1], np.diff(lines.starts)
    chosen = np.empty((len(lines), 2), np.int64)
    for length in np.flatnonzero(np.bincount(count)).tolist():
        which = np.flatnonzero(count == length)
        begin = first[which]
        values = across[begin[:, None] + np.arange(length)]
        chosen[which, 0] = begin + values.argmin(axis=1)
        chosen[which, 1] = begin + values.argmax(axis=1)
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
