"""Find how far away and in which direction a map lies, and guess why it is far away."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M, ecef_from_geodetic
from tirgeo_ros.core.map.level_of_detail import Boxes
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.types.arrays import Array

#: A map farther away than this does not belong to the flight.
ELSEWHERE_M = 20_000.0

_RUN = 64  # points in a box
_CANDIDATES = 16  # boxes to search: the nearest box may not have the nearest feature
_HINT_M = 50_000.0  # a guessed mistake is likely if undoing it brings the map this near
_ZONE_DEG = 6.0  # width of a UTM zone
_WORDS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"]


class Nearest(NamedTuple):
    """Hold the nearest point of a map's features."""

    distance_m: float  # horizontal, over the ground
    azimuth_rad: float  # 0 is north, clockwise
    point_n: Array  # (3,) in the map's plane, m


class NearestFeature:
    """Find the nearest point of one map, with the help of boxes around its parts."""

    def __init__(self, vector_map: VectorMap, first_n: Array | None = None) -> None:
        """Prepare the boxes; ``first_n`` (3,) is used if no part of the map has a place."""
        self._first = [] if first_n is None else [first_n[:, None]]
        self._details = vector_map.details
        self._marks = vector_map.marks.points
        starts = np.append(np.arange(0, self._marks.shape[1], _RUN), self._marks.shape[1])
        self._mark_boxes = Boxes.around(self._marks, self._marks, starts)

    def nearest(self, position_n: Array) -> Nearest | None:
        """Return the point nearest to a position (3,), NED, m; None if the map has no place."""
        details, points = self._details, []
        for piece in _nearest_of(details.boxes, position_n):
            first = details.first[0, piece]
            vertices = details.points[:, first : first + details.count[0, piece]]
            points.append(_on_segments(vertices, position_n))
        runs = _nearest_of(self._mark_boxes, position_n)
        points += [self._marks[:, _RUN * run : _RUN * (run + 1)] for run in runs]
        points = points or self._first
        if not points:
            return None
        found = np.concatenate(points, axis=1)
        away = found - position_n[:, None]
        point = found[:, np.argmin((away[:2] ** 2).sum(axis=0))]
        north, east, _ = (point - position_n).tolist()
        return Nearest(_over_ground(point - position_n), math.atan2(east, north), point)


def _nearest_of(boxes: Boxes, position_n: Array) -> list[int]:
    if not boxes.bounds.shape[1]:
        return []
    return [int(i) for i in np.argsort(boxes.distance(position_n))[:_CANDIDATES]]


def _on_segments(vertices: Array, position_n: Array) -> Array:
    """Return the horizontally nearest point (3, N) on each segment of a line (3, N + 1)."""
    start, along = vertices[:, :-1], np.diff(vertices, axis=1)
    squared = (along[:2] ** 2).sum(axis=0) + 1e-9
    to_place = position_n[:2, None] - start[:2]
    share = np.clip((along[:2] * to_place).sum(axis=0) / squared, 0.0, 1.0)
    return np.asarray(start + share * along)


def _over_ground(away_n: Array) -> float:
    """Return the distance (m) over a spherical Earth; near by, the horizontal distance.

    Near by, differences of height do not count.
    """
    level, chord = math.hypot(away_n[0], away_n[1]), float(np.linalg.norm(away_n))
    if level < ELSEWHERE_M and chord < 2 * ELSEWHERE_M:
        return level
    return 2 * SEMI_MAJOR_AXIS_M * math.asin(min(chord / (2 * SEMI_MAJOR_AXIS_M), 1.0))


def compass_word(azimuth_rad: float) -> str:
    """Return the name of the nearest of eight directions, such as ``north-east``."""
    return _WORDS[round(azimuth_rad / (math.pi / 4)) % 8]


def distance_words(distance_m: float) -> str:
    """Return a distance to two digits as text: ``300 m``, ``1.2 km``."""
    rounded = float(f"{distance_m:.2g}")
    return f"{rounded:g} m" if rounded < 1000 else f"{rounded / 1000:g} km"


def way_words(distance_m: float, azimuth_rad: float) -> str:
    """Return distance and direction as text: ``300 m away to the north-east``."""
    return f"{distance_words(distance_m)} away to the {compass_word(azimuth_rad)}"


def likely_mistake(plane: TangentPlane, place_n: Array) -> str:
    """Return a question about why a map's point (3,) is far from the plane's origin, or "".

    The usual mistakes are undone in turn. The question names the first one whose correction brings
    the point within 50 km. A point within 50 km of latitude and longitude 0 suggests local metres.
    """
    latitude, longitude, _ = (float(each) for each in plane.geodetic_from_ned(place_n))
    origin = plane.latitude_rad, plane.longitude_rad
    if _apart_m(origin, (longitude, latitude)) < _HINT_M:
        return "are latitude and longitude swapped?"
    for latitude_sign, longitude_sign, name in (
        (1, -1, "longitude"),
        (-1, 1, "latitude"),
        (-1, -1, "latitude and longitude"),
    ):
        if _apart_m(origin, (latitude_sign * latitude, longitude_sign * longitude)) < _HINT_M:
            return f"is the sign of {name} wrong?"
    zones = round(math.degrees(origin[1] - longitude) / _ZONE_DEG)
    moved = latitude, longitude + math.radians(zones * _ZONE_DEG)
    if zones and _apart_m(origin, moved) < _HINT_M:
        zone = int(math.floor(math.degrees(longitude) / _ZONE_DEG) + 30) % 60 + 1
        return f"is it UTM zone {(zone + zones - 1) % 60 + 1} instead of {zone}?"
    if _apart_m((0.0, 0.0), (latitude, longitude)) < _HINT_M:
        return "are its coordinates metres of a local system?"
    return ""


def _apart_m(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the chord (m) between two places, latitude and longitude (rad).

    Infinite if the latitude of ``other`` is impossible.
    """
    if abs(other[0]) > math.pi / 2:
        return math.inf
    apart = ecef_from_geodetic(*one, 0.0) - ecef_from_geodetic(*other, 0.0)
    return float(np.linalg.norm(apart))
