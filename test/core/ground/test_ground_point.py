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
"""Pixels to points of the ground: geometry, covariance by Monte Carlo, CE90, what is refused."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scenes import camera_pose, graticule

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.camera.projection_covariance import CHI2_95, CameraRates, pixel_jacobian
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    quat_from_rotvec,
    quat_multiply,
    rotation_z,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Reason, Terrain, locate
from tirgeo_ros.core.ground.ground_point import (
    MOST_SHARE,
    Located,
    Refusal,
    circular_error_90,
    linear_error_90,
    place,
    point_covariance,
)
from tirgeo_ros.core.types.poses import CameraPose

PLANE = TangentPlane(math.radians(39.85), math.radians(116.7), 30.0)
COVARIANCE = np.diag([0.03, 0.02, 0.05, 0.004, 0.003, 0.006]) ** 2
COVARIANCE[0, 4] = COVARIANCE[4, 0] = 0.5 * 0.03 * 0.003
COVARIANCE[2, 5] = COVARIANCE[5, 2] = -0.4 * 0.05 * 0.006
CONFIG = ConfidenceConfig(
    latency_sigma_s=0.02, lens_sigma_px=1.5, focal_sigma=0.02, ground_sigma_m=0.15
)
CENTRE = np.array([XT2.cx, XT2.cy])
RATES = CameraRates(np.array([4.0, 3.0, -0.5]), np.array([0.05, -0.02, 0.2]))
RUNS = 1200


def pose_at(position_n, *angles_deg):
    return camera_pose(position_n, *angles_deg, COVARIANCE, stamp=7)


def slope_terrain():
    """Rolling ground, 0.2 steep at most, with waves long beside the errors."""
    step = (1 / 11_100, 1 / 8_550)  # 10 m
    south_west = (39.85 - 60 * step[0], 116.7 - 60 * step[1])
    north, east = np.meshgrid(
        (60.0 - np.arange(121)) * 10, (np.arange(121) - 60.0) * 10, indexing="ij"
    )
    heights = 5 + 20 * np.sin(north / 150) * np.cos(east / 180)
    return Terrain(heights, graticule(south_west, step, 121))


def drawn(rng, pose, uv):
    """Draw a true pose for an estimated one, and errors of the pixel and of the ground."""
    errors = rng.multivariate_normal(np.zeros(6), COVARIANCE)
    late = rng.normal(0, CONFIG.latency_sigma_s)
    errors += late * np.concatenate(RATES)
    q_nc = quat_multiply(quat_from_rotvec(errors[3:]), pose.q_nc)
    true = CameraPose(0, pose.position_n + errors[:3], q_nc, COVARIANCE)
    # A lens that is longer by a share sees at a pixel what the calibrated one sees further in.
    inwards = (CENTRE - uv) * (1 - 1 / (1 + rng.normal(0, CONFIG.focal_sigma)))
    shift = inwards + rng.normal(0, CONFIG.lens_sigma_px, 2)
    return true, shift, rng.normal(0, CONFIG.ground_sigma_m)


@pytest.mark.parametrize("kind", ["level", "terrain"])
@pytest.mark.parametrize("uv", [(320.0, 256.0), (60.0, 40.0)])
def test_the_covariance_against_monte_carlo(kind, uv):
    pose = pose_at([10.0, -20.0, -60.0], 4, -40, 70)
    ground = 5.0 if kind == "level" else slope_terrain()
    result = place(XT2, pose, uv, PLANE, ground, CONFIG, RATES)
    assert isinstance(result, Located)
    rng = np.random.default_rng(3)
    truth = []
    for _ in range(RUNS):
        true, shift, raised = drawn(rng, pose, uv)
        if kind == "level":
            under = 5.0 + raised
        else:
            under = dataclasses.replace(ground, heights_m=ground.heights_m + raised)
        points, reasons = locate(XT2, true, np.array([uv]) + shift, PLANE, under)
        assert reasons == [None]
        truth.append(points[0])
    errors = np.array(truth) - result.point_n
    inverse = np.linalg.inv(result.covariance_n[:2, :2])
    squares = np.einsum("ni,ij,nj->n", errors[:, :2], inverse, errors[:, :2])
    # 95 % of 1200 with a standard deviation of 0.63 %: the range asked for is 3.2 of them
    assert 0.93 < np.mean(squares < CHI2_95) < 0.97
    # a variance from 1200 draws is known to 4.1 %; three and a half of that
    np.testing.assert_allclose(np.var(errors, axis=0), result.covariance_n.diagonal(), rtol=0.15)
    assert np.linalg.eigvalsh(result.covariance_n)[0] > -1e-12


@given(seed=st.integers(0, 2**31))
def test_the_covariance_is_that_of_the_pixels_derivatives(seed):
    """du = J_pose d_pose + J_point d_point and m . d_point = m . up dh, solved for d_point."""
    rng = np.random.default_rng(seed)
    pose = pose_at(
        rng.uniform(-300, 300, 3) - [0, 0, 400], *rng.uniform([-20, -80, 0], [20, -35, 360])
    )
    uv = rng.uniform([0, 0], [639, 511], (1, 2))
    (point_n,), _ = locate(XT2, pose, uv, PLANE, 5.0)
    by_pose, by_point = (each[0] for each in pixel_jacobian(XT2, pose, point_n[None]))
    latitude, longitude, _ = PLANE.geodetic_from_ned(point_n)
    up_n = PLANE.up_n(latitude, longitude)
    sources = np.zeros((3, 3))
    sources[:2, :2] = by_pose @ COVARIANCE @ by_pose.T + CONFIG.lens_sigma_px**2 * np.eye(2)
    sources[:2, :2] += CONFIG.focal_sigma**2 * np.outer(*[(uv[0] - CENTRE)] * 2)
    sources[2, 2] = CONFIG.ground_sigma_m**2
    inverse = np.linalg.inv(np.vstack([by_point, up_n]))
    expected = inverse @ sources @ inverse.T
    result = point_covariance(XT2, pose, COVARIANCE, point_n, PLANE, 5.0, CONFIG)
    # the pixels' derivatives are 1 px/m and less, the normal 1: the inverse loses three digits
    np.testing.assert_allclose(result, expected, rtol=0, atol=1e-9 * np.trace(expected))


def test_the_answer_says_where_and_how_sure():
    pose = pose_at([10.0, -20.0, -60.0], 4, -40, 70)
    result = place(XT2, pose, (320.0, 256.0), PLANE, 5.0, CONFIG)
    back = PLANE.ned_from_geodetic(result.latitude_rad, result.longitude_rad, result.height_m)
    np.testing.assert_allclose(back, result.point_n, atol=1e-7)
    assert result.stamp_ns == 7
    latitude, longitude, sign = result.label.split(" ")[:3]
    assert float(latitude) == pytest.approx(math.degrees(result.latitude_rad), abs=5e-7)
    assert float(longitude) == pytest.approx(math.degrees(result.longitude_rad), abs=5e-7)
    assert sign == f"±{result.ellipse.major_m:.1f}"


def test_flatter_rays_are_less_sure_and_then_refused():
    pose = pose_at([0.0, 0.0, -20.0], 0, -12, 0)
    rows = np.arange(500, 60, -4.0)
    answers = [place(XT2, pose, (320.0, row), PLANE, 30.0, CONFIG) for row in rows]
    kinds = [isinstance(item, Located) for item in answers]
    lengths = [item.ellipse.major_m for item in answers if isinstance(item, Located)]
    assert lengths == sorted(lengths)
    assert kinds == sorted(kinds, reverse=True)
    assert {item.reason for item in answers if isinstance(item, Refusal)} == {
        Reason.GRAZING,
        Reason.ABOVE_HORIZON,
    }
    last = [item for item in answers if isinstance(item, Located)][-1]
    assert last.ellipse.major_m <= MOST_SHARE * np.linalg.norm(last.point_n - pose.position_n)


@pytest.mark.parametrize(
    "covariance",
    [np.full((6, 6), np.nan), np.full((6, 6), np.inf), np.diag([1e-2] * 3 + [1e-6, 1e-6, -1e-6])],
)
def test_a_pose_of_unknown_covariance_is_refused(covariance):
    pose = dataclasses.replace(pose_at([0, 0, -50], 0, -90, 0), covariance=covariance)
    answer = place(XT2, pose, (320.0, 256.0), PLANE, 30.0, CONFIG)
    assert isinstance(answer, Refusal)
    assert answer.reason is Reason.UNCERTAIN_POSE


RATIONAL = Camera(
    640, 512, 500.0, 510.0, 322.0, 250.0, (0.1, -0.05, 1e-3, -5e-4, 0.01, 0.12, -0.03, 0.005)
)


@given(
    roll=st.floats(-20, 20),
    pitch=st.floats(-90, -25),
    yaw=st.floats(-180, 180),
    height=st.floats(5, 200),
    ground=st.floats(-80, 80),
    far=st.floats(0, 3000),
    camera=st.sampled_from([XT2, RATIONAL]),
    seed=st.integers(0, 2**31),
)
def test_inverts_the_projection(roll, pitch, yaw, height, ground, far, camera, seed):
    rng = np.random.default_rng(seed)
    lat, lon, _ = PLANE.geodetic_from_ned(np.array([far, -far, 0.0]))
    pose = camera_pose(PLANE.ned_from_geodetic(lat, lon, ground + height), roll, pitch, yaw)
    uv = rng.uniform([0, 0], [639, 511], (3, 2))
    points, reasons = locate(camera, pose, uv, PLANE, ground)
    met = np.array([reason is None for reason in reasons])
    assert np.isfinite(points).all(axis=1).tolist() == met.tolist()
    points, uv = points[met], uv[met]
    # earth-fixed coordinates of 6e6 m are rounded by 1e-9 m, some times over
    np.testing.assert_allclose(PLANE.geodetic_from_ned(points)[2], ground, atol=2e-8)
    back, observed = camera.project((points - pose.position_n) @ matrix_from_quat(pose.q_nc))
    assert observed.all()
    np.testing.assert_allclose(back, uv, rtol=0, atol=1e-6)  # the figure required


LEVEL = camera_pose([0.0, 0.0, 0.0], 0, 0, 0)
ABOUT_THE_AXIS = [[XT2.cx, XT2.cy - 100], [XT2.cx, XT2.cy], [XT2.cx, XT2.cy + 100]]
ABOVE_TWICE = [Reason.ABOVE_HORIZON, Reason.ABOVE_HORIZON, None]
OUTSIDE_LENS = [[1e6, 1e6], [np.nan, 10.0], [-1e12, 3.0]]


@pytest.mark.parametrize(
    ("pose", "ground_m", "uv", "expected"),
    [
        (LEVEL, 29.9, ABOUT_THE_AXIS, ABOVE_TWICE),
        (LEVEL, -100.0, ABOUT_THE_AXIS, ABOVE_TWICE),
        (
            camera_pose([0, 0, 5.0], 0, -40),
            30.0,
            [[320, 10], [320, 500]],
            [Reason.UNDERGROUND] * 2,
        ),
        (camera_pose([0, 0, -20.0]), 30.0, OUTSIDE_LENS, [Reason.OUTSIDE_LENS] * 3),
    ],
)
def test_why_a_pixel_meets_nothing(pose, ground_m, uv, expected):
    points, reasons = locate(XT2, pose, np.array(uv, float), PLANE, ground_m)
    assert reasons == expected
    assert np.isnan(points[[reason is not None for reason in reasons]]).all()


def test_the_horizon_dips_as_on_a_sphere():
    """From h above a sphere it lies sqrt(2 h / R) under the level: 5.6 mrad from 100 m."""
    level = camera_pose([0.0, 0.0, -100.0], 0, 0, 0)
    dip = np.sqrt(2 * 100 / 6.36e6)
    rows = XT2.cy + XT2.fy * np.tan(dip * np.array([0.95, 1.05]))
    uv = np.stack([np.full(2, XT2.cx), rows], -1)  # at the centre the lens does not bend
    assert locate(XT2, level, uv, PLANE, 30.0)[1] == [Reason.ABOVE_HORIZON, None]


DRAWS = 200_000


def covariance(major_m, minor_m, azimuth_rad=0.0, down_m=1.0):
    turn = rotation_z(azimuth_rad)
    return turn @ np.diag([major_m**2, minor_m**2, down_m**2]) @ turn.T


@pytest.mark.parametrize(("minor", "table"), [(1.0, 2.1460), (0.5, 1.7371), (0.0, 1.6449)])
def test_tables(minor, table):
    """The last digit of the tables: a circle, half as wide as long, a line."""
    assert circular_error_90(covariance(3.0, 3.0 * minor)) == pytest.approx(3 * table, abs=3e-4)
    assert linear_error_90(covariance(1.0, 1.0, down_m=2.0)) == pytest.approx(2 * 1.6449, abs=2e-4)


@given(st.floats(0, 1), st.floats(0, math.pi), st.floats(1e-3, 1e3))
def test_nine_of_ten_are_within(ratio, azimuth, sigma):
    spread = covariance(sigma, sigma * ratio, azimuth)
    drawn = np.random.default_rng(5).standard_normal((DRAWS, 2)) * [sigma, sigma * ratio]
    share = np.mean(np.hypot(*drawn.T) <= circular_error_90(spread))
    # Four standard deviations of a share of DRAWS.
    assert share == pytest.approx(0.9, abs=4 * math.sqrt(0.09 / DRAWS))


def test_without_an_error_the_circle_is_a_point():
    assert circular_error_90(np.zeros((3, 3))) == 0.0
    assert linear_error_90(np.zeros((3, 3))) == 0.0
