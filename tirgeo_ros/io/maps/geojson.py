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
"""Read GeoJSON (RFC 7946, and the ``crs`` member of before) without GDAL, and as GDAL does."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
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
    columns = wanted_columns(wanted, fields, where)
    rows = [{key: row.get(field) for key, field in columns.items()} for row in properties]
    shapes, faults = shapes_of(feature.get("geometry", []) for feature in features)
    return Table(where, name, _system(root), shapes, rows, fields, faults)


def _root(path: Path) -> Any:
    """Return the document; None if it is a sequence of documents."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        return None if text.startswith("\x1e") else json.loads(text, object_hook=_with_parts)
    except json.JSONDecodeError as error:
        if error.msg != "Extra data":
            raise
        return None


def _with_parts(members: dict[str, Any]) -> dict[str, Any]:
    """Replace a feature's geometry by its parts, which take a tenth of the memory."""
    if members.get("type") == "Feature":
        members["geometry"] = _parts(members.get("geometry"))
    return members


def _features(root: dict[str, Any]) -> list[dict[str, Any]]:
    if root["type"] == "FeatureCollection":
        features = root.get("features") or []
        return [f for f in features if isinstance(f, dict) and f.get("type") == "Feature"]
    return [root if root["type"] == "Feature" else {"geometry": _parts(root)}]


def _properties(feature: dict[str, Any]) -> dict[str, Any]:
    """Return a feature's properties; its id, if that is a text, is one of them."""
    own = feature.get("properties")
    identity = feature.get("id")
    first = {"id": identity} if isinstance(identity, str) else {}
    return first | own if isinstance(own, dict) else first


def _system(root: dict[str, Any]) -> str | None:
    """Return the coordinate system that the file names, WGS84 without one; None: not known."""
    if root.get("crs") is None:
        return "EPSG:4326"
    try:
        named = root["crs"]["properties"]
        return str(named.get("name") or f"EPSG:{named['code']}")
    except _WRONG:
        return None


def _parts(geometry: Any) -> list[Part]:
    """Return points, lines and rings of a geometry; none if it is not valid."""
    try:
        if geometry["type"] == "GeometryCollection":
            return list(chain.from_iterable(map(_parts, geometry["geometries"])))
        kind, lines = _LINES[geometry["type"]]
        return [(kind, _positions(line)) for line in lines(geometry["coordinates"]) if line]
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
