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
"""The ellipsoid and the tangent plane against PROJ over the globe, and gravity as published."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from pyproj import Transformer

from tirgeo_ros.core.frames import wgs84 as geodesy
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_euler
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.poses import NavSolution

#: Earth-fixed coordinates of 6.4e6 m hold 1e-9 m (half a unit in the last place is 4.7e-10).
ECEF_M = 5e-9
HALF_PI = math.pi / 2

ECEF_OF_GEODETIC = Transformer.from_crs(4979, 4978, always_xy=True)

latitudes = st.floats(-HALF_PI, HALF_PI)
longitudes = st.floats(-math.pi, math.pi)
heights = st.floats(-400, 9000)
near = st.floats(-5e3, 5e3)


def proj_ecef(lat, lon, height):
    return np.array(ECEF_OF_GEODETIC.transform(lon, lat, height, radians=True))


def proj_topocentric(plane: TangentPlane) -> Transformer:
    """PROJ's east, north, up metres about the plane's origin from geodetic degrees."""
    lat, lon = math.degrees(plane.latitude_rad), math.degrees(plane.longitude_rad)
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
        " +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84"
        f" +lat_0={lat!r} +lon_0={lon!r} +h_0={plane.height_m!r}"
    )


def axes_by_differences(lat, lon, height):
    """North, east, down (columns) at a place, from PROJ's positions a little apart."""
    step = 1e-5  # 64 m: rounding 1e-9 / 64, third order (1e-5)^2 / 6
    north = proj_ecef(lat + step, lon, height) - proj_ecef(lat - step, lon, height)
    east = proj_ecef(lat, lon + step, height) - proj_ecef(lat, lon - step, height)
    down = proj_ecef(lat, lon, height - 64) - proj_ecef(lat, lon, height + 64)
    return np.stack([v / np.linalg.norm(v) for v in (north, east, down)], -1)


@given(latitudes, longitudes, heights)
def test_earth_fixed_position_is_projs(lat, lon, height):
    result = geodesy.ecef_from_geodetic(lat, lon, height)
    np.testing.assert_allclose(result, proj_ecef(lat, lon, height), rtol=0, atol=ECEF_M)


@given(latitudes, longitudes, heights)
@example(HALF_PI - 1e-9, math.pi, 0.0)
@example(-HALF_PI, -math.pi, 0.0)
@example(-0.0, -math.pi, 0.0)
def test_geodetic_position_comes_back(lat, lon, height):
    result = geodesy.geodetic_from_ecef(geodesy.ecef_from_geodetic(lat, lon, height))
    assert float(result[0]) == pytest.approx(lat, abs=1e-15)  # 1e-15 rad are 6 nm
    assert float(result[2]) == pytest.approx(height, abs=ECEF_M)
    aside_m = 6.4e6 * math.cos(lat) * math.remainder(float(result[1]) - lon, 2 * math.pi)
    assert abs(aside_m) < ECEF_M


@pytest.mark.parametrize("shape", [(), (1,), (3,), (4,), (3, 3)])
def test_batches_equal_their_elements(shape):
    rng = np.random.default_rng(1)
    lat, lon = rng.uniform(-1.5, 1.5, shape), rng.uniform(-3, 3, shape)
    height = rng.uniform(-400, 9000, shape)
    result = geodesy.ecef_from_geodetic(lat, lon, height)
    assert result.shape == (*shape, 3)
    back = np.stack(geodesy.geodetic_from_ecef(result), -1)
    assert back.shape == (*shape, 3)
    for index in np.ndindex(*shape):
        item = geodesy.ecef_from_geodetic(lat[index], lon[index], height[index])
        np.testing.assert_allclose(result[index], item, rtol=0, atol=ECEF_M)
        assert back[index] == pytest.approx([lat[index], lon[index], height[index]], abs=ECEF_M)


