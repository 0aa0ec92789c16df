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
"""The budget's closed forms and covariance are one derivative; Equation 24 and its means."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.core.accuracy.ground_errors import (
    GroundErrors,
    GroundView,
    looking,
    paper_ground_offset,
    paper_heading_error_m,
    paper_height_error_m,
    paper_position_error_m,
    pixel_grid,
    rms_m,
)
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2

F = 800.0
PINHOLE = Camera(640, 512, F, F, 319.5, 255.5)
UV = pixel_grid(PINHOLE, 16)[0]
RIGHT, DOWN = UV[:, 0] - PINHOLE.cx, UV[:, 1] - PINHOLE.cy
#: The whole picture looks at the ground: half of it spans 17.7 deg.
depressions = st.floats(math.radians(20), math.radians(70))
headings = st.floats(-math.pi, math.pi)
heights = st.floats(1.0, 500.0)


@given(depressions, headings, heights)
def test_equation_15_is_the_rotation_matrix_form(depression, heading, height):
    """With alpha from the nadir, x to the west, x_im to the right and y_im up."""
    view = GroundView.of(PINHOLE, looking(depression, heading), height, UV)
    alpha = math.pi / 2 - depression
    west, north = paper_ground_offset(RIGHT, -DOWN, F, alpha, heading, height)
    scale = np.abs(view.points_n).max()
    np.testing.assert_allclose(-west, view.points_n[:, 1], atol=1e-9 * scale)
    np.testing.assert_allclose(north, view.points_n[:, 0], atol=1e-9 * scale)


@given(depressions, headings, heights)
def test_equations_19_and_21_are_derivatives_of_the_rotation_matrix_form(
    depression, heading, height
):
    view = GroundView.of(PINHOLE, looking(depression, heading), height, UV)
    by_height, by_heading = np.zeros((6, 6)), np.zeros((6, 6))
    by_height[2, 2], by_heading[5, 5] = 2.8017**2, 0.03**2
    result = rms_m(view.covariance(by_height))
    paper = paper_height_error_m(RIGHT, DOWN, F, depression, 2.8017)
    np.testing.assert_allclose(result, paper, rtol=1e-9)
    result = rms_m(view.covariance(by_heading))
    paper = paper_heading_error_m(RIGHT, DOWN, F, depression, height, 0.03)
    np.testing.assert_allclose(result, paper, rtol=1e-9)


@given(headings)
def test_equation_17(heading):
    view = GroundView.of(PINHOLE, looking(0.5, heading), 20.0, UV)
    covariance = np.zeros((6, 6))
    covariance[0, 0], covariance[1, 1] = 0.9342**2, 1.2846**2
    paper = paper_position_error_m(1.2846, 0.9342)
    assert paper == pytest.approx(1.5884, abs=5e-5)  # as printed in Table 2
    np.testing.assert_allclose(rms_m(view.covariance(covariance)), paper, rtol=1e-12)


def test_table_2_with_the_focal_length_of_table_9():
    """Within 4 %: which principal point and mean the authors took is not said."""
    uv, _ = pixel_grid(XT2, 1)
    f, depression = (XT2.fx + XT2.fy) / 2, math.radians(30)
    x_im, y_im = uv[:, 0] - XT2.cx, uv[:, 1] - XT2.cy
    height = paper_height_error_m(x_im, y_im, f, depression, 2.8017).mean()
    heading = paper_heading_error_m(x_im, y_im, f, depression, 20.0, math.radians(1.7972)).mean()
    assert height == pytest.approx(5.6036, rel=0.04)
    assert heading == pytest.approx(1.2497, rel=0.04)
    assert math.hypot(1.5884, 5.6036) == pytest.approx(5.8243, abs=1e-3)  # of its means


#: Standard deviations of a filter's poses at which first order holds: position m, phi rad.
SIGMA = np.array([0.3, 0.2, 0.25, 0.004, 0.005, 0.012])


def correlated(rng):
    """A covariance (6, 6) with those standard deviations."""
    factor = rng.standard_normal((6, 6)) + 2 * np.eye(6)
    covariance = factor @ factor.T
    sigma = np.sqrt(np.diag(covariance))
    return covariance * np.outer(SIGMA / sigma, SIGMA / sigma)


@pytest.mark.slow
@pytest.mark.parametrize(("depression_deg", "heading_deg"), [(30, 0), (35, 137), (90, 20)])
def test_the_whole_covariance_against_monte_carlo(depression_deg, heading_deg):
    """Within 3 % at every pixel: 20000 draws tell an rms to 0.5 %, so 3 % is 6 sigma."""
    rng = np.random.default_rng(depression_deg)
    covariance, rates = correlated(rng), np.array([2.0, -2.0, 0.5, 0.02, 0.0, 0.3])
    rotation_nc = looking(math.radians(depression_deg), math.radians(heading_deg))
    uv, _ = pixel_grid(XT2, 64)
    others = {"lens_sigma_px": 0.7, "ground_sigma_m": 0.2, "latency_sigma_s": 0.02}
    others["focal_sigma"] = 0.01
    view = GroundView.of(XT2, rotation_nc, 20.0, uv)
    reports = rms_m(view.covariance(covariance, rates=rates, **others))
    draws = 20000
    errors = rng.multivariate_normal(np.zeros(6), covariance, draws)
    errors += 0.02 * rng.standard_normal((draws, 1)) * rates
    errors[:, 2] += 0.2 * rng.standard_normal(draws)
    for k, (pixel, expected) in enumerate(zip(uv, reports, strict=True)):
        radial = 0.01 * rng.standard_normal((draws, 1)) * (pixel - [XT2.cx, XT2.cy])
        rays_c = XT2.rays(pixel + radial + 0.7 * rng.standard_normal((draws, 2)))
        moved = located(rotation_nc, rays_c, errors, 20.0) - view.points_n[k, :2]
        assert np.sqrt(np.mean(np.sum(moved**2, axis=1))) == pytest.approx(expected, rel=0.03)


def located(rotation_nc, rays_c, errors, height_m):
    """Ground points (N, 2) of a pose with errors (N, 6), each by the whole rotation."""
    rays_n = rays_c @ rotation_nc.T
    angle = np.linalg.norm(errors[:, 3:], axis=1, keepdims=True)
    axis = errors[:, 3:] / angle
    along = np.sum(axis * rays_n, axis=1, keepdims=True) * axis
    turned = along + (rays_n - along) * np.cos(angle) + np.cross(axis, rays_n) * np.sin(angle)
    way = (height_m - errors[:, 2]) / turned[:, 2]
    return errors[:, :2] + way[:, None] * turned[:, :2]


def test_pixels_over_the_horizon_have_no_error():
    view = GroundView.of(XT2, looking(math.radians(10)), 20.0, pixel_grid(XT2, 64)[0])
    upper = view.uv[:, 1] < 60  # 10 deg are 140 px, and the axis is at row 252
    assert np.isnan(rms_m(view.covariance(np.eye(6)))[upper]).all()
    assert np.isfinite(rms_m(view.covariance(np.eye(6)))[view.uv[:, 1] > 200]).all()


def test_equation_24_over_each_point():
    errors = GroundErrors(["B", "A", "A"], np.array([[0.0, 2.0], [3.0, 4.0], [0.0, 1.0]]))
    assert errors.point_rmse_m == {"B": pytest.approx(2), "A": pytest.approx(math.sqrt(13))}
    assert list(errors.point_rmse_m) == ["B", "A"]
    assert errors.mean_point_rmse_m == pytest.approx((math.sqrt(13) + 2) / 2)
    assert errors.rmse_m == pytest.approx(math.sqrt(30 / 3))
    np.testing.assert_allclose(errors.mean_error_en, [1, 7 / 3])


def test_the_circular_error_of_a_known_distribution():
    """Of a round Gaussian it is 2.146 sigma, as the tables of map accuracy say."""
    count, sigma = 40_000, 0.7
    errors = np.random.default_rng(8).normal(scale=sigma, size=(count, 2))
    result = GroundErrors(["P"] * count, errors)
    radius = sigma * math.sqrt(-2 * math.log(0.1))
    # 4 sigma of the quantile: sqrt(0.9 * 0.1 / N) over the density 0.1 * radius / sigma2 there
    slack = 4 * math.sqrt(0.09 / count) * sigma**2 / (0.1 * radius)
    assert result.ce90_m == pytest.approx(radius, abs=slack)


def test_nothing_located_is_no_number():
    errors = GroundErrors([], np.empty((0, 2)))
    assert errors.rmse_m is errors.mean_point_rmse_m is errors.ce90_m is None
    assert errors.mean_error_en is None
    assert errors.point_rmse_m == {}
