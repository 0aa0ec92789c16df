"""Clip lines to the camera's field of view, before they are projected.

The inside is where all of a set of linear functions are not negative (the near and far planes and
the four sides of the field of view), or a disc (the radius up to which the lens model is valid).
Most segments lie wholly inside or outside, which an outcode of one byte for each point shows
(Cohen and Sutherland). The others are cut along their length (Liang and Barsky).
"""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray

_BITS = (1 << np.arange(8, dtype=np.uint8))[:, None]


def clip_to_planes(lines: Polylines, normals: Array, offsets: Array) -> Polylines:
    """Return the part of lines where ``normals @ point >= offsets``; (m, k), (m,), m up to 8."""
    distance = normals @ lines.points - offsets[:, None]
    code = np.bitwise_or.reduce((distance < 0) * _BITS[: len(normals)], axis=0)
    if not code.any():
        return lines
    links = lines.links()
    keep = links & ((code[:-1] & code[1:]) == 0)
    crossing = np.flatnonzero(keep & ((code[:-1] | code[1:]) != 0))
    start, end = distance[:, crossing], distance[:, crossing + 1]
    change = np.where((start < 0) == (end < 0), 1.0, start - end)
    at = start / change
    enter = np.where(start < 0, at, 0.0).max(axis=0)
    leave = np.where(end < 0, at, 1.0).min(axis=0)
    return _cut(lines, keep, crossing, enter, leave)


def clip_to_disc(lines: Polylines, radius: float) -> Polylines:
    """Return the part of lines within a radius of the origin, in their first two coordinates."""
    excess = lines.points[0] ** 2 + lines.points[1] ** 2 - radius**2
    outside = excess > 0
    if not outside.any():
        return lines
    keep = lines.links()
    crossing = np.flatnonzero(keep & (outside[:-1] | outside[1:]))
    start = lines.points[:2, crossing]
    step = lines.points[:2, crossing + 1] - start
    # |start + t step|^2 = radius^2
    a, b = (step**2).sum(axis=0), (start * step).sum(axis=0)
    root = b * b - a * excess[crossing]
    meets = (root > 0) & (a > 0)
    root, a = np.sqrt(np.where(meets, root, 0.0)), np.where(meets, a, 1.0)
    enter = np.where(meets, np.maximum((-b - root) / a, 0.0), 1.0)
    leave = np.where(meets, np.minimum((-b + root) / a, 1.0), 0.0)
    return _cut(lines, keep, crossing, enter, leave)


def _cut(
    lines: Polylines, keep: BoolArray, crossing: IntArray, enter: Array, leave: Array
) -> Polylines:
    enter_all, leave_all = np.zeros(len(keep)), np.where(keep, 1.0, 0.0)
    enter_all[crossing], leave_all[crossing] = enter, leave
    return lines.cut(enter_all, leave_all)
