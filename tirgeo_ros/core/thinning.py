"""Fewer lines with the same ink: what is flat and lies in one row of the picture is one span.

Seen from a drone, most of a large map is far off and flat: outlines and roads of less than half
a row. There may be thousands to a row.
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.polylines import IntArray, Polylines
from tirgeo_ros.core.samples import Array

_FAR_APART_PX = 1e6  # wider than any picture


def ends(lines: Polylines, across: Array) -> Polylines:
    """Of each line its points where ``across`` (V,) is least and most, as a line of two."""
    of = np.repeat(np.arange(len(lines)), np.diff(lines.starts))
    chosen = np.zeros((len(lines), 2), np.int64)
    for side, reduce in enumerate((np.minimum, np.maximum)):
        if len(lines):
            hits = np.flatnonzero(across == reduce.reduceat(across, lines.starts[:-1])[of])
            chosen[of[hits], side] = hits
    points = lines.points.take(chosen.ravel(), axis=1)
    return Polylines(points, 2 * np.arange(len(lines) + 1), lines.owner)


def merged(spans: Polylines, uv: Array, sheet: IntArray) -> Polylines:
    """Spans, lines of two points from left to right, with those that overlap in a row made one.

    ``uv`` (2, V) are their points in pixels; those of another ``sheet`` (lines,) stay apart.
    """
    if not len(spans):
        return spans
    left, right = uv[0, ::2], uv[0, 1::2]
    row = np.rint((uv[1, ::2] + uv[1, 1::2]) / 2)
    group = sheet * (row.max() - row.min() + 1) + row - row.min()
    order = np.lexsort((left, group))
    left, right = (side[order] + group[order] * _FAR_APART_PX for side in (left, right))
    reach = np.maximum.accumulate(right)
    fresh = np.flatnonzero(np.append(True, left[1:] > reach[:-1]))
    farthest = np.maximum.reduceat(right, fresh)
    span = np.repeat(np.arange(len(fresh)), np.diff(np.append(fresh, len(left))))
    last = np.zeros_like(fresh)
    hits = np.flatnonzero(right == farthest[span])
    last[span[hits]] = hits
    chosen = np.stack([2 * order[fresh], 2 * order[last] + 1], axis=1).ravel()
    points = spans.points.take(chosen, axis=1)
    return Polylines(points, 2 * np.arange(len(fresh) + 1), spans.owner[order[fresh]])
