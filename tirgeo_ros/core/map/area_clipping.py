"""Clip the insides of outlines to the camera's field of view, before they are projected.

Rings are clipped at one plane after another (Sutherland and Hodgman), all rings together. A ring
that a plane cuts into several parts stays one ring, with edges that run back and forth along the
plane. The even-odd fill rule still fills it correctly.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray

_DISC_SIDES = 64


def cut_rings_to_planes(rings: Polylines, normals: Array, offsets: Array) -> Polylines:
    """Return the part of the rings' insides where ``normals @ point >= offsets``; (m, k), (m,).

    The last point of a ring is joined to its first; it is not repeated.
    """
    for normal, offset in zip(normals, offsets, strict=True):
        rings = _cut(rings, normal @ rings.points - offset)
    return rings


def cut_rings_to_disc(rings: Polylines, radius: float) -> Polylines:
    """Return the part of the rings' insides within a radius of the origin, in the first two axes.

    The disc is approximated by an inscribed polygon of 64 sides, which loses 0.1 % of the radius
    between its corners.
    """
    inner = radius * math.cos(math.pi / _DISC_SIDES)
    far = np.hypot(*rings.points[:2]) > inner
    if not far.any():
        return rings
    turn = np.arange(_DISC_SIDES) * (2 * math.pi / _DISC_SIDES)
    normals = np.zeros((_DISC_SIDES, len(rings.points)))
    normals[:, 0], normals[:, 1] = -np.cos(turn), -np.sin(turn)
    return cut_rings_to_planes(rings, normals, np.full(_DISC_SIDES, -inner))


def disc(radius: float) -> Polylines:
    """Return the polygon, one ring (2, V), to which ``cut_rings_to_disc`` clips."""
    turn = (np.arange(_DISC_SIDES) + 0.5) * (2 * math.pi / _DISC_SIDES)
    points = radius * np.stack([np.cos(turn), np.sin(turn)])
    return Polylines(points, np.array([0, _DISC_SIDES]), np.zeros(1, np.int64))


def closed(rings: Polylines) -> Polylines:
    """Return the rings with their first point repeated at the end."""
    last = rings.starts[1:] - 1
    index = np.insert(np.arange(rings.points.shape[1]), last + 1, rings.starts[:-1])
    starts = rings.starts + np.arange(len(rings) + 1)
    return Polylines(rings.points.take(index, axis=1), starts, rings.owner)


def _cut(rings: Polylines, distance: Array) -> Polylines:
    """Return the part of the rings where ``distance`` (V,), linear in the points, is >= 0."""
    inside = distance >= 0
    if inside.all():
        return rings
    following = _following(rings)
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
    return _not_empty(points, np.append(0, after)[rings.starts], rings.owner)


def _following(rings: Polylines) -> IntArray:
    following = np.arange(1, rings.points.shape[1] + 1)
    following[rings.starts[1:] - 1] = rings.starts[:-1]
    return following


def _not_empty(points: Array, starts: IntArray, owner: IntArray) -> Polylines:
    left: BoolArray = np.diff(starts) > 0
    return Polylines(points, np.append(starts[:-1][left], starts[-1]), owner[left])
