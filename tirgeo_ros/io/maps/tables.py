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
"""Hold the layers of a map file as tables of shapes and properties, in the file's coordinates."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray
from tirgeo_ros.core.types.errors import MapError, nearest
from tirgeo_ros.io.maps.style_sheet import Wanted, own_names

#: Limit for a layer: to read more takes longer than some seconds, and more memory than a map may
#: use.
MOST_FEATURES = 500_000
NAMES = ("name", "id")  # properties by which messages name a feature
#: The fewest positions that a point, a line and a ring have.
_FEWEST = {"Point": 1, "LineString": 2, "Polygon": 3}

#: A point, a line or a ring of a polygon: its type, and positions (n, 2) or (n, 3).
Part = tuple[str, NDArray[np.float64]]


@dataclass(slots=True)
class Shapes:
    """Hold points, lines and rings of a table, end to end.

    Part ``i`` is ``points[starts[i]:starts[i + 1]]``: x, y, z (N, 3), z nan where there is none.
    ``feature`` (parts) is the number of the part's feature in the file, from 0; ``closed`` (parts)
    marks rings.
    """

    points: Array
    starts: IntArray
    feature: IntArray
    closed: BoolArray


@dataclass(slots=True)
class Table:
    """Hold a layer of a file, in the file's own coordinate system."""

    where: str  # file and layer, which begin every message
    name: str
    crs: str | None  # WKT or a code
    shapes: Shapes
    rows: Sequence[Mapping[str, Any]]  # of each feature: wanted property -> value
    fields: Sequence[str]  # names of all properties
    faults: dict[int, str]  # feature -> why it is left out, wholly or in part
    notes: list[str] = field(default_factory=list)


def check_layer(path: Path, layer: str, names: Sequence[str]) -> None:
    """Raise MapError if a layer is wanted ("": all are) that is not among those of the file."""
    if layer and layer not in names:
        raise MapError(f"{path}: there is no layer {layer!r}{nearest(layer, names)}")


def check_number(where: str, features: int) -> None:
    """Raise MapError for more features than can be drawn."""
    if features > MOST_FEATURES:
        raise MapError(
            f"{where}: more than {MOST_FEATURES} features; cut out the area of the flight"
        )


def wanted_columns(wanted: Wanted, fields: Sequence[str], where: str) -> dict[str, str]:
    """Return wanted property -> the table's own name of it; raise ConfigError as the label."""
    wanted.label.check(fields, where)
    return own_names((*wanted.fields, *NAMES), fields)


def shapes_of(geometries: Iterable[list[Part] | str]) -> tuple[Shapes, dict[int, str]]:
    """Return the shapes of features, and the fault of each that has one.

    A feature is its parts, or the text of its fault.
    """
    parts: list[NDArray[np.float64]] = []
    owners: list[tuple[int, bool]] = []  # feature, closed
    faults: dict[int, str] = {}
    for number, geometry in enumerate(geometries):
        if isinstance(geometry, str):
            faults[number] = geometry
            continue
        for kind, points in geometry:
            if len(points) >= _FEWEST[kind]:
                parts.append(points)
                owners.append((number, kind == "Polygon"))
            elif len(points):
                faults[number] = f"a {kind} of {len(points)} positions is too short"
    starts = np.cumsum([0, *map(len, parts)])
    points = np.full((starts[-1], 3), np.nan)
    for part, (a, b) in zip(parts, itertools.pairwise(starts.tolist()), strict=True):
        points[a:b, : part.shape[1]] = part
    feature, closed = np.array(owners, int).reshape(-1, 2).T
    return Shapes(points, starts, feature, closed.astype(bool)), faults
