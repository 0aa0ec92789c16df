"""Read GeoJSON (RFC 7946, and the ``crs`` member of before) without GDAL, and as GDAL does."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.io.maps.style_sheet import Wanted
from tirgeo_ros.io.maps.tables import Part, Table, check_number, shapes_of, wanted_columns

_SUFFIXES = (".geojson", ".json")
#: Geometry -> the type of its parts, and their lists of positions.
_LINES: dict[str, tuple[str, Callable[[Any], Iterable[Any]]]] = {
    "Point": ("Point", lambda nested: [[nested]] if nested else []),
    "MultiPoint": ("Point", lambda nested: [[each] for each in nested]),
    "LineString": ("LineString", lambda nested: [nested]),
    "MultiLineString": ("LineString", iter),
    "Polygon": ("Polygon", iter),
    "MultiPolygon": ("Polygon", chain.from_iterable),
}
_ROOTS = ("FeatureCollection", "Feature", "GeometryCollection", *_LINES)
#: What members of a wrong type raise.
_WRONG = (AttributeError, KeyError, TypeError, ValueError, OverflowError)


def geojson_table(path: Path, wanted: Wanted) -> Table | None:
    """Return the layer of a GeoJSON file with the properties that are ``wanted``.

    Returns None for another format, also in JSON (a feature a line, TopoJSON). Raises OSError or
    ValueError if it cannot be read.
    """
    root = _root(path) if path.suffix.lower() in _SUFFIXES else None
    if not isinstance(root, dict) or root.get("type") not in _ROOTS:
        return None
    name = root["name"] if isinstance(root.get("name"), str) else path.stem
    where = f"{path}: layer {name}"
    features = _features(root)
    check_number(where, len(features))
    properties = [_properties(feature) for feature in features]
    fields = list(dict.fromkeys(chain.from_iterable(properties)))
    columns = {
        key: _column([row.get(field) for row in properties])
        for key, field in wanted_columns(wanted, fields, where).items()
    }
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    shapes, faults = shapes_of(feature.get("geometry", []) for feature in features)
    rows = rows or [{}] * len(features)
    return Table(where, name, _system(root), shapes, rows, fields, faults)


def _root(path: Path) -> Any:
    """Return the document; None if it is a sequence of documents."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        return None if text.startswith("\x1e") else json.loads(text, object_hook=_shortened)
    except json.JSONDecodeError as error:
        if error.msg != "Extra data":
            raise
        return None


def _shortened(members: dict[str, Any]) -> dict[str, Any]:
    """Replace coordinates, and a feature's geometry, by their parts, which take less memory."""
    if "geometry" in members:
        members["geometry"] = _parts(members["geometry"])
    if "coordinates" in members:
        kind, lines = _LINES.get(str(members.get("type")), ("", iter))
        try:
            parts = [(kind, _positions(line)) for line in lines(members["coordinates"]) if line]
        except _WRONG:
            parts = []
        members["coordinates"] = parts if kind else []
    return members


def _features(root: dict[str, Any]) -> Sequence[dict[str, Any]]:
    if root["type"] == "FeatureCollection":
        features = root.get("features")
        return [each if isinstance(each, dict) else {} for each in features or ()]
    return [root if root["type"] == "Feature" else {"geometry": _parts(root)}]


def _properties(feature: dict[str, Any]) -> dict[str, Any]:
    """Return a feature's properties; its id, if that is a text, is one of them."""
    own = feature.get("properties")
    identity = feature.get("id")
    first = {"id": identity} if isinstance(identity, str) else {}
    return first | own if isinstance(own, dict) else first


def _column(values: list[Any]) -> list[Any]:
    """Return a property of all features; values of several kinds become texts, lists JSON."""
    kinds = {type(value) for value in values} - {type(None)}
    if kinds <= {str} or kinds <= {bool} or kinds <= {int, float}:
        return values
    return [v if v is None or isinstance(v, str) else json.dumps(v, default=str) for v in values]


def _system(root: dict[str, Any]) -> str | None:
    """Return the coordinate system that the file names, WGS84 without one; None: not known."""
    if "crs" not in root:
        return "EPSG:4326"
    try:
        named = root["crs"]["properties"]
        return str(named["name"] if "name" in named else f"EPSG:{named['code']}")
    except _WRONG:
        return None


def _parts(geometry: Any) -> list[Part]:
    """Return points, lines and rings of a geometry; none if it is not valid."""
    try:
        if geometry["type"] == "GeometryCollection":
            return list(chain.from_iterable(map(_parts, geometry["geometries"])))
        return list(geometry["coordinates"])
    except _WRONG:
        return []


def _positions(line: list[list[float]]) -> Any:
    """Return positions (n, 2) or (n, 3); raise ValueError for values that are no numbers."""
    if not {*map(type, chain.from_iterable(line))} <= {int, float} or min(map(len, line)) < 2:
        raise ValueError
    widths = {*map(len, line)}
    if widths <= {2} or widths <= {3}:
        return np.array(line, float)
    return np.array([[*position, np.nan][:3] for position in line], float)
