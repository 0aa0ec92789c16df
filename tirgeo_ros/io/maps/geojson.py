"""GeoJSON (RFC 7946), also a feature a line, and with the older ``crs`` member in any system.

A third coordinate is the height above the WGS84 ellipsoid in metres.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.errors import MapError
from tirgeo_ros.core.samples import Array
from tirgeo_ros.io.maps.table import (
    FEWEST,
    Shapes,
    Table,
    check_count,
    check_layer,
    check_size,
    starts_of,
)

_KINDS = ("Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon")
_ROOTS = ("FeatureCollection", "Feature", "GeometryCollection", *_KINDS)
_RECORD_SEPARATOR = "\x1e"  # before each text of a JSON sequence (RFC 8142)

Positions = list[Any]


def read_geojson(path: Path, content: bytes, layer: str) -> list[Table]:
    """The one table of a GeoJSON file, named as its ``name`` member or else as the file.

    Raises MapError, naming the file, if it is no GeoJSON or has coordinates that are none.
    """
    root = _root(path, content)
    name = root.get("name")
    name = name if isinstance(name, str) and name else path.stem
    check_layer(path, layer, {name, path.stem})
    features = _features(root, path)
    check_count(len(features), str(path))
    properties = [_properties(feature) for feature in features]
    shapes = _shapes(features, str(path))
    fields = dict.fromkeys(chain.from_iterable(properties))
    return [Table(str(path), name, _crs_name(root), shapes, properties, fields)]


def _root(path: Path, content: bytes) -> dict[str, Any]:
    try:
        root = json.loads(content)
    except (ValueError, RecursionError) as error:
        root = _sequence(content)
        if root is None:
            raise MapError(f"{path}: not JSON ({error}); a map is a GeoJSON file") from None
    if not isinstance(root, dict) or root.get("type") not in _ROOTS:
        raise MapError(f"{path}: JSON, but not GeoJSON: its type is none of GeoJSON's")
    return root


def _sequence(content: bytes) -> dict[str, Any] | None:
    """The collection of a file with a feature on each line; None if it is no such file."""
    try:
        lines = content.decode("utf-8-sig").replace(_RECORD_SEPARATOR, "\n").splitlines()
        roots = [json.loads(line) for line in lines if line.strip()]
    except (ValueError, RecursionError):
        return None
    if len(roots) < 2 or not all(isinstance(root, dict) for root in roots):
        return None
    features = [root if root.get("type") == "Feature" else _wrapped(root) for root in roots]
    return {"type": "FeatureCollection", "features": features}


def _wrapped(geometry: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry}


def _features(root: dict[str, Any], path: Path) -> list[Any]:
    """The features, or the one that a lone feature or geometry makes."""
    if root["type"] == "FeatureCollection":
        features = root.get("features")
        if not isinstance(features, list):
            raise MapError(f"{path}: the FeatureCollection has no list of features")
        return features
    return [root if root["type"] == "Feature" else _wrapped(root)]


def _properties(feature: Any) -> dict[str, Any]:
    properties = feature.get("properties") if isinstance(feature, dict) else None
    return properties if isinstance(properties, dict) else {}


def _shapes(features: list[Any], path: str) -> Shapes:
    parts: list[Positions] = []
    owner: list[int] = []
    closed: list[bool] = []
    for number, feature in enumerate(features):
        where = f"{path}: feature {number + 1}"
        for kind, positions in _pieces(_geometry(feature, where), where):
            parts.append(positions)
            owner.append(number)
            closed.append(kind == "Polygon")
            if len(positions) < FEWEST[kind]:
                check_size(len(_points(positions, where)), kind, where)
    points = _fast_points(parts)
    if points is None:
        points = _slow_points(parts, owner, path)
    return Shapes(points, starts_of(map(len, parts)), np.array(owner, int), np.array(closed, bool))


def _geometry(feature: Any, where: str) -> Any:
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        raise MapError(f"{where} is not a GeoJSON Feature")
    return feature.get("geometry")


def _pieces(geometry: Any, where: str) -> Iterator[tuple[str, Positions]]:
    """The kind (Point, LineString, Polygon) and the positions of each part of a geometry."""
    waiting = [] if geometry is None else [geometry]
    while waiting:
        geometry = waiting.pop()
        kind = geometry.get("type") if isinstance(geometry, dict) else None
        if kind == "GeometryCollection":
            waiting.extend(reversed(_list(geometry.get("geometries"), where)))
        elif isinstance(kind, str) and kind in _KINDS:
            lists = _lists(kind, _list(geometry.get("coordinates"), where), where)
            single = kind.removeprefix("Multi")
            yield from ((single, positions) for positions in lists if positions)
        else:
            raise MapError(f"{where}: its geometry is none of GeoJSON's")


def _lists(kind: str, coordinates: Positions, where: str) -> list[Positions]:
    """The lists of positions of one geometry: a list for each point, line and ring."""
    if kind in {"Point", "LineString"}:
        return [[coordinates] if kind == "Point" and coordinates else coordinates]
    if kind == "MultiPoint":
        return [[position] for position in coordinates]
    if kind == "MultiPolygon":
        coordinates = [ring for polygon in coordinates for ring in _list(polygon, where)]
    return [_list(line, where) for line in coordinates]


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise MapError(f"{where}: its coordinates are not nested as GeoJSON wants them")
    return value


def _fast_points(parts: list[Positions]) -> Array | None:
    """All positions at once as (N, 3), z nan where there is none; None if one is not plain.

    Plain: finite numbers, as many in each.
    """
    positions = list(chain.from_iterable(parts))
    if set(map(type, positions)) - {list}:
        return None
    sizes = set(map(len, positions))
    values = list(chain.from_iterable(positions))
    if len(sizes) != 1 or min(sizes) < 2 or set(map(type, values)) - {float, int}:
        return None
    try:
        table = np.array(values, float).reshape(len(positions), -1)[:, :3]
    except OverflowError:
        return None
    points = np.full((len(table), 3), np.nan)
    points[:, : table.shape[1]] = table
    return points if np.isfinite(table).all() else None


def _slow_points(parts: list[Positions], owner: list[int], path: str) -> Array:
    """The same of any positions, one by one; MapError naming the feature of one that is none."""
    rows = [np.empty((0, 3))]
    for positions, number in zip(parts, owner, strict=True):
        plain = _fast_points([positions])
        rows.append(
            _points(positions, f"{path}: feature {number + 1}") if plain is None else plain
        )
    return np.concatenate(rows)


def _points(positions: Positions, where: str) -> Array:
    points = np.full((len(positions), 3), np.nan)
    for row, position in zip(points, positions, strict=True):
        numbers = _numbers(position, where)
        if not all(map(math.isfinite, numbers)):
            raise MapError(f"{where}: {str(position)[:60]} is not finite")
        row[: len(numbers)] = numbers
    return points


def _numbers(position: Any, where: str) -> list[float]:
    """The first two or three numbers of a position."""
    right = isinstance(position, list) and len(position) >= 2 and all(map(_is_number, position))
    if not right:
        raise MapError(f"{where}: {str(position)[:60]} is not a position of two or three numbers")
    try:
        return [float(value) for value in position[:3]]
    except OverflowError:
        return [math.inf]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _crs_name(root: dict[str, Any]) -> str | None:
    """The name in the ``crs`` member of GeoJSON before RFC 7946; None where there is none.

    Of a member without a name it is the member itself: no system is called that.
    """
    crs = root.get("crs")
    if crs is None:
        return None
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    return name if isinstance(name, str) else f"crs member {json.dumps(crs)}"
