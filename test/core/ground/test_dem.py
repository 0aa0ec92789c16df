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
"""Elevation models: the surface itself, and the first point at which a ray meets it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scenes import graticule

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Reason, Terrain, first_hit
from tirgeo_ros.core.types.errors import ElevationError

PLANE = TangentPlane(math.radians(39.85), math.radians(116.7), 30.0)
SIZE = 801  # nodes a side
STEP_DEG = (1 / 111_000, 1 / 85_500)  # about a metre
SOUTH_WEST_DEG = (39.85 - 400 * STEP_DEG[0], 116.7 - 400 * STEP_DEG[1])


def metres(latitude_rad, longitude_rad):
    """North and east of the origin, near enough for the shape of a hill."""
    north = (np.asarray(latitude_rad) - PLANE.latitude_rad) * 6.36e6
    return north, (np.asarray(longitude_rad) - PLANE.longitude_rad) * 4.9e6


def hills(latitude_rad, longitude_rad):
    """At most 8 / 70^2 of curvature: bilinear cells of a metre are off by an eighth, 0.2 mm."""
    north, east = metres(latitude_rad, longitude_rad)
    return 25.0 + 8.0 * np.sin(north / 70.0) * np.cos(east / 90.0)


def terrain_of(surface, rows=SIZE, columns=SIZE):
    latitude = SOUTH_WEST_DEG[0] + STEP_DEG[0] * np.arange(rows)[::-1]
    longitude = SOUTH_WEST_DEG[1] + STEP_DEG[1] * np.arange(columns)
    grid = np.meshgrid(np.radians(latitude), np.radians(longitude), indexing="ij")
    return Terrain(
        surface(*grid) + np.zeros(grid[0].shape), graticule(SOUTH_WEST_DEG, STEP_DEG, rows)
    )


def ray_of(pitch_deg, yaw_deg):
    pitch, yaw = np.radians([pitch_deg, yaw_deg])
    return np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)])


def first_below(surface, position_n, ray_n, longest_m, step_m=0.05):
    """The first crossing by brute force: small steps, then the secant's zero; or nan."""
    ways = np.arange(0.0, longest_m, step_m)
    lat, lon, height = PLANE.geodetic_from_ned(position_n + ways[:, None] * ray_n)
    above = height - surface(lat, lon)
    under = np.flatnonzero(above <= 0)
    if not under.size:
        return math.nan
    k = under[0]
    return ways[k - 1] + step_m * above[k - 1] / (above[k - 1] - above[k])


HILLS = terrain_of(hills)


@given(pitch=st.floats(-85, -8), yaw=st.floats(-180, 180), height=st.floats(15, 70))
def test_smooth_hills_are_met_within_a_centimetre(pitch, yaw, height):
    position_n, ray_n = np.array([3.0, -7.0, 5.0 - height]), ray_of(pitch, yaw)
    result = first_hit(HILLS, PLANE, position_n, ray_n)
    truth = first_below(hills, position_n, ray_n, 500.0)
    if isinstance(result, Reason) or math.isnan(truth):
        assert isinstance(result, Reason) or result > 350  # beyond the model, where truth ends too
        return
    # 0.2 mm of height are 1.4 mm along the flattest ray, but for one that touches a hilltop: it
    # may pass it by, and neither is wrong. Then it must have come within that height of it.
    if abs(result - truth) > 0.01:  # the figure required
        ways = np.linspace(min(result, truth) - 2, min(result, truth) + 2, 400)
        lat, lon, h = PLANE.geodetic_from_ned(position_n + ways[:, None] * ray_n)
        assert np.abs(h - hills(lat, lon)).min() < 5e-4


@given(pitch=st.floats(-80, 5), yaw=st.floats(-180, 180), seed=st.integers(0, 2**31))
def test_the_bilinear_surface_is_met_first_and_exactly(pitch, yaw, seed):
    """On a rough model, against steps of a hundredth of a cell along the same surface."""
    rng = np.random.default_rng(seed)
    rough = Terrain(rng.uniform(0, 12, (61, 61)), graticule(SOUTH_WEST_DEG, STEP_DEG, 61))
    start = np.radians([SOUTH_WEST_DEG[k] + 30.3 * STEP_DEG[k] for k in (0, 1)])
    position_n = PLANE.ned_from_geodetic(*start, 14.0)
    ray_n = ray_of(pitch, yaw)
    result = first_hit(rough, PLANE, position_n, ray_n)
    truth = first_below(rough.height_m, position_n, ray_n, 60.0, 0.01)
    if isinstance(result, Reason):
        assert math.isnan(truth)
        return
    lat, lon, height = PLANE.geodetic_from_ned(position_n + result * ray_n)
    # parabolas along pieces of 2 km are true to 0.1 mm
    assert abs(height - rough.height_m(lat, lon)) < 1e-4
    # steps of 1 cm may pass over a corner that is thinner
    assert result <= truth + 1e-3 or math.isnan(truth)
    ways = np.arange(0.0, result - 1e-3, 0.01)
    lat, lon, heights = PLANE.geodetic_from_ned(position_n + ways[:, None] * ray_n)
    assert (heights > rough.height_m(lat, lon)).all()


