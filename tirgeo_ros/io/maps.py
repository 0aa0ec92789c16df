"""Vector maps from files: GeoJSON (RFC 7946), and with the older ``crs`` member in any system.

A third coordinate is taken as the height above the WGS84 ellipsoid in metres, except in a system
that says its heights are others: those are left out.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from tirgeo_ros.core.errors import MapError
from tirgeo_ros.core.map_layers import GeoFeature
from tirgeo_ros.core.polylines import IntArray
from tirgeo_ros.core.samples import Array

#: Geometries of positions, with the fewest that each point, line or ring of them has.
_KINDS = {
    "Point": 1,
    "MultiPoint": 1,
    "LineString": 2,
    "MultiLineString": 2,
    "Polygon": 3,
    "MultiPolygon": 3,
}


@dataclass(frozen=True, slots=True)
class _Part:
    """A point, a line or a ring of the file."""

    feature: int  # counted from 0, in the order of the file
    label: str
    closed: bool
    points: Array  # (N, 3) x, y, z as in the file, z nan where there is none


def load_map(path: str | Path, label_field: str = "name") -> list[GeoFeature]:
    """The features of a GeoJSON map; ``label_field`` is the property that labels them.

    Raises MapError, naming the file, if it is absent, is not GeoJSON, names an unknown
    coordinate reference system, has coordinates that are none, or nothing to draw.
    """
    root = _read(Path(path))
    parts = [
        part
        for number, feature in enumerate(_features(root, path))
        for part in _parts(feature, number, label_field, path)
    ]
    if not parts:
        raise MapError(f"{path}: the map has no feature with a geometry")
    points = _in_wgs84(np.concatenate([part.points for part in parts]), root, path)
    ends = list(itertools.accumulate((len(part.points) for part in parts), initial=0))
    number_of = np.repeat([part.feature for part in parts], np.diff(ends))
    _check_range(points, number_of, path)
    points[:, :2] = np.radians(points[:, 1::-1])
    return [
        GeoFeature(part.label, part.closed, points[a:b], part.feature)
        for part, (a, b) in zip(parts, itertools.pairwise(ends), strict=True)
    ]


def _read(path: Path) -> dict[str, Any]:
    try:
        root = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise MapError(f"{path}: there is no such map; check its name") from None
    except OSError as error:
        raise MapError(f"{path}: the map cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise MapError(f"{path}: not JSON ({error}); a map is a GeoJSON file") from None
    known = ["FeatureCollection", "Feature", "GeometryCollection", *_KINDS]
    if not isinstance(root, dict) or root.get("type") not in known:
        raise MapError(f"{path}: JSON, but not GeoJSON: its type is none of GeoJSON's")
    return root


def _features(root: dict[str, Any], path: str | Path) -> list[Any]:
    """The features, or the one that a lone feature or geometry makes."""
    if root["type"] == "FeatureCollection":
        features = root.get("features")
        if not isinstance(features, list):
            raise MapError(f"{path}: the FeatureCollection has no list of features")
        return features
    return [root if root["type"] == "Feature" else {"type": "Feature", "geometry": root}]


def _parts(feature: Any, number: int, label_field: str, path: str | Path) -> Iterator[_Part]:
    where = f"{path}: feature {number + 1}"
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        raise MapError(f"{where} is not a GeoJSON Feature")
    properties = feature.get("properties")
    value = properties.get(label_field) if isinstance(properties, dict) else None
    label = "" if value is None else str(value).strip()
    for kind, positions in _pieces(feature.get("geometry"), where):
        points = _points(positions, where)
        if len(points) < _KINDS[kind]:
            raise MapError(f"{where}: a {kind} of {len(points)} positions is none")
        yield _Part(number, label, kind.endswith("Polygon"), points)


def _pieces(geometry: Any, where: str) -> Iterator[tuple[str, list[Any]]]:
    """The type and the positions of each point, line and ring of a geometry."""
    waiting = [] if geometry is None else [geometry]
    while waiting:
        geometry = waiting.pop(0)
        kind = geometry.get("type") if isinstance(geometry, dict) else None
        if kind == "GeometryCollection":
            waiting = [*_list(geometry.get("geometries"), where), *waiting]
        elif isinstance(kind, str) and kind in _KINDS:
            lists = _lists(kind, _list(geometry.get("coordinates"), where), where)
            yield from ((kind, positions) for positions in lists if positions)
        else:
            raise MapError(f"{where}: its geometry is none of GeoJSON's")


def _lists(kind: str, coordinates: list[Any], where: str) -> list[list[Any]]:
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


def _points(positions: list[Any], where: str) -> Array:
    """Positions as (N, 3), z nan where there is none."""
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


def _in_wgs84(points: Array, root: dict[str, Any], path: str | Path) -> Array:
    """Points (N, 3) as longitude, latitude (deg), height (m)."""
    name = _crs_name(root, path)
    if name is None:
        return points
    system = _system(name)
    if system is None:
        raise MapError(
            f"{path}: unknown coordinate reference system {name!r}; save the map in WGS84 "
            "(EPSG:4326)"
        )
    if system.is_compound:
        points[:, 2] = np.nan  # heights above the sea, not above the ellipsoid
    # x before y, as GeoJSON has always had it, whatever the system's own order.
    flat = pyproj.Transformer.from_crs(system.to_2d(), "EPSG:4326", always_xy=True)
    points[:, 0], points[:, 1] = flat.transform(points[:, 0], points[:, 1])
    return points


def _system(name: str) -> pyproj.CRS | None:
    """The system of a name, None if it is unknown or has no horizontal coordinates."""
    try:
        system = pyproj.CRS.from_user_input(name)
    except pyproj.exceptions.CRSError:
        return None
    return system if system.is_geographic or system.is_projected else None


def _crs_name(root: dict[str, Any], path: str | Path) -> str | None:
    """The name in the ``crs`` member of GeoJSON before RFC 7946; None where there is none."""
    crs = root.get("crs")
    if crs is None:
        return None
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise MapError(
            f"{path}: the crs member does not name a coordinate reference system; save the map in "
            "WGS84 (EPSG:4326)"
        )
    return name


def _check_range(points: Array, feature: IntArray, path: str | Path) -> None:
    right = (np.abs(points[:, 0]) <= 180) & (np.abs(points[:, 1]) <= 90)
    if not right.all():
        first = int(np.argmin(right))
        x, y = points[first, :2]
        raise MapError(
            f"{path}: feature {feature[first] + 1}: ({x:.6g}, {y:.6g}) is not a longitude and a "
            "latitude; save the map in WGS84 (EPSG:4326) or name its system in a crs member"
        )
