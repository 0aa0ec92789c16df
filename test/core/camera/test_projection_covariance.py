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
"""Covariances in the picture, against differences and against drawn errors."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scenes import camera_pose

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.camera.projection_covariance import (
    CHI2_95,
    CameraRates,
    FrameConfidence,
    ellipse_95,
    matrices,
    pixel_jacobian,
    radius_95,
    rays_to,
    timed_covariance,
)
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat, matrix_from_rotvec, quat_from_matrix

PINHOLE = Camera(640, 512, 880.0, 880.0, 319.5, 255.5)
BARREL = Camera(640, 512, 420.0, 425.0, 318.0, 250.0, (-0.28, 0.09, 0.001, -0.0005))
RATIONAL = Camera(
    1280, 720, 600.0, 601.0, 640.0, 350.0, (0.9, 0.3, 0.0006, -0.0004, 0.01, 1.25, 0.55, 0.06)
)
CAMERAS = {"pinhole": PINHOLE, "xt2": XT2, "barrel": BARREL, "rational": RATIONAL}
EACH = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
#: Nothing but the pose's own error.
EXACT = ConfidenceConfig(
    latency_sigma_s=0.0, lens_sigma_px=0.0, map_sigma_m=0.0, ground_sigma_m=0.0
)


def pose_at(height_m=20.0, down_deg=30.0, covariance=None, yaw_deg=25.0, roll_deg=3.0):
    return camera_pose([7.0, -4.0, -height_m], roll_deg, -down_deg, yaw_deg, covariance)


def screen_covariance(camera, pose, points_n, config, rates=None, sigma_m=None):
    frame, rays = FrameConfidence(config, camera, pose, rates), rays_to(camera, pose, points_n)
    spread, linear = frame.spread(rays, sigma_m, rays.shape[1])
    return matrices(spread), linear


def some_covariance(position_m=0.3, attitude_deg=0.4, seed=0):
    """Return a full matrix (6, 6): every error is correlated with every other."""
    mixed = np.random.default_rng(seed).normal(size=(6, 6)) / np.sqrt(6)
    scale = np.repeat([position_m, math.radians(attitude_deg)], 3)
    return scale[:, None] * (mixed @ mixed.T) * scale


def ground_at(camera, pose, uv):
    """(N, 3) where pixels (N, 2) meet the plane at 0 m down; nan from 3 deg under the horizon."""
    rays_n = camera.rays(np.asarray(uv, float)) @ matrix_from_quat(pose.q_nc).T
    rays_n[rays_n[:, 2] < 0.05 * np.linalg.norm(rays_n, axis=1)] = np.nan
    return pose.position_n - pose.position_n[2] / rays_n[:, 2:] * rays_n


def moved(pose, error):
    """The pose that a position error and phi_n (6,) lead to, as the charter defines them."""
    q = quat_from_matrix(matrix_from_rotvec(error[3:]) @ matrix_from_quat(pose.q_nc))
    return dataclasses.replace(pose, position_n=pose.position_n + error[:3], q_nc=q)


def observed(camera, pose, points_n):
    return camera.project((points_n - pose.position_n) @ matrix_from_quat(pose.q_nc))[0]


@EACH
@settings(max_examples=25)
@given(st.floats(15.0, 90.0), st.floats(-180.0, 180.0), st.integers(0, 1000))
def test_jacobians_against_differences(camera, down_deg, yaw_deg, seed):
    pose = pose_at(down_deg=down_deg, yaw_deg=yaw_deg)
    rng = np.random.default_rng(seed)
    # 3 points: a transpose would pass unseen with 2
    points_c = np.column_stack([rng.uniform(-0.3, 0.3, (3, 2)), np.ones(3)])
    points_c *= rng.uniform(5, 80, (3, 1))
    points_n = pose.position_n + points_c @ matrix_from_quat(pose.q_nc).T
    by_pose, by_point = pixel_jacobian(camera, pose, points_n)
    step = 1e-5
    for k, turn in enumerate(step * np.eye(6)):
        ends = [observed(camera, moved(pose, sign * turn), points_n) for sign in (1, -1)]
        # third derivatives below 1e4 px leave 1e-6, rounding 1e3 px * 1e-16 / 1e-5 leaves 1e-8
        assert by_pose[:, :, k] == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-5)
    for k, shift in enumerate(step * np.eye(3)):
        ends = [observed(camera, pose, points_n + sign * shift) for sign in (1, -1)]
        assert by_point[:, :, k] == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-5)


def drawn_pixels(camera, pose, point_n, config, rates, count, rng):
    """Return pixels (count, 2) of a point with random errors of pose, time, lens and map."""
    pose_error = rng.multivariate_normal(np.zeros(6), pose.covariance, count)
    late_s = rng.normal(0, config.latency_sigma_s, (count, 1))
    sigma = [config.map_sigma_m, config.map_sigma_m, config.ground_sigma_m]
    point = point_n + rng.normal(size=(count, 3)) * sigma
    turned = matrix_from_rotvec(pose_error[:, 3:]) @ matrix_from_rotvec(rates.rate_n * late_s)
    rotation = turned @ matrix_from_quat(pose.q_nc)
    offset = point - (pose.position_n + rates.velocity_n * late_s + pose_error[:, :3])
    uv, _ = camera.project(np.einsum("nji,nj->ni", rotation, offset))
    centre, longer = [camera.cx, camera.cy], rng.normal(1, config.focal_sigma, (count, 1))
    return centre + longer * (uv - centre) + rng.normal(0, config.lens_sigma_px, (count, 2))


def share_inside(uv, middle, covariance):
    """Return the share of true pixels in the 95 % ellipse; nan pixels count as outside."""
    off = uv - middle
    return np.mean(np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off) <= CHI2_95)


STILL = CameraRates(np.zeros(3), np.zeros(3))
TURNING = CameraRates(np.array([4.0, -3.0, 0.0]), np.radians([2.0, -3.0, 20.0]))
PLACES = ((20.0, 30.0), (20.0, 90.0), (100.0, 60.0), (5.0, 45.0))
COUNT = 10_000  # one standard deviation of a share of 95 % is 0.2 %


@EACH
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("rates", [STILL, TURNING], ids=["still", "turning"])
def test_95_percent_of_true_places_are_inside(camera, place, rates):
    """The middle of the picture, its top, its corner; the requirement is 93 to 97 %."""
    config = ConfidenceConfig(latency_sigma_s=0.02, focal_sigma=0.02)
    position_m = 0.02 * place[0]
    rng = np.random.default_rng(7)
    columns = np.array([0.5, 0.45, 0.9, 0.1]) * camera.width
    rows = np.array([0.5, 0.05, 0.9, 0.8]) * camera.height
    shown = 0
    for seed, uv in enumerate(np.column_stack([columns, rows])):
        pose = pose_at(*place, some_covariance(position_m, 0.4, seed))
        point_n = ground_at(camera, pose, uv[None])
        if np.isnan(point_n).any():
            continue  # a wide lens sees the sky there
        shown += 1
        covariance, linear = screen_covariance(camera, pose, point_n, config, rates)
        true = drawn_pixels(camera, pose, point_n, config, rates, COUNT, rng)
        assert linear[0]
        assert 0.93 <= share_inside(true, uv, covariance[0]) <= 0.97
    assert shown >= 3


def test_linear_is_true_only_where_first_order_is_enough():
    """Errors have all sizes; where ``linear`` is True, 93 to 97 % are inside."""
    rng = np.random.default_rng(11)
    shares, refused = [], 0
    for seed in range(200):
        camera = list(CAMERAS.values())[seed % 4]
        size = 10 ** rng.uniform(-1, 1)
        place = (20.0, rng.uniform(25, 90))
        pose = pose_at(*place, some_covariance(0.3 * size, 0.5 * size, seed))
        uv = rng.uniform(0.1, 0.9, 2) * [camera.width, camera.height]
        point_n = ground_at(camera, pose, uv[None])
        if np.isnan(point_n).any():
            continue
        covariance, linear = screen_covariance(camera, pose, point_n, EXACT)
        true = drawn_pixels(camera, pose, point_n, EXACT, STILL, 4000, rng)
        if linear[0]:
            shares.append(share_inside(true, uv, covariance[0]))
        else:
            refused += 1
    # 0.3 % is one standard deviation of a share among 4000
    assert min(shares) >= 0.93 - 0.003
    assert max(shares) <= 0.97 + 0.003
    assert len(shares) > 100
    assert refused > 10


@pytest.mark.parametrize("count", [1, 3, 2500, 2501, 6000])
def test_many_points_agree_with_their_jacobians(count):
    pose = pose_at(covariance=some_covariance())
    rng = np.random.default_rng(count)
    points_n = ground_at(XT2, pose, rng.uniform(0, 1, (count, 2)) * [639, 511])
    sigma_m = rng.choice([0.05, 1.0, math.nan], count)
    config = ConfidenceConfig()
    together, _ = screen_covariance(XT2, pose, points_n, config, TURNING, sigma_m)
    radius = radius_95(together[:, [0, 0, 1], [0, 1, 1]].T)
    np.testing.assert_allclose(radius, ellipse_95(together)[0][:, 0], rtol=1e-11)
    by_pose, by_point = pixel_jacobian(XT2, pose, points_n)
    spread = np.zeros((count, 3, 3))
    level = np.where(np.isnan(sigma_m), config.map_sigma_m, sigma_m) ** 2
    spread[:, 0, 0] = spread[:, 1, 1] = level
    spread[:, 2, 2] = config.ground_sigma_m**2
    timed = timed_covariance(pose, TURNING, config.latency_sigma_s)
    expected = by_pose @ timed @ by_pose.transpose(0, 2, 1)
    expected += by_point @ spread @ by_point.transpose(0, 2, 1)
    expected += config.lens_sigma_px**2 * np.eye(2)
    np.testing.assert_allclose(together, expected, rtol=1e-8, atol=1e-9)


def test_an_impossible_covariance_gives_no_ellipse():
    wrong = np.diag([1.0, 1.0, 1.0, 1e-4, 1e-4, -1e-4])
    tangled = np.diag([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4])
    tangled[0, 3] = tangled[3, 0] = 0.02  # a correlation of 2
    for covariance in (wrong, tangled):
        pose = pose_at(covariance=covariance)
        point_n = ground_at(XT2, pose, [[320.0, 256.0]])
        result, linear = screen_covariance(XT2, pose, point_n, ConfidenceConfig())
        assert np.isnan(result).all()
        assert not linear.any()


@given(st.floats(0.1, 50), st.floats(0.1, 50), st.floats(-1.5, 1.5))
def test_ellipses_of_known_axes(a, b, angle):
    major, minor = max(a, b), min(a, b)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    covariance = turn @ np.diag([major**2, minor**2]) @ turn.T
    semi, result = ellipse_95(covariance)
    # the minor axis is a difference of squares up to 500 apart
    assert semi[0] == pytest.approx(np.sqrt(5.991465) * np.array([major, minor]), rel=1e-6)
    if major > 1.01 * minor:
        assert math.sin(result[0] - angle) == pytest.approx(0, abs=1e-9)