def test_a_ridge_one_cell_wide_is_not_passed_over():
    heights = np.full((SIZE, SIZE), 20.0)
    heights[300] = 45.0  # 100 rows north of the middle row, 400
    ridge = Terrain(heights, graticule(SOUTH_WEST_DEG, STEP_DEG, SIZE))
    result = first_hit(ridge, PLANE, np.array([0.0, 0.0, -10.0]), ray_of(-3, 0))
    assert 98 < result < 102  # behind it the plain begins 400 m away


@pytest.mark.parametrize(
    ("position_n", "ray_n", "stop"),
    [
        ([0, 0, -40], ray_of(10, 30), Reason.ABOVE_HORIZON),
        ([0, 0, -40], ray_of(90, 0), Reason.ABOVE_HORIZON),
        ([0, 0, -40], ray_of(-2, 30), Reason.OFF_MODEL),
        ([0, 0, 20], ray_of(-30, 30), Reason.UNDERGROUND),
        ([0, 0, 20], ray_of(30, 30), Reason.UNDERGROUND),
        ([900, 0, -40], ray_of(-30, 180), Reason.CAMERA_OFF_MODEL),
        ([0, 0, -40], np.full(3, np.nan), Reason.ABOVE_HORIZON),
    ],
)
def test_why_a_ray_meets_nothing(position_n, ray_n, stop):
    assert first_hit(HILLS, PLANE, np.array(position_n, float), ray_n) is stop


def test_a_gap_before_the_point_is_reported_and_one_behind_it_is_not():
    def holed(lat, lon):
        north, east = metres(lat, lon)
        return np.where(np.hypot(north - 60, east) < 5, np.nan, 20.0)

    gap = terrain_of(holed)
    steep, flat = ray_of(-60, 0), ray_of(-20, 0)
    position_n = np.array([0.0, 0.0, -30.0])
    assert first_hit(gap, PLANE, position_n, steep) == pytest.approx(40 / np.sin(np.pi / 3), 1e-3)
    assert first_hit(gap, PLANE, position_n, flat) is Reason.GAP
    assert isinstance(first_hit(gap, PLANE, position_n, ray_of(-20, 30)), float)


def test_heights_outside_and_beside_gaps_are_nan():
    heights = np.array([[1.0, 2.0, 3.0], [4.0, np.nan, 6.0]])
    terrain = Terrain(heights, graticule((0.0, 0.0), (1.0, 1.0), 2))
    assert np.isnan(
        terrain.height_m(np.radians([0.5, 2.0, -1.0]), np.radians([0.5, 1.0, 5.0]))
    ).all()
    assert (terrain.lowest_m, terrain.highest_m) == (1.0, 6.0)


def test_infinite_heights_are_gaps_and_any_layout_in_memory_serves():
    heights = np.arange(16.0).reshape(4, 4)
    heights[3, 3] = -np.inf
    turned = Terrain(heights.T[::-1], graticule((0.0, 0.0), (1.0, 1.0), 4))
    assert (turned.lowest_m, turned.highest_m) == (0.0, 14.0)
    assert turned.at(np.array(0.0), np.array(1.0)) == heights.T[::-1][1, 0]
    assert np.isnan(turned.at(np.array(2.5), np.array(0.5)))


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (np.zeros((1, 5)), "at least 2 x 2 heights are needed"),
        (np.zeros(5), "at least 2 x 2 heights are needed"),
        (np.full((3, 3), np.nan), "all its values are no-data"),
        (np.array([[0.0, 1.0], [2.0, -32768.0]]), "is its no-data value declared"),
    ],
)
def test_heights_that_are_no_model_are_refused(heights, message):
    with pytest.raises(ElevationError, match=message):
        Terrain(heights, graticule((0.0, 0.0), (1.0, 1.0), 2))
