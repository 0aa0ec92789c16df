"""What every format is read into: one table of features, as its file has them."""

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
from tirgeo_ros.io.parameters.suggestions import nearest

#: Of a file: beyond it, reading takes more than some seconds and more memory than a map may fill.
MOST_FEATURES = 500_000
#: The fewest positions that a point, a line and a ring have.
FEWEST = {"Point": 1, "LineString": 2, "Polygon": 3}

Part = tuple[str, NDArray[np.float64]]  # Point, LineString or Polygon (a ring); (n, 2) or (n, 3)


@dataclass(frozen=True, slots=True)
class Shapes:
    """Points, lines and rings of a table, end to end.

    Part ``i`` is ``points[starts[i]:starts[i + 1]]``: x, y, z (N, 3) in the table's own system,
    z nan where there is none. ``feature`` (parts) counts from 0 in the order of the file;
    ``closed`` (parts) marks rings.
    """

    points: Array
    starts: IntArray
    feature: IntArray
    closed: BoolArray


@dataclass(frozen=True, slots=True)
class Table:
    """Features of one kind, before they are laid on the Earth."""

    where: str  # begins every message about it
    name: str
    crs: str | None  # WKT, PROJ or a code; None: longitudes and latitudes in WGS84
    shapes: Shapes
    properties: Sequence[Mapping[str, Any]]  # of each feature
    fields: Collection[str]  # names of the properties
    left_out: tuple[str, ...] = ()  # what of the file is not in the shapes
    set_aside: int = 0  # features without a shape that the file crosses out, or left_out tells of
    no_crs: str = ""  # why there is no crs, where the format should have one
    faults: Faults = field(default_factory=Faults)  # features that are not, or not wholly, there
    empty: str = ""  # the message where no feature has a shape, if more can be said than that


@dataclass(slots=True)
class ShapeBuilder:
    """Collects parts that come as arrays, and what is wrong with others."""

    parts: list[NDArray[np.float64]] = field(default_factory=list)
    features: list[int] = field(default_factory=list)
    rings: list[bool] = field(default_factory=list)
    faults: Faults = field(default_factory=Faults)

    def take(self, feature: int, parts: Iterable[Part]) -> None:
        """Take the parts of a feature; none of one that turns out to be bad."""
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
        elif len(points) or kind == "Polygon":  # an empty line or point is a geometry of nothing
            self.faults.add(feature, f"a {kind} of {len(points)} positions is none")

    def shapes(self) -> Shapes:
        """All parts, in the order in which they came."""
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
    """The message for a map of nothing; ``instead`` is what it has, and what to do."""
    return f"{path}: the map has no feature with a geometry" + (instead and f": {instead}")


def starts_of(sizes: Iterable[int]) -> IntArray:
    """Where each part begins, and where the last one ends."""
    return np.fromiter(itertools.accumulate(sizes, initial=0), np.int64)


def check_layer(path: Path, layer: str, known: Collection[str]) -> None:
    """Refuse a layer that the file has not; "" is all of them."""
    if layer and layer not in known:
        raise MapError(f"{path}: there is no layer {layer!r}{nearest(layer, known)}")
