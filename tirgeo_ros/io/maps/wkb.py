"""Decode well-known binary (OGC 06-103r4, ISO 13249-3), with the flags of EWKB too."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tirgeo_ros.io.maps.feature_faults import FeatureError
from tirgeo_ros.io.maps.table import Part

#: Types of single geometries. Those for curves are accepted if they hold only straight lines, as
#: databases write them; an arc is refused.
_POINT, _LINE, _POLYGON, _TRIANGLE = 1, 2, 3, 17
_ARC, _COMPOUND_CURVE, _CURVE_POLYGON = 8, 9, 10
#: Multi-point to collection, multi-curve, multi-surface, polyhedral surface, TIN.
_COLLECTIONS = {4, 5, 6, 7, 11, 12, 15, 16}
_EWKB_Z, _EWKB_M, _EWKB_SRID = 0x80000000, 0x40000000, 0x20000000
_DEEPEST = 16  # collections in collections: more than any map has
_SMALLEST = 9  # bytes of a geometry: byte order, type, number of what it holds


def wkb_parts(data: bytes, start: int = 0) -> Iterator[Part]:
    """Yield the points, lines and rings of the geometry at ``start``; nothing for an empty one.

    Raises FeatureError for a curve, and for bytes that are no geometry.
    """
    try:
        yield from _Cursor(data, start).geometry(0)
    except struct.error:
        raise FeatureError("its geometry (WKB) ends too early") from None


class _Cursor:
    """Walk over the bytes of a geometry."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data = data
        self._at = at

    def geometry(self, depth: int) -> Iterator[Part]:
        order, base, width, height = self._header()
        if base == _POINT:
            point = self._positions(order, 1, width, height)
            if not np.isnan(point[:, :2]).all():  # an empty point has no other form
                yield "Point", point
        elif base == _LINE:
            count = self._count(order, 8 * width)
            yield "LineString", self._positions(order, count, width, height)
        elif base in {_POLYGON, _TRIANGLE}:
            for _ in range(self._count(order, 4)):
                count = self._count(order, 8 * width)
                yield "Polygon", self._positions(order, count, width, height)
        elif base == _ARC:
            raise FeatureError("a CircularString has arcs; save it as lines (segmentize it)")
        elif base == _COMPOUND_CURVE:
            yield "LineString", _joined([points for _, points in self._members(order, depth)])
        elif base == _CURVE_POLYGON:
            yield from (("Polygon", points) for _, points in self._members(order, depth))
        elif base in _COLLECTIONS:
            yield from self._members(order, depth)
        else:
            raise FeatureError(f"its geometry (WKB) is of the unknown type {base}")

    def _members(self, order: str, depth: int) -> Iterator[Part]:
        if depth == _DEEPEST:
            raise FeatureError("its geometry (WKB) is nested too deeply")
        for _ in range(self._count(order, _SMALLEST)):
            yield from self.geometry(depth + 1)

    def _header(self) -> tuple[str, int, int, int]:
        """Return byte order, type without flags, numbers in a position, and how many are used."""
        first = self._data[self._at] if self._at < len(self._data) else None
        if first not in {0, 1}:
            raise FeatureError("its geometry (WKB) is damaged: no byte order where one must be")
        order = "<" if first else ">"
        (kind,) = struct.unpack_from(order + "I", self._data, self._at + 1)
        self._at += 9 if kind & _EWKB_SRID else 5
        thousands, base = divmod(kind & 0x0FFFFFFF, 1000)
        if thousands > 3:
            raise FeatureError(f"its geometry (WKB) is of the unknown type {kind}")
        has_z = bool(kind & _EWKB_Z) or thousands in {1, 3}
        has_m = bool(kind & _EWKB_M) or thousands in {2, 3}
        return order, base, 2 + has_z + has_m, 2 + has_z

    def _count(self, order: str, size: int) -> int:
        """Return a count of items of at least ``size`` bytes each.

        Raises FeatureError if the rest of the bytes has no room for them.
        """
        (count,) = struct.unpack_from(order + "I", self._data, self._at)
        self._at += 4
        if count * size > len(self._data) - self._at:
            raise FeatureError(
                f"its geometry (WKB) ends before the {count} parts that it tells of"
            )
        return int(count)

    def _positions(self, order: str, count: int, width: int, height: int) -> NDArray[np.float64]:
        if count * width * 8 > len(self._data) - self._at:
            raise FeatureError("its geometry (WKB) ends too early")
        flat = np.frombuffer(self._data, order + "f8", count * width, self._at)
        self._at += 8 * count * width
        return flat.reshape(count, width)[:, :height]


def _joined(lines: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Join lines, each of which begins where the one before ends."""
    width = min((line.shape[1] for line in lines), default=2)
    return np.concatenate([np.empty((0, width)), *(line[:, :width] for line in lines)])
