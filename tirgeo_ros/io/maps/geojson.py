"""Read GeoJSON (RFC 7946), also with a feature on each line or with the older ``crs`` member.

With a ``crs`` member it may be in any system. A third coordinate is the height above the WGS84
ellipsoid in metres.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps.feature_faults import Faults, FeatureError
from tirgeo_ros.io.maps.style_condition import Wanted
from tirgeo_ros.io.maps.table import (
    FEWEST,
    Part,
    ShapeBuilder,
    Shapes,
    Table,
    check_count,
    check_layer,
    empty_map,
    starts_of,
)

_KINDS = ("Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon")
_ROOTS = ("FeatureCollection", "Feature", "GeometryCollection", *_KINDS)
_EMPTY = "it is an empty FeatureCollection; save it again with the layer in it"
_RECORD_SEPARATOR = "\x1e"  # before each text of a JSON sequence (RFC 8142)

Positions = list[Any]


def read_geojson(path: Path, layer: str, _wanted: Wanted) -> list[Table]:
    """Return the only table of a GeoJSON file, named by its ``name`` member or else as the file.

    Raises MapError, naming the file, if it is no GeoJSON.
    """
    root = _root(path, path.read_bytes())
    name = root.get("name")
    name = name if isinstance(name, str) and name else path.stem
    check_layer(path, layer, {name, path.stem})
    features = _features(root, path)
    check_count(len(features), str(path))
    properties = [_properties(feature) for feature in features]
    shapes, faults = _shapes(features)
    fields = dict.fromkeys(chain.from_iterable(properties))
    table = Table(str(path), name, _crs_name(root), shapes, properties, fields, faults=faults)
    return [table if features else replace(table, empty=empty_map(path, _EMPTY))]


def _root(path: Path, content: bytes) -> dict[str, Any]:
    try:
        root = json.loads(content)
    except (ValueError, RecursionError) as error:
        root = _sequence(content)
        if root is None:
            raise MapError(
                f"{path}: not JSON ({error}); a map is a GeoJSON file, without "
                "comments and without a comma before a bracket that closes"
            ) from None
    if not isinstance(root, dict) or root.get("type") not in _ROOTS:
        raise MapError(f"{path}: JSON, but not GeoJSON: its type is none of GeoJSON's")
    return root


def _sequence(content: bytes) -> dict[str, Any] | None:
    """Return the collection of a file with a feature on each line; None if it is no such file."""
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
    """Return the features, or a list of the only one if the root is a feature or a geometry."""
    if root["type"] == "FeatureCollection":
        features = root.get("features")
        if not isinstance(features, list):
            raise MapError(f"{path}: the FeatureCollection has no list of features")
        return features
    return [root if root["type"] == "Feature" else _wrapped(root)]


def _properties(feature: Any) -> dict[str, Any]:
    """Return the feature's properties; its id, if it has one, is added to them."""
    if not isinstance(feature, dict):
        return {}
    properties = feature.get("properties")
    found = properties if isinstance(properties, dict) else {}
    return {"id": feature["id"], **found} if "id" in feature else found


def _shapes(features: list[Any]) -> tuple[Shapes, Faults]:
    """Return all shapes in one array step if nothing is wrong, as in most maps; else by parts."""
    parts: list[Positions] = []
    owner: list[int] = []
    closed: list[bool] = []
    whole = True
    try:
        for number, feature in enumerate(features):
            for kind, positions in _pieces(_geometry(feature)):
                parts.append(positions)
                owner.append(number)
                closed.append(kind == "Polygon")
                whole = whole and len(positions) >= FEWEST[kind]
    except FeatureError:
        whole = False
    points = _fast_points(parts) if whole else None
    if points is None:
        return _slow_shapes(features)
    starts = starts_of(map(len, parts))
    return Shapes(points, starts, np.array(owner, int), np.array(closed, bool)), Faults()


def _slow_shapes(features: list[Any]) -> tuple[Shapes, Faults]:
    def parts(feature: Any) -> Iterator[Part]:
        for kind, positions in _pieces(_geometry(feature)):
            points = _fast_points([positions])
            yield kind, _points(positions) if points is None else points

    shapes = ShapeBuilder()
    for number, feature in enumerate(features):
        shapes.take(number, parts(feature))
    return shapes.shapes(), shapes.faults


def _geometry(feature: Any) -> Any:
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        raise FeatureError("it is not a GeoJSON Feature")
    return feature.get("geometry")


def _pieces(geometry: Any) -> Iterator[tuple[str, Positions]]:
    """Yield the kind (Point, LineString, Polygon) and the positions of each part of a geometry."""
    waiting = [] if geometry is None else [geometry]
    while waiting:
        geometry = waiting.pop()
        kind = geometry.get("type") if isinstance(geometry, dict) else None
        if kind == "GeometryCollection":
            waiting.extend(reversed(_list(geometry.get("geometries"))))
        elif isinstance(kind, str) and kind in _KINDS:
            lists = _lists(kind, _list(geometry.get("coordinates")))
            single = kind.removeprefix("Multi")
            yield from ((single, each) for each in lists if each or single == "Polygon")
        else:
            raise FeatureError("its geometry is none of GeoJSON's")


def _lists(kind: str, coordinates: Positions) -> list[Positions]:
    """Return the lists of positions of one geometry: one for each point, line and ring."""
    if kind in {"Point", "LineString"}:
        return [[coordinates] if kind == "Point" and coordinates else coordinates]
    if kind == "MultiPoint":
        return [[position] for position in coordinates]
    if kind == "MultiPolygon":
        coordinates = [ring for polygon in coordinates for ring in _list(polygon)]
    return [_list(line) for line in coordinates]


def _list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise FeatureError("its coordinates are not nested as GeoJSON wants them")
    return value


def _fast_points(parts: list[Positions]) -> Array | None:
    """Return all positions at once as (N, 3), z nan where there is none; None if not plain.

    Plain: every position is a list of finite numbers, equally many in each.
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


def _points(positions: Positions) -> Array:
    """Return positions one by one; raise FeatureError for one that is none, or not finite."""
    points = np.full((len(positions), 3), np.nan)
    for row, position in zip(points, positions, strict=True):
        shown = str(position)[:60]
        if (
            not isinstance(position, list)
            or len(position) < 2
            or set(map(type, position)) - {int, float}
        ):
            raise FeatureError(f"{shown} is not a position of two or three numbers")
        try:
            row[: len(position)] = position[:3]
        except OverflowError:
            row[0] = math.inf
        if not np.isfinite(row[: len(position)]).all():
            raise FeatureError(f"{shown} is not finite")
    return points


def _crs_name(root: dict[str, Any]) -> str | None:
    """Return the name in the ``crs`` member of GeoJSON before RFC 7946; None if there is none.

    For a member without a name, return the member as text, which is no system's name.
    """
    crs = root.get("crs")
    if crs is None:
        return None
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    return name if isinstance(name, str) else f"crs member {json.dumps(crs)}"
