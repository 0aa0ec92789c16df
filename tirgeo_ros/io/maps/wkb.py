"""Decode well-known binary (OGC 06-103r4, ISO 13249-3) as GDAL writes it."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

Part = tuple[str, NDArray[np.float64]]  # Point, LineString or Polygon (a ring); (n, 2) or (n, 3)

_POINT, _LINE, _POLYGON, _TRIANGLE = 1, 2, 3, 17
#: Multi-point to collection, polyhedral surface, TIN.
_COLLECTIONS = {4, 5, 6, 7, 15, 16}


def wkb_parts(data: bytes) -> list[Part]:
    """Return the points, lines and rings of a geometry; none of an empty one.

    Raises ValueError for a type that cannot be drawn.
    """
    found: list[Part] = []
    _read(data, 0, found)
    return found


def _read(data: bytes, at: int, found: list[Part]) -> int:
    """Append the parts of the geometry at an offset, and return the offset of its end."""
    (code,) = struct.unpack_from("<I", data, at + 1)
    thousands, kind = divmod(code & 0xFFFF, 1000)
    height = 3 if code >> 31 or thousands in {1, 3} else 2
    width = height + (thousands in {2, 3})
    at += 5

    def count() -> int:
        nonlocal at
        at += 4
        return int(struct.unpack_from("<I", data, at - 4)[0])

    def positions(name: str, number: int) -> None:
        nonlocal at
        points = np.frombuffer(data, "<f8", number * width, at).reshape(number, width)
        at += 8 * number * width
        if name != "Point" or not np.isnan(points[0, :2]).all():  # nan: an empty point
            found.append((name, points[:, :height]))

    if kind == _POINT:
        positions("Point", 1)
    elif kind == _LINE:
        positions("LineString", count())
    elif kind in {_POLYGON, _TRIANGLE}:
        for _ in range(count()):
            positions("Polygon", count())
    elif kind in _COLLECTIONS:
        for _ in range(count()):
            at = _read(data, at, found)
    else:
        raise ValueError(f"a geometry of type {kind} (WKB) cannot be drawn; save it as lines")
    return at
