"""Find how far away and in which direction a map lies, and say why no part of it is in view."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import azimuth, matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M, ecef_from_geodetic
from tirgeo_ros.core.ground.frame_geometry import camera_heading_rad
from tirgeo_ros.core.map.vector_map import VectorMap
from tirgeo_ros.core.map.visibility import HORIZON_ROWS
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

#: A map farther away than this does not belong to the flight.
ELSEWHERE_M = 20_000.0

_CANDIDATES = 16  # pieces of lines to search: the nearest box may not have the nearest line
_HINT_M = 50_000.0  # a guessed mistake is likely if undoing it brings the map this near
_ZONE_DEG = 6.0  # width of a UTM zone
_MOVED_M, _MOVED_PART = 1.0, 0.05  # of the distance to the map: then it is searched again
_GRID = 5  # pixels along each side of the picture, to look for the horizon
_WORDS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"]


class Nearest(NamedTuple):
    """Hold the nearest point of a map's features."""

    distance_m: float  # horizontal, over the ground
    azimuth_rad: float  # 0 is north, clockwise
    point_n: Array  # (3,) in the map's plane, m


def nearest_feature(
    vector_map: VectorMap, position_n: Array, first_n: Array | None = None
) -> Nearest | None:
    """Return the map's point nearest to a position (3,), NED, m.

    ``first_n`` (3,) is used if no part of the map has a place; None without it.
    """
    details, points = vector_map.details, [vector_map.marks.points]
    for piece in np.argsort(details.boxes.distance(position_n))[:_CANDIDATES].tolist():
        first = details.first[0, piece]
        vertices = details.points[:, first : first + details.count[0, piece]]
        # The horizontally nearest point on each segment.
        start, along = vertices[:, :-1], np.diff(vertices, axis=1)
        way = (along[:2] * (position_n[:2, None] - start[:2])).sum(axis=0)
        share = np.clip(way / ((along[:2] ** 2).sum(axis=0) + 1e-9), 0.0, 1.0)
        points.append(start + share * along)
    candidates = np.concatenate(points, axis=1)
    if not candidates.size:
        if first_n is None:
            return None
        candidates = first_n[:, None]
    away = candidates - position_n[:, None]
    away_n = away[:, np.argmin((away[:2] ** 2).sum(axis=0))]
    level_m, chord_m = math.hypot(away_n[0], away_n[1]), float(np.linalg.norm(away_n))
    if level_m >= ELSEWHERE_M or chord_m >= 2 * ELSEWHERE_M:  # over a spherical Earth
        half = min(chord_m / (2 * SEMI_MAJOR_AXIS_M), 1.0)
        level_m = 2 * SEMI_MAJOR_AXIS_M * math.asin(half)
    return Nearest(level_m, azimuth(away_n), position_n + away_n)


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
    zones = round(math.degrees(origin[1] - longitude) / _ZONE_DEG)
    zone = int(math.floor(math.degrees(longitude) / _ZONE_DEG) + 30) % 60 + 1
    wrong_sign = "is the sign of {} wrong?".format
    corrections = (
        ((longitude, latitude), "are latitude and longitude swapped?"),
        ((latitude, -longitude), wrong_sign("longitude")),
        ((-latitude, longitude), wrong_sign("latitude")),
        ((-latitude, -longitude), wrong_sign("latitude and longitude")),
        (
            (latitude, longitude + math.radians(zones * _ZONE_DEG)),
            f"is it UTM zone {(zone + zones - 1) % 60 + 1} instead of {zone}?" if zones else "",
        ),
    )
    for corrected, question in corrections:
        if question and _apart_m(origin, corrected) < _HINT_M:
            return question
    local = _apart_m((0.0, 0.0), (latitude, longitude)) < _HINT_M
    return "are its coordinates metres of a local system?" if local else ""


def _apart_m(first: tuple[float, float], second: tuple[float, float]) -> float:
    """Return the chord (m) between two places, latitude and longitude (rad).

    Infinite if the latitude of ``second`` is impossible.
    """
    if abs(second[0]) > math.pi / 2:
        return math.inf
    apart = ecef_from_geodetic(*first, 0.0) - ecef_from_geodetic(*second, 0.0)
    return float(np.linalg.norm(apart))


class MapAbsence:
    """Explain why one map is not in view; search it again once the camera has moved."""

    def __init__(
        self, vector_map: VectorMap, plane: TangentPlane, first_n: Array | None = None
    ) -> None:
        """Set the map; ``first_n`` (3,) is a point of it, used if nothing lies on the ground."""
        self._map, self._first_n = vector_map, first_n
        self._off_ground = not (len(vector_map.lines) or len(vector_map.marks))
        self._plane = plane
        self._searched_from_n = np.full(3, np.inf)
        self._nearest: Nearest | None = None

    def why(self, camera: Camera, pose: CameraPose, far_m: float) -> str:
        """Return the reason for a pose in the map's plane; ground is drawn up to ``far_m``."""
        moved_m = math.dist(pose.position_n, self._searched_from_n)
        near_m = self._nearest.distance_m if self._nearest else 0.0
        if moved_m > max(_MOVED_M, _MOVED_PART * near_m):
            self._nearest = nearest_feature(self._map, pose.position_n, self._first_n)
            self._searched_from_n = pose.position_n
        if self._nearest is None:
            return "it has no place"
        distance_m, azimuth_rad, point_n = self._nearest
        lead = f"map {way_words(distance_m, azimuth_rad)}"
        if distance_m > ELSEWHERE_M:
            question = likely_mistake(self._plane, point_n)
            return f"{lead}; {question}" if question else lead
        if self._off_ground:
            return "none of the map lies on the elevation model"
        if _looks_above_horizon(camera, pose):
            return "the camera looks above the horizon"
        if distance_m > far_m:
            return f"{lead}; it is drawn up to {distance_words(far_m)}"
        return f"{lead}; the camera looks {compass_word(camera_heading_rad(pose))}"


def _looks_above_horizon(camera: Camera, pose: CameraPose) -> bool:
    """Return whether no pixel's ray points far enough down that ground is drawn there."""
    across = np.linspace(0, camera.width - 1, _GRID)
    down = np.linspace(0, camera.height - 1, _GRID)
    uv = np.stack(np.meshgrid(across, down), -1).reshape(-1, 2)
    north, east, below = matrix_from_quat(pose.q_nc) @ camera.rays(uv).T
    # Rays beyond the lens limit are nan and compare false.
    return not bool((below > np.hypot(north, east) * (HORIZON_ROWS / camera.fy)).any())
