"""Clip lines and filled outlines to the camera's field of view, before they are projected.

The inside is where all of a set of linear functions are not negative (the near and far planes and
the four sides of the field of view), or a disc (the radius up to which the lens model is valid).
Most segments of lines lie wholly inside or outside, which an outcode of one byte for each point
shows (Cohen and Sutherland). The others are cut along their length (Liang and Barsky).

Rings are clipped at one plane after another (Sutherland and Hodgman), all rings together. A ring
that a plane cuts into several parts stays one ring, with edges that run back and forth along the
plane. The even-odd fill rule still fills it correctly.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray

_BITS = (1 << np.arange(8, dtype=np.uint8))[:, None]
_DISC_SIDES = 64


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
    return _cut_lines(lines, keep, crossing, enter, leave)


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
    return _cut_lines(lines, keep, crossing, enter, leave)


def _cut_lines(
    lines: Polylines, keep: BoolArray, crossing: IntArray, enter: Array, leave: Array
) -> Polylines:
    enter_all, leave_all = np.zeros(len(keep)), np.where(keep, 1.0, 0.0)
    enter_all[crossing], leave_all[crossing] = enter, leave
    return lines.cut(enter_all, leave_all)


def cut_rings_to_planes(rings: Polylines, normals: Array, offsets: Array) -> Polylines:
    """Return the part of the rings' insides where ``normals @ point >= offsets``; (m, k), (m,).

    The last point of a ring is joined to its first; it is not repeated.
    """
    for normal, offset in zip(normals, offsets, strict=True):
        rings = _cut_rings(rings, normal @ rings.points - offset)
    return rings


def cone(radius: float) -> Array:
    """Return the normals (64, 3) of planes through the camera that hold an inscribed polygon.

    The polygon of 64 sides lies in the disc of a radius on the plane z = 1. Between its corners
    0.1 % of the radius is lost.
    """
    turn = np.arange(_DISC_SIDES) * (2 * math.pi / _DISC_SIDES)
    inner = np.full(_DISC_SIDES, radius * math.cos(math.pi / _DISC_SIDES))
    return np.stack([-np.cos(turn), -np.sin(turn), inner], axis=1)


def disc(radius: float) -> Polylines:
    """Return the polygon, one ring (2, V), in which the planes of ``cone`` meet z = 1."""
    turn = (np.arange(_DISC_SIDES) + 0.5) * (2 * math.pi / _DISC_SIDES)
    points = radius * np.stack([np.cos(turn), np.sin(turn)])
    return Polylines(points, np.array([0, _DISC_SIDES]), np.zeros(1, np.int64))


def closed(rings: Polylines) -> Polylines:
    """Return the rings with their first point repeated at the end."""
    last = rings.starts[1:] - 1
    index = np.insert(np.arange(rings.points.shape[1]), last + 1, rings.starts[:-1])
    starts = rings.starts + np.arange(len(rings) + 1)
    return Polylines(rings.points.take(index, axis=1), starts, rings.owner)


def _cut_rings(rings: Polylines, distance: Array) -> Polylines:
    """Return the part of the rings where ``distance`` (V,), linear in the points, is >= 0."""
    inside = distance >= 0
    if inside.all():
        return rings
    following = np.arange(1, rings.points.shape[1] + 1)
    following[rings.starts[1:] - 1] = rings.starts[:-1]
    crosses = inside != inside[following]
    count = inside.astype(np.int64) + crosses
    after = np.cumsum(count)
    points = np.empty((len(rings.points), int(after[-1])))
    points[:, (after - count)[inside]] = rings.points[:, inside]
    start = np.flatnonzero(crosses)
    end = following[start]
    share = distance[start] / (distance[start] - distance[end])
    points[:, after[start] - 1] = rings.points[:, start] + share * (
        rings.points[:, end] - rings.points[:, start]
    )
    starts = np.append(0, after)[rings.starts]
    left = np.diff(starts) > 0
    return Polylines(points, np.append(starts[:-1][left], starts[-1]), rings.owner[left])
