"""Check map and elevation model against the place of the flight."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.distance import (
    ELSEWHERE_M,
    likely_mistake,
    nearest_feature,
    way_words,
)
from tirgeo_ros.core.map.draping import Ground
from tirgeo_ros.core.overlay.map_renderer import DrapedMap
from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings

#: Farther than a multirotor flies, and than a map is drawn.
_FAR_M = 10_000.0
#: Part of the map readers' remark on a file that names no coordinate system.
_NO_SYSTEM = "taken as WGS84"
_MAP, _DEM = "overlay_node map", "overlay_node dem"


class MapChecks:
    """Check the map and the elevation model of a flight whenever map or plane are new."""

    def __init__(self, ground: Ground | None) -> None:
        self._ground = math.nan if ground is None else ground
        self._found: list[Finding] = []
        self._laid = False
        self._unread: list[Finding] = []

    def plane(self, plane: TangentPlane) -> None:
        """Take the plane of the flight; a map comes after it."""
        self._found = dem_findings(self._ground, plane)

    def map(self, laid: DrapedMap) -> None:
        """Take a map that is draped in the plane."""
        self._found, self._unread, self._laid = map_findings(laid, self._ground), [], True

    def failed(self, why: str) -> None:
        """Take the reason why the newest map was not read or draped; the previous one stays."""
        severity = Severity.CAUTION if self._laid else Severity.STOP
        mend = "correct the file: it is read again when it changes"
        self._unread = [Finding("map_unreadable", severity, why, _MAP, mend)]

    def findings(self) -> list[Finding]:
        """Return the findings, the most severe first."""
        return sorted_findings([*self._found, *self._unread])


def map_findings(laid: DrapedMap, ground: Ground) -> list[Finding]:
    """Return the faults of a map that was draped in the flight's plane, the most severe first.

    The plane's origin is taken as the place of take-off. ``ground`` is what the map was draped on.
    """
    if not laid.features:
        return [_nothing("the map has no features", _MAP)]
    found = _ground_findings(laid, ground)
    nearest = nearest_feature(laid.map, np.zeros(3), laid.first_n)
    if nearest is not None and nearest.distance_m > _FAR_M:
        severity = Severity.STOP if nearest.distance_m > ELSEWHERE_M else Severity.CAUTION
        way = way_words(nearest.distance_m, nearest.azimuth_rad)
        question = likely_mistake(laid.plane, np.asarray(nearest.point_n))
        evidence = f"map is {way}{'; ' if question else ''}{question}"
        mend = "give a map of this place, in its own coordinate system (crs in the style sheet)"
        found.append(Finding("map_elsewhere", severity, evidence, _MAP, mend))
    remarks = [line for layer in laid.map.layers for line in layer.left_out if _NO_SYSTEM in line]
    mend = (
        "save it in WGS84 (EPSG:4326), or name its coordinate system under crs in the style sheet"
    )
    unknown = [Finding("map_system_unknown", Severity.NOTE, one, _MAP, mend) for one in remarks]
    return sorted_findings([*found, *unknown])


def dem_findings(ground: Ground, plane: TangentPlane) -> list[Finding]:
    """Return the faults of an elevation model at the plane's origin."""
    if not isinstance(ground, Terrain):
        return []
    latitude, longitude = np.array(plane.latitude_rad), np.array(plane.longitude_rad)
    if math.isfinite(ground.height_m(latitude, longitude)):
        return []
    place = f"({math.degrees(plane.latitude_rad):.5f}, {math.degrees(plane.longitude_rad):.5f})"
    evidence = f"the elevation model has no height at the place of take-off {place}"
    mend = "give a model of this place; are its latitude and longitude, or its UTM zone, right?"
    around_n = np.array([(north, east, 0.0) for north in (-1, 1) for east in (-1, 1)]) * _FAR_M
    grid = np.array(ground.grid_of(*plane.geodetic_from_ned(around_n)[:2]))  # columns, rows
    last = np.array(ground.heights_m.shape[::-1]) - 1
    near = np.all((grid.max(axis=1) >= 0) & (grid.min(axis=1) <= last))  # false for nan
    severity = Severity.CAUTION if near else Severity.STOP
    return [Finding("dem_elsewhere", severity, evidence, _DEM, mend)]


def _nothing(evidence: str, parameter: str) -> Finding:
    mend = (
        "check that its file has lines, outlines or points, and that the style sheet names its "
        "layers"
    )
    return Finding("map_empty", Severity.STOP, evidence, parameter, mend)


def _ground_findings(laid: DrapedMap, ground: Ground) -> list[Finding]:
    found = dem_findings(ground, laid.plane)
    lost, whole = laid.map.without_ground, len(laid.map.labels)
    if lost and lost == whole:
        return [*found, _nothing("none of the map lies on the elevation model", _DEM)]
    return found
