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
"""Maps and elevation models of another place, and heights of the ground that are wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest
from map_files import write_shapefile
from overlays import PLANE, SQUARE_N, geo
from scenes import graticule

from tirgeo_ros.core.checks.ground_checks import (
    HeightChecks,
    MapChecks,
    dem_findings,
    map_findings,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.map.vector_map import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.overlay.map_shapes import drape_layers
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.maps import load_layers

GROUND_M = 25.0
NORTH_N = np.array([1.0, 0.0, 0.0])
STEP_DEG = 1e-4  # a cell of the elevation model: 11 m


def laid(*features, ground=GROUND_M, **style):
    return drape_layers([MapLayer("m", features, LayerStyle(**style))], PLANE, ground)


def at(latitude_deg, longitude_deg):
    return GeoFeature("", False, np.array([[*np.radians([latitude_deg, longitude_deg]), 25.0]]))


def model(north_m=0.0, east_m=0.0, gap=False):
    """Of 1.1 km, with the plane's origin in its middle before it is moved."""
    nodes = 101
    place = PLANE.geodetic_from_ned(np.array([north_m, east_m, 0.0]))
    corner = np.degrees(place[:2]) - STEP_DEG * (nodes // 2)
    heights = np.full((nodes, nodes), GROUND_M)
    if gap:
        heights[45:56, 45:56] = np.nan
    return Terrain(heights, graticule(tuple(corner), (STEP_DEG, STEP_DEG), nodes))


def test_nothing_is_wrong_with_a_map_of_the_place():
    for ground in (GROUND_M, model()):
        assert map_findings(laid(geo(SQUARE_N), ground=ground), ground) == []
    near = laid(geo(SQUARE_N + 6000 * NORTH_N))
    assert map_findings(near, GROUND_M) == []


@pytest.mark.parametrize(
    ("place", "severity", "evidence"),
    [
        ((34.4, 114.3), Severity.STOP, "430 km away to the north"),
        ((30.63, 114.3), Severity.CAUTION, "14 km away to the north"),
        (
            (30.5, 120.3),
            Severity.STOP,
            "580 km away to the east; is it UTM zone 50 instead of 51?",
        ),
        ((30.5, -114.3), Severity.STOP, "12000 km away to the north-east; is the sign of longitu"),
    ],
)
def test_a_map_of_another_place(place, severity, evidence):
    [result] = map_findings(laid(at(*place)), GROUND_M)
    assert (result.check, result.severity) == ("map_elsewhere", severity)
    assert result.parameter == "overlay_node map"
    assert result.evidence.startswith(f"map is {evidence}")


@pytest.mark.parametrize(
    ("north_m", "east_m", "severity"),
    [
        (2550.0, 0.0, Severity.CAUTION),
        (0.0, -3480.0, Severity.CAUTION),
        (0.0, 12_000.0, Severity.STOP),
        (400_000.0, 0.0, Severity.STOP),
    ],
)
def test_a_model_of_another_place(north_m, east_m, severity):
    [result] = dem_findings(model(north_m, east_m), PLANE)
    assert (result.check, result.severity) == ("dem_elsewhere", severity)
    assert result.parameter == "overlay_node dem"


def test_a_map_beside_the_model():
    elsewhere = model(20_000.0)
    checks = {f.check: f for f in map_findings(laid(geo(SQUARE_N), ground=elsewhere), elsewhere)}
    assert set(checks) == {"dem_elsewhere", "map_empty"}
    assert checks["map_empty"].severity is Severity.STOP


def test_a_file_that_names_no_system_is_noted(tmp_path):
    """The remark is the map reader's."""
    place = np.degrees([PLANE.longitude_rad, PLANE.latitude_rad])
    write_shapefile(tmp_path / "m.shp", [[(*place, 25.0), (*place + STEP_DEG, 25.0)]], prj=None)
    layers = load_layers(str(tmp_path / "m.shp"))
    [result] = map_findings(drape_layers(layers, PLANE, GROUND_M), GROUND_M)
    assert (result.check, result.severity) == ("map_system_unknown", Severity.NOTE)
    assert "names no known coordinate system" in result.evidence


def test_the_checks_of_a_flight_follow_its_plane_and_its_map():
    checks = MapChecks(model(gap=True))
    assert checks.findings() == []
    checks.plane(PLANE)
    assert [result.check for result in checks.findings()] == ["dem_elsewhere"]
    checks.map(laid(at(34.4, 114.3), ground=model(gap=True)))
    assert {result.check for result in checks.findings()} == {
        "dem_elsewhere",
        "map_elsewhere",
        "map_empty",
    }
    unknown = MapChecks(None)
    unknown.plane(PLANE)
    unknown.map(laid(geo(SQUARE_N)))
    assert unknown.findings() == []


def test_a_map_that_cannot_be_read_stops_where_there_is_none_and_is_forgotten_once_it_is_right():
    checks, whole = MapChecks(GROUND_M), laid(geo(SQUARE_N))
    checks.failed("park.geojson: not JSON")
    (result,) = checks.findings()
    assert (result.severity, result.parameter) == (Severity.STOP, "overlay_node map")
    checks.map(whole)
    assert checks.findings() == []
    checks.failed("park.geojson: not JSON")
    (result,) = checks.findings()
    assert result.severity is Severity.CAUTION


HOME_M = 150.0  # ellipsoidal height of the place of take-off
GEOID_M = 47.0
HOME = TangentPlane(math.radians(48.0), math.radians(11.0), HOME_M)


def poses(heights_m):
    """Poses at 10 Hz at heights above the place of take-off, shaken as by RTK at rest."""
    rng = np.random.default_rng(3)
    for k, height_m in enumerate(heights_m):
        position_n = np.array([0.0, 0.0, -height_m]) + rng.normal(0.0, 0.002, 3)
        q_nb = np.array([1.0, 0.0, 0.0, 0.0])
        yield CameraPose(k * 100_000_000, position_n, q_nb, np.eye(6) * 1e-4)


CLIMB = list(np.linspace(0.4, 40.0, 200))
FLIGHT = [*[0.4] * 60, *CLIMB, *[40.0] * 100]


def heights_found(ground, heights_m):
    checks = HeightChecks(ground)
    checks.plane(HOME)
    for pose in poses(heights_m):
        checks.pose(pose)
    return checks.findings()


def level(height_m):
    return Terrain(np.full((3, 3), height_m), graticule((47.9, 10.9), (0.1, 0.1), 3))


FAR = Terrain(np.full((3, 3), 0.0), graticule((10.0, 10.0), (0.1, 0.1), 3))


@pytest.mark.parametrize(
    ("ground", "flight"),
    [
        *((ground, FLIGHT[::way]) for ground in (HOME_M, level(HOME_M)) for way in (1, -1)),
        # A flight that starts and ends in the air has no rest, however still it hangs.
        (HOME_M - GEOID_M, [20.0] * 300),
        (HOME_M - GEOID_M, [*[20.0] * 100, *CLIMB[::-1], *CLIMB]),
        # The ground is not known.
        (None, FLIGHT),
        (FAR, FLIGHT),
    ],
)
def test_nothing_is_reported_where_nothing_is_wrong_or_known(ground, flight):
    assert heights_found(ground, flight) == []


LONG = [*FLIGHT, *[40.0] * 2000]


@pytest.mark.parametrize("flight", [FLIGHT, FLIGHT[::-1], LONG], ids=["up", "down", "long"])
def test_ground_above_sea_level_is_reported_at_rest(flight):
    [plane] = heights_found(HOME_M - GEOID_M, flight)
    assert plane.check == "height_at_rest"
    assert "47.4 m above ground" in plane.evidence
    assert plane.parameter == "overlay_node ground_height_m"
    assert "above sea level" in plane.mend
    [model] = heights_found(level(HOME_M - GEOID_M), flight)
    assert model.severity is Severity.STOP
    assert "dem_undulation_m" in model.parameter


@pytest.mark.parametrize("ground", [HOME_M + GEOID_M, level(HOME_M + GEOID_M)])
def test_below_the_ground_is_a_stop_on_any_ground(ground):
    findings = heights_found(ground, [40.0] * 60)
    assert [(item.check, item.severity) for item in findings] == [("below_ground", Severity.STOP)]
    assert "7.0 m below" in findings[0].evidence
