"""Write the park as a map: GeoJSON of bed outlines, paths and hydrants (RFC 7946)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.park import Park
from tirgeo_ros.tools.simulate.relief import LEVEL, Relief

_DECIMALS = 9  # of a degree: a tenth of a millimetre


def map_text(park: Park, plane: TangentPlane, relief: Relief = LEVEL) -> str:
    """Return the park's map with heights above the ellipsoid."""
    features = []
    for bed in park.beds:
        # RFC 7946, 3.1.6: outer ring counterclockwise and holes clockwise, all closed
        rings = [_clockwise(bed.outline)[::-1], *map(_clockwise, bed.holes)]
        closed = [_positions(np.vstack([ring, ring[:1]]), plane, relief) for ring in rings]
        features.append(_feature({"name": bed.name, "kind": "bed"}, "Polygon", closed))
    for path in park.paths:
        line = _positions(path.line, plane, relief)
        features.append(_feature({"name": path.name, "kind": "path"}, "LineString", line))
    for one in park.hydrants:
        properties = {"name": one.name, "kind": "hydrant"}
        features.append(point_feature(properties, one.center, plane, relief))
    return collection(features)


def collection(features: Sequence[Mapping[str, object]]) -> str:
    """Return a FeatureCollection, with one feature per line."""
    lines = ",\n".join(json.dumps(feature, ensure_ascii=False) for feature in features)
    return f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n'


def point_feature(
    properties: Mapping[str, object], place: Array, plane: TangentPlane, relief: Relief
) -> dict[str, object]:
    """Return a Point on the ground at north, east (2,)."""
    return _feature(properties, "Point", _positions(place[None, :], plane, relief)[0])


def _feature(
    properties: Mapping[str, object], kind: str, coordinates: object
) -> dict[str, object]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": dict(properties), "geometry": geometry}


def _clockwise(ring: Array) -> Array:
    """Return a ring of north, east (N, 2) in clockwise order seen from above."""
    north, east = ring.T
    twice_area = np.sum(north * np.roll(east, -1) - np.roll(north, -1) * east)
    return ring if twice_area > 0 else ring[::-1]


def _positions(points: Array, plane: TangentPlane, relief: Relief) -> list[list[float]]:
    """Return longitude, latitude (deg), height (m) of ground points (N, 2)."""
    lat, lon, height = plane.geodetic_from_ned(relief.places(points))
    degrees = np.round(np.degrees(np.stack([lon, lat], -1)), _DECIMALS)
    positions: list[list[float]] = np.column_stack([degrees, np.round(height, 4)]).tolist()
    return positions
