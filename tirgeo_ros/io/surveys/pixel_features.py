"""Read GeoJSON whose coordinates are pixels of a picture, and write it in degrees.

Such files are digitised on a picture without a coordinate system. Features, properties and kinds
of geometry stay as they are. The coordinates are taken out as one array and put back as longitudes
and latitudes. A third coordinate is dropped: a picture has none.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.files.memory_bound import bounded_memory
from tirgeo_ros.io.surveys.control_points import downward

#: What reading coordinates raises where there are none.
_NO_POSITIONS = (KeyError, TypeError, ArithmeticError, ValueError, IndexError, RecursionError)
_LEFT_OUT = ("crs", "bbox")  # these refer to other coordinates


class PixelFeatures:
    """Hold a FeatureCollection in pixels. Raises MapError naming file and feature."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        try:
            with bounded_memory():
                self._take(self._read())
        except MemoryError:
            raise MapError(f"{path}: does not fit into memory; split it") from None

    def _take(self, features: list[dict[str, Any]]) -> None:
        self._features = features
        pairs: list[tuple[float, float]] = []
        self._owners: list[int] = []
        for number, feature in enumerate(features, 1):
            before = len(pairs)
            try:
                _mapped(feature.get("geometry"), lambda place: pairs.append(_position(place)))
            except _NO_POSITIONS:
                raise MapError(
                    f"{self._path}: feature {number} has coordinates that are not column and row"
                ) from None
            self._owners += [number - 1] * (len(pairs) - before)
        self.pixels: Array = downward(np.array(pairs, float).reshape(-1, 2))  # (n, 2)

    @property
    def count(self) -> int:
        """Return the number of features."""
        return len(self._features)

    def features_with(self, vertices: BoolArray) -> int:
        """Return how many features have one of these vertices (n, bool)."""
        return len(set(np.array(self._owners, int)[vertices].tolist()))

    def geojson(self, degrees: Array) -> str:
        """Return the collection with the pixels replaced by longitude, latitude (n, 2), deg."""
        rest = iter(np.round(degrees, 9).tolist())
        features = [
            {
                **{key: value for key, value in feature.items() if key not in _LEFT_OUT},
                "geometry": _mapped(feature.get("geometry"), lambda _: next(rest)),
            }
            for feature in self._features
        ]
        root = {"type": "FeatureCollection", "features": features}
        return json.dumps(root, ensure_ascii=False) + "\n"

    def _read(self) -> list[dict[str, Any]]:
        try:
            root = json.loads(self._path.read_text(encoding="utf-8-sig"))
        except OSError as error:
            raise MapError(f"{self._path}: cannot be read: {error.strerror or error}") from None
        except (ValueError, RecursionError) as error:
            raise MapError(f"{self._path}: not GeoJSON: {error}") from None
        features = root.get("features") if isinstance(root, dict) else None
        if not isinstance(features, list) or not all(isinstance(f, dict) for f in features):
            raise MapError(f"{self._path}: not a GeoJSON FeatureCollection; export one in pixels")
        return features


def _position(coordinates: Any) -> tuple[float, float]:
    column, row = float(coordinates[0]), float(coordinates[1])
    if not (np.isfinite(column) and np.isfinite(row)):
        raise ValueError
    return column, row


def _mapped(geometry: Any, change: Callable[[Any], Any]) -> Any:
    """Return a geometry with each position replaced by what ``change`` returns for it."""
    if geometry is None:
        return None
    if geometry["type"] == "GeometryCollection":
        parts = [_mapped(part, change) for part in geometry["geometries"]]
        return {"type": "GeometryCollection", "geometries": parts}
    return {"type": geometry["type"], "coordinates": _each(geometry["coordinates"], change)}


def _each(coordinates: Any, change: Callable[[Any], Any]) -> Any:
    if coordinates and not isinstance(coordinates[0], list):
        return change(coordinates)
    return [_each(part, change) for part in coordinates]
