# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Read the layers of a GeoPackage by GDAL: rows with their positions, and what it says of each."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
from pyogrio import raw

_PARTS = {1: "Point", 2: "LineString", 3: "Polygon"}
_Z = 0x80000000


def layers_in(path: Path) -> dict[str, str | None]:
    """The layers with their geometry, in the order of the file."""
    return dict(pyogrio.list_layers(path).tolist())


def rows_of(path: Path, layer: str, **options: Any) -> list[dict[str, Any]]:
    """The rows of a layer, ``positions`` (N, 2 or 3) among the columns."""
    about, _, shapes, columns = raw.read(path, layer=layer, datetime_as_string=True, **options)
    rows = [dict(zip(about["fields"], cells, strict=True)) for cells in zip(*columns, strict=True)]
    if shapes is None:
        return rows
    return [row | {"positions": _positions(bytes(s))} for row, s in zip(rows, shapes, strict=True)]


def _positions(wkb: bytes) -> np.ndarray:
    """The positions of a geometry, by the standard's text (OGC 06-103r4, 8.2).

    Of its two ways to say that there are heights, GDAL gives the older: the highest bit.
    """
    order, kind = struct.unpack("<BI", wkb[:5])
    assert order == 1
    size = 3 if kind & _Z else 2
    shape = _PARTS[kind & ~_Z]
    if shape == "Polygon":
        rings, count = struct.unpack("<II", wkb[5:13])
        assert rings == 1
        points = np.frombuffer(wkb[13:]).reshape(count, size)
        assert (points[0] == points[-1]).all()
        return points
    if shape == "LineString":
        return np.frombuffer(wkb[9:]).reshape(struct.unpack("<I", wkb[5:9])[0], size)
    return np.frombuffer(wkb[5:]).reshape(1, size)
