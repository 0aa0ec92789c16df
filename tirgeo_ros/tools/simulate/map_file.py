"""Write the park as a map: GeoJSON of bed outlines, paths and hydrants (RFC 7946)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.park import Bed, Park
from tirgeo_ros.tools.simulate.relief import LEVEL, Relief

_DECIMALS = 9  # of a degree: a tenth of a millimetre


def map_text(park: Park, plane: TangentPlane, relief: Relief = LEVEL) -> str:
    """Return the park's map with heights above the ellipsoid."""
    features = [
        *(_feature(bed.name, "bed", "Polygon", _polygon(bed, plane, relief)) for bed in park.beds),
        *(
            _feature(path.name, "path", "LineString", _positions(path.line, plane, relief))
            for path in park.paths
        ),
        *(
            point_feature({"name": point.name, "kind": "hydrant"}, point.center, plane, relief)
            for point in park.hydrants
        ),
    ]
    return collection(features)


def collection(features: Sequence[Mapping[str, object]]) -> str:
    """Return a FeatureCollection, with one feature per line."""
    lines = ",\n".join(json.dumps(feature, ensure_ascii=False) for feature in features)
    return f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n'


def point_feature(
    properties: Mapping[str, object],
    place: Array,
    plane: TangentPlane,
    relief: Relief = LEVEL,
) -> dict[str, object]:
    """Return a Point on the ground at north, east (2,)."""
    geometry = {"type": "Point", "coordinates": _positions(place[None, :], plane, relief)[0]}
    return {"type": "Feature", "properties": dict(properties), "geometry": geometry}


def _feature(name: str, kind: str, geometry: str, coordinates: object) -> dict[str, object]:
    return {
        "type": "Feature",
        "properties": {"name": name, "kind": kind},
        "geometry": {"type": geometry, "coordinates": coordinates},
    }


def _polygon(bed: Bed, plane: TangentPlane, relief: Relief) -> list[list[list[float]]]:
    """Return outer ring counterclockwise and holes clockwise, all closed (RFC 7946, 3.1.6)."""
    rings: Sequence[Array] = (_clockwise(bed.outline)[::-1], *map(_clockwise, bed.holes))
    return [_positions(np.vstack([ring, ring[:1]]), plane, relief) for ring in rings]


def _clockwise(ring: Array) -> Array:
    """Return a ring of north, east (N, 2) in clockwise order seen from above."""
    north, east = ring.T
    twice_area = np.sum(north * np.roll(east, -1) - np.roll(north, -1) * east)
    return ring if twice_area > 0 else ring[::-1]


def _positions(points: Array, plane: TangentPlane, relief: Relief) -> list[list[float]]:
    """Return longitude, latitude (deg), height (m) of ground points (N, 2)."""
    lat, lon, height = plane.geodetic_from_ned(relief.places(points))
    degrees = np.round(np.degrees(np.stack([lon, lat], -1)), _DECIMALS)
    return [
        [x, y, z] for (x, y), z in zip(degrees.tolist(), np.round(height, 4).tolist(), strict=True)
    ]
