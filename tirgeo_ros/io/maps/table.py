"""Define the table of features that every format is read into, in the file's own system."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps.feature_faults import Faults, FeatureError
from tirgeo_ros.io.parameters.parameter_file import nearest

#: Limit for a file: beyond it, reading takes more than some seconds and more memory than a map may
#: use.
MOST_FEATURES = 500_000
#: The fewest positions that a point, a line and a ring have.
FEWEST = {"Point": 1, "LineString": 2, "Polygon": 3}

Part = tuple[str, NDArray[np.float64]]  # Point, LineString or Polygon (a ring); (n, 2) or (n, 3)


@dataclass(frozen=True, slots=True)
class Shapes:
    """Hold points, lines and rings of a table, end to end.

    Part ``i`` is ``points[starts[i]:starts[i + 1]]``: x, y, z (N, 3) in the table's own system, z
    nan where there is none. ``feature`` (parts) counts from 0 in the order of the file; ``closed``
    (parts) marks rings.
    """

    points: Array
    starts: IntArray
    feature: IntArray
    closed: BoolArray


@dataclass(frozen=True, slots=True)
class Table:
    """Hold features of one kind, before their conversion to WGS84."""

    where: str  # begins every message about it
    name: str
    crs: str | None  # WKT, PROJ or a code; None: longitudes and latitudes in WGS84
    shapes: Shapes
    properties: Sequence[Mapping[str, Any]]  # of each feature
    fields: Collection[str]  # names of the properties
    left_out: tuple[str, ...] = ()  # what of the file is not in the shapes
    # features without a shape that the file marks as deleted, or that left_out mentions
    set_aside: int = 0
    no_crs: str = ""  # why there is no crs, where the format should have one
    faults: Faults = field(default_factory=Faults)  # features that are missing wholly or in part
    empty: str = ""  # the message if no feature has a shape, where there is more to say than that


@dataclass(slots=True)
class ShapeBuilder:
    """Collect parts that come as arrays, and the faults of others."""

    parts: list[NDArray[np.float64]] = field(default_factory=list)
    features: list[int] = field(default_factory=list)
    rings: list[bool] = field(default_factory=list)
    faults: Faults = field(default_factory=Faults)

    def take(self, feature: int, parts: Iterable[Part]) -> None:
        """Take the parts of a feature; none of a feature that turns out to be bad."""
        begun = len(self.parts)
        try:
            for kind, points in parts:
                self._add(feature, kind, points)
        except FeatureError as error:
            del self.parts[begun:], self.features[begun:], self.rings[begun:]
            self.faults.add(feature, str(error))

    def _add(self, feature: int, kind: str, points: NDArray[np.float64]) -> None:
        """Take a part unless it is empty, or has fewer positions than its kind needs."""
        if len(points) >= FEWEST[kind]:
            self.parts.append(points)
            self.features.append(feature)
            self.rings.append(kind == "Polygon")
        elif len(points) or kind == "Polygon":  # an empty line or point is a valid empty geometry
            self.faults.add(feature, f"a {kind} of {len(points)} positions is none")

    def shapes(self) -> Shapes:
        """Return all parts, in the order in which they came."""
        starts = starts_of(map(len, self.parts))
        points = np.full((starts[-1], 3), np.nan)
        for part, (a, b) in zip(self.parts, itertools.pairwise(starts.tolist()), strict=True):
            points[a:b, : part.shape[1]] = part
        return Shapes(points, starts, np.array(self.features, int), np.array(self.rings, bool))


def check_count(features: int, where: str) -> None:
    """Refuse more features than are drawn."""
    if features > MOST_FEATURES:
        raise MapError(
            f"{where}: more than {MOST_FEATURES} features; cut out the flight's surroundings"
        )


def empty_map(path: Path, instead: str = "") -> str:
    """Return the message for an empty map; ``instead`` is what it has, and what to do."""
    return f"{path}: the map has no feature with a geometry" + (instead and f": {instead}")


def starts_of(sizes: Iterable[int]) -> IntArray:
    """Return the start of each part, and the end of the last one."""
    return np.fromiter(itertools.accumulate(sizes, initial=0), np.int64)


def check_layer(path: Path, layer: str, known: Collection[str]) -> None:
    """Refuse a layer that the file does not have; "" means all of them."""
    if layer and layer not in known:
        raise MapError(f"{path}: there is no layer {layer!r}{nearest(layer, known)}")
