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
"""Polynomials through control points: exact for exact points, else as good as their noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tirgeo_ros.core.calibration.polynomial_transform import TERMS, fit_polynomial
from tirgeo_ros.core.types.errors import CalibrationError

SIZE_PX = np.array([9000.0, 7000.0])
GSD_M = 0.0215  # the paper's orthophoto
CORNER_M = np.array([457_000.0, 4_410_000.0])  # a UTM plane's large numbers


def warped(pixels, order, seed=0):
    """Return places in metres: turned, scaled, and bent by tens of pixels if the order allows."""
    rng = np.random.default_rng(seed)
    u, v = ((pixels / SIZE_PX - 0.5) * 2).T
    turn = rng.uniform(0, 2 * np.pi)
    x, y = (pixels * [1, -1] * GSD_M).T
    plane = np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], 1)
    bends = {2: (u * u, u * v, v * v), 3: (u**3, u * u * v, u * v * v, v**3)}
    for power in range(2, order + 1):
        for bend in bends[power]:
            plane += bend[:, None] * rng.normal(0, 20 * GSD_M, 2)
    return plane + CORNER_M


def spread(number, seed=1):
    return np.random.default_rng(seed).uniform(0.03, 0.97, (number, 2)) * SIZE_PX


@settings(max_examples=40, deadline=None)
@given(order=st.sampled_from([1, 2, 3]), seed=st.integers(0, 1000))
def test_what_is_a_polynomial_is_found_exactly(order, seed):
    pixels, others = spread(25, seed), spread(300, seed + 1) * 1.3 - 0.15 * SIZE_PX
    result, residuals = fit_polynomial(pixels, warped(pixels, order, seed), order)
    # Numbers of 4e6 m hold 9e-10 m.
    np.testing.assert_allclose(result(others), warped(others, order, seed), rtol=0, atol=1e-6)
    assert residuals.lengths_m.max() < 1e-7


@pytest.mark.parametrize("order", TERMS)
def test_the_jacobian_against_differences(order):
    pixels = spread(30)
    result, _ = fit_polynomial(pixels, warped(pixels, order), order)
    h = 1.0
    for axis in (0, 1):
        step = h * np.eye(2)[axis]
        slopes = (result(pixels + step) - result(pixels - step)) / (2 * h)
        # The third derivative of a bend of 20 px over 3500 px moves them by 1e-10 px.
        np.testing.assert_allclose(result.jacobian(pixels)[:, :, axis], slopes, atol=1e-8)


def test_noise_gives_the_residuals_and_errors_that_statistics_expect():
    """300 fits of 20 points with noise of 3 px, as the paper has them."""
    rng = np.random.default_rng(2)
    sigma_m, pixels, checks = 3 * GSD_M, spread(20), spread(50, 9)
    true, true_checks = warped(pixels, 3), warped(checks, 3)
    squares, sigmas, misses, left_out = [], [], [], []
    for _ in range(300):
        noisy = true + rng.normal(0, sigma_m, true.shape)
        result, residuals = fit_polynomial(pixels, noisy, 3)
        squares.append((residuals.metres**2).sum())
        sigmas.append(residuals.sigma_m**2)
        misses.append((result(checks) - true_checks) ** 2)
        left_out.append(residuals.left_out_m**2)
    # 300 x 20 degrees of freedom: 1.8 % in a variance, 4 sigma of it.
    assert np.mean(squares) == pytest.approx((20 - 10) * 2 * sigma_m**2, rel=0.075)
    assert np.mean(sigmas) == pytest.approx(sigma_m**2, rel=0.075)
    # The errors of points that were not used are the leverage times the noise.
    ratio = np.mean(misses, axis=(0, 2)) / (result.leverage(checks) * sigma_m**2)
    assert ratio.mean() == pytest.approx(1, abs=0.1)
    # A left-out point has its own noise and the fit's: 1 / (1 - leverage) times the variance.
    wanted = 2 * sigma_m**2 / (1 - result.leverage(pixels))
    assert (np.mean(left_out, axis=0) / wanted).mean() == pytest.approx(1, abs=0.1)


def test_left_out_is_what_a_fit_without_the_point_gives():
    pixels = spread(14)
    plane = warped(pixels, 3) + np.random.default_rng(3).normal(0, 0.1, (14, 2))
    _, residuals = fit_polynomial(pixels, plane, 3)
    for k in range(14):
        rest = np.arange(14) != k
        result, _ = fit_polynomial(pixels[rest], plane[rest], 3)
        miss = np.hypot(*(plane[k] - result(pixels[k : k + 1])[0]))
        assert residuals.left_out_m[k] == pytest.approx(miss, rel=1e-6)


#: A wobbly line, and a circle.
LINE = np.linspace(0, SIZE_PX, 20) + np.random.default_rng(4).normal(0, 0.5, (20, 2))
TURN = np.linspace(0, 2 * np.pi, 20, endpoint=False)
CIRCLE = SIZE_PX / 2 + 3000 * np.stack([np.cos(TURN), np.sin(TURN)], 1)


@pytest.mark.parametrize(
    ("pixels", "order"),
    [
        (LINE, 1),
        (LINE, 3),
        (CIRCLE, 2),
        (np.repeat(spread(4), 5, axis=0), 2),
        (np.ones((5, 2)), 1),
    ],
    ids=["line", "line cubic", "circle", "four places", "one place"],
)
def test_points_that_determine_nothing(pixels, order):
    with pytest.raises(CalibrationError, match=f"order {order} is not determined; spread them"):
        fit_polynomial(pixels, warped(pixels, 1), order)


def test_the_hull():
    pixels = np.array([[0.0, 0], [100, 0], [100, 50], [0, 50], [50, 25], [20, 10]])
    result, _ = fit_polynomial(pixels, warped(pixels, 1), 1)
    asked = np.array([[50.0, 49], [0, 0], [100, 25], [50, 51], [-1, 20], [101, 51], [1e6, 1e6]])
    assert result.inside(asked).tolist() == [True, True, True, False, False, False, False]


def test_a_cubic_folds_far_outside():
    pixels = spread(20) * 0.2
    plane = warped(pixels, 3) + np.random.default_rng(5).normal(0, 0.3, (20, 2))
    result, _ = fit_polynomial(pixels, plane, 3)
    assert not result.folded(pixels).any()
    far = spread(400, 6) * 30 - 15 * SIZE_PX
    assert result.folded(far).any()
