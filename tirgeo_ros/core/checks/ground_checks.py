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
"""Check ground and map against the flight: heights at rest and in flight, places, empty files.

An aircraft at rest stands on the ground. It counts as at rest only if it was still for some
seconds and no part of the flight was lower: a hovering aircraft moves by centimetres, and flies
lower before or after. A flight that neither begins nor ends on the ground gives no such finding.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.checks.navigation_checks import LARGEST_UNDULATION_M
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, Terrain
from tirgeo_ros.core.map.visibility import ELSEWHERE_M, likely_mistake, nearest_feature, way_words
from tirgeo_ros.core.overlay.map_shapes import DrapedMap
from tirgeo_ros.core.streams.stamps import Spacing
from tirgeo_ros.core.types.finding import Finding, sorted_findings
from tirgeo_ros.core.types.poses import CameraPose

_EVERY_NS = 250_000_000
_MANY = 240  # poses that are examined together: a minute
_REST, _LONGEST_S = 13, 6.0  # poses of a rest (3 s or more), and its longest time
_STILL_M_S = 0.05  # filtered RTK noise is slower; a hover of half a minute is faster
_STILL_M = 0.05  # range of the places of a rest
_CLIMBS_M = 5.0  # height range of the flight that proves that the rest was not a hover
_LOWER_M = 0.5  # the rest is no more than this above the flight's lowest point
#: Plausible heights of the camera above ground at rest, given legs, roofs and a wrong ground.
_RESTS_M = (-2.0, 3.0)
_RESTS_ON_TERRAIN_M = (-6.0, 8.0)  # for elevation models from satellites
_BELOW_M = 2.0
_LASTS = 8  # consecutive samples: two seconds
#: Farther than a multirotor flies, and than a map is drawn.
_FAR_M = 10_000.0
#: Part of the map readers' remark on a file that names no coordinate system.
_NO_SYSTEM = "taken as WGS84"


def ground_parameter(ground: Ground | None) -> str:
    """Return the parameter that sets the ground's height."""
    terrain = isinstance(ground, Terrain)
    return "overlay_node dem, dem_undulation_m" if terrain else "overlay_node ground_height_m"


class HeightChecks:
    """Check poses over a ground; ``spacing`` selects those that are used."""

    def __init__(self, ground: Ground | None) -> None:
        self._plane: TangentPlane | None = None
        self._ground = ground
        self.spacing = Spacing(_EVERY_NS)
        # time s, position NED m, height above ground m, its sigma m
        self._rows: list[tuple[float, ...]] = []
        self._below_m = math.nan  # depth below the ground when first below it
        self._lowest_m, self._highest_m = math.inf, -math.inf  # in the plane
        self._rest = math.inf, math.nan  # height in the plane, and above ground

    def plane(self, plane: TangentPlane) -> None:
        """Take the plane of the poses."""
        self._plane = plane

    def pose(self, pose: CameraPose) -> None:
        """Take a pose, in order of time."""
        plane, ground = self._plane, self._ground
        if not self.spacing.take(pose.stamp_ns) or plane is None or ground is None:
            return
        latitude, longitude, height_m = plane.geodetic_from_ned(pose.position_n)
        level = ground.height_m(latitude, longitude) if isinstance(ground, Terrain) else ground
        sigma_m = math.sqrt(max(float(pose.covariance[2, 2]), 0.0))
        place = pose.position_n.tolist()
        self._rows.append((pose.stamp_ns * 1e-9, *place, float(height_m - level), sigma_m))
        if len(self._rows) >= _MANY:
            self._look()
            del self._rows[: 1 - _REST]

    def _look(self) -> None:
        """Look for a rest and for places below the ground in the newest rows."""
        if len(self._rows) < _REST:
            return
        rows = np.array(self._rows)
        above_m, heights_m = rows[:, 4], -rows[:, 3]
        below = sliding_window_view(above_m < -_BELOW_M - 4 * rows[:, 5], _LASTS).all(axis=1)
        if below.any() and math.isnan(self._below_m):
            self._below_m = -float(above_m[_LASTS - 1 :][below][0])
        self._lowest_m = min(self._lowest_m, float(heights_m.min()))
        self._highest_m = max(self._highest_m, float(heights_m.max()))
        steps = np.diff(rows[:, :4], axis=0)
        slow = np.linalg.norm(steps[:, 1:], axis=1) < _STILL_M_S * steps[:, 0]
        spans = np.ptp(sliding_window_view(rows[:, :4], _REST, axis=0), axis=2)
        rests = sliding_window_view(slow, _REST - 1).all(axis=1)
        rests &= (spans[:, 0] < _LONGEST_S) & (spans[:, 1:].max(axis=1) < _STILL_M)
        rests &= heights_m[_REST - 1 :] <= self._lowest_m + _LOWER_M
        if rests.any():
            last = _REST - 1 + int(np.flatnonzero(rests)[-1])
            self._rest = float(heights_m[last]), float(above_m[last])

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        self._look()
        findings = []
        if not math.isnan(self._below_m):
            findings.append(self._finding("below_ground", self._below_m))
        height_m, off_m = self._rest
        is_ground = height_m <= self._lowest_m + _LOWER_M
        if is_ground and self._highest_m - self._lowest_m >= _CLIMBS_M:
            terrain = isinstance(self._ground, Terrain)
            low, high = _RESTS_ON_TERRAIN_M if terrain else _RESTS_M
            if off_m < low or off_m > high:
                case = "" if off_m < 0 or terrain else "above"
                findings.append(self._finding("height_at_rest", off_m, case))
        return findings

    def _finding(self, check: str, off_m: float, case: str = "") -> Finding:
        case += " geoid" if 5.0 < abs(off_m) < LARGEST_UNDULATION_M else ""
        name = "dem_undulation_m" if isinstance(self._ground, Terrain) else "ground_height_m"
        return finding(check, case, off_m=off_m, where=ground_parameter(self._ground), name=name)