@given(st.floats(-1.5, 1.5), longitudes)
def test_radii_are_those_of_the_surface(lat, lon):
    """The way on the surface per radian, from PROJ's positions."""
    meridian, transverse = geodesy.radii_of_curvature(lat)
    step = 1e-4
    north = proj_ecef(lat + step, lon, 0) - proj_ecef(lat - step, lon, 0)
    east = proj_ecef(lat, lon + step, 0) - proj_ecef(lat, lon - step, 0)
    # Chord against arc: (1e-4)^2 / 6; rounding 1e-9 over 45 m (at 1.5 rad) is 2e-11.
    assert np.linalg.norm(north) / (2 * step) == pytest.approx(meridian, rel=1e-8)
    assert np.linalg.norm(east) / (2 * step) == pytest.approx(transverse * math.cos(lat), rel=1e-8)


@pytest.mark.parametrize(
    ("lat_deg", "expected"), [(0, 9.7803253359), (90, 9.8321849379), (-90, 9.8321849379)]
)
def test_gravity_on_the_ellipsoid_as_published(lat_deg, expected):
    """NIMA TR8350.2, table 3.4; Somigliana's constant is given to 5e-10 of 9.8 m/s2."""
    assert geodesy.gravity_down(math.radians(lat_deg), 0.0) == pytest.approx(expected, abs=5e-9)


@given(st.floats(-1.5, 1.5), longitudes, heights)
def test_local_axes_are_the_ways_of_the_coordinates(lat, lon, height):
    result = geodesy.rotation_ecef_from_ned(lat, lon)
    # Rounding 1e-9 m over 2 x 4.5 m (east at 1.5 rad).
    np.testing.assert_allclose(result, axes_by_differences(lat, lon, height), atol=1e-9)


@given(latitudes, longitudes, heights, near, near, st.floats(-400, 400))
@example(HALF_PI, 0.0, 0.0, 100.0, 100.0, 10.0)
@example(0.3, math.pi, 50.0, 10.0, 2000.0, -10.0)
@example(-HALF_PI + 1e-6, -math.pi, 50.0, -3000.0, -2000.0, -10.0)
def test_plane_is_projs_topocentric_frame(lat, lon, height, north, east, down):
    plane = TangentPlane(lat, lon, height)
    place = plane.geodetic_from_ned(np.array([north, east, down]))
    result = plane.ned_from_geodetic(*place)
    np.testing.assert_allclose(result, [north, east, down], rtol=0, atol=2 * ECEF_M)
    degrees = math.degrees(float(place[1])), math.degrees(float(place[0]))
    east_north_up = proj_topocentric(plane).transform(*degrees, float(place[2]))
    expected = [east_north_up[1], east_north_up[0], -east_north_up[2]]
    # Two chains of coordinates of 6.4e6 m, and degrees: 180 deg hold 1.4e-14 deg = 1.6e-9 m.
    np.testing.assert_allclose(result, expected, rtol=0, atol=4 * ECEF_M)


@given(st.floats(-1.48, 1.48), longitudes, near, near, st.floats(-3, 3), st.floats(-1.5, 1.5))
def test_pose_and_covariance_are_turned_as_the_earth_is_curved(lat, lon, north, east, yaw, pitch):
    plane = TangentPlane(lat, lon, 30.0)
    place = [float(x) for x in plane.geodetic_from_ned(np.array([north, east, -20.0]))]
    root = np.random.default_rng(3).normal(size=(9, 9))
    motion = np.ones(3), quat_from_euler(0.2, pitch, yaw), np.zeros(3), (0, 0, 0)
    solution = NavSolution(5, *place, *motion, root @ root.T)
    pose = plane.body_pose(solution)
    there = axes_by_differences(solution.latitude_rad, solution.longitude_rad, 30.0)
    turn = axes_by_differences(lat, lon, 30.0).T @ there
    expected = turn @ matrix_from_quat(solution.q_nb)
    np.testing.assert_allclose(matrix_from_quat(pose.q_nb), expected, atol=2e-9)
    np.testing.assert_allclose(pose.position_n, (north, east, -20), rtol=0, atol=2 * ECEF_M)
    assert pose.stamp_ns == 5
    both = np.kron(np.eye(2), turn)
    # Entries up to 20 turned by 2e-9 rad.
    covariance = both @ solution.covariance[:6, :6] @ both.T
    np.testing.assert_allclose(pose.covariance, covariance, rtol=0, atol=2e-7)