class MapChecks:
    """Check the map and the elevation model of a flight whenever the map or the plane changes."""

    def __init__(self, ground: Ground | None) -> None:
        self._ground = math.nan if ground is None else ground
        self._findings: list[Finding] = []
        self._has_map = False
        self._unread: list[Finding] = []

    def plane(self, plane: TangentPlane) -> None:
        """Take the plane of the flight; a map comes after it."""
        self._findings = dem_findings(self._ground, plane)

    def map(self, draped: DrapedMap) -> None:
        """Take a map that is draped in the plane."""
        self._findings, self._has_map = map_findings(draped, self._ground), True
        self._unread = []

    def failed(self, why: str) -> None:
        """Take the reason why the newest map was not read or draped; the previous one stays."""
        self._unread = [finding("map_unreadable", "older" if self._has_map else "", why=why)]

    def findings(self) -> list[Finding]:
        """Return the findings, the most severe first."""
        return sorted_findings([*self._findings, *self._unread])


def map_findings(draped: DrapedMap, ground: Ground) -> list[Finding]:
    """Return the faults of a map that was draped in the flight's plane, the most severe first.

    The plane's origin is taken as the place of take-off. ``ground`` is what the map was draped on.
    """
    if not draped.features:
        return [finding("map_empty")]
    findings = dem_findings(ground, draped.plane)
    if draped.map.without_ground == len(draped.map.labels) > 0:
        findings.append(finding("map_empty", "dem"))
    nearest = nearest_feature(draped.map, np.zeros(3), draped.first_n)
    if nearest is not None and nearest.distance_m > _FAR_M:
        question = likely_mistake(draped.plane, np.asarray(nearest.point_n))
        question = f"; {question}" if question else ""
        way = way_words(nearest.distance_m, nearest.azimuth_rad)
        case = "far" if nearest.distance_m > ELSEWHERE_M else ""
        findings.append(finding("map_elsewhere", case, way=way, question=question))
    remarks = [line for layer in draped.map.layers for line in layer.left_out]
    unsure = [finding("map_system_unknown", remark=line) for line in remarks if _NO_SYSTEM in line]
    return sorted_findings([*findings, *unsure])


def dem_findings(ground: Ground, plane: TangentPlane) -> list[Finding]:
    """Return the faults of an elevation model at the plane's origin."""
    if not isinstance(ground, Terrain):
        return []
    if math.isfinite(ground.height_m(*map(np.array, (plane.latitude_rad, plane.longitude_rad)))):
        return []
    around_n = np.array([(north, east, 0.0) for north in (-1, 1) for east in (-1, 1)]) * _FAR_M
    grid = np.array(ground.grid_of(*plane.geodetic_from_ned(around_n)[:2]))  # columns, rows
    last = np.array(ground.heights_m.shape[::-1]) - 1
    near = np.all((grid.max(axis=1) >= 0) & (grid.min(axis=1) <= last))  # false for nan
    latitude, longitude = map(math.degrees, (plane.latitude_rad, plane.longitude_rad))
    case = "near" if near else ""
    return [finding("dem_elsewhere", case, latitude=latitude, longitude=longitude)]
