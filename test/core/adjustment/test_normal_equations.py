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
"""Derivatives, the elimination of points and the prior of a bundle adjustment."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import PLANE
from tied_flights import GROUND_M, Course, tied_truth

from tirgeo_ros.core.adjustment.normal_equations import Noise, prior, reduced
from tirgeo_ros.core.adjustment.tie_fit import PRIOR_SIGMA
from tirgeo_ros.core.adjustment.tied_views import TiedFlight

TRUTH = tied_truth((Course(leg_m=30, strips=2, pitch_deg=-70),), points=60, most_sightings=3)
TAUS = np.repeat([60.0, 5.0], 3)
SURVEYED = np.arange(-3, 0) + len(TRUTH.points_n)
FLIGHT = TiedFlight(
    *(TRUTH.views, TRUTH.tracks, PRIOR_SIGMA, PLANE, GROUND_M, np.zeros(8)),
    surveyed_n=TRUTH.points_n[SURVEYED],
)


def state(seed=1):
    """Return points, and x without corrections of the set-up whose slopes are those at none."""
    rng = np.random.default_rng(seed)
    x = rng.normal(0, 0.2, 8 + 6 * len(TRUTH.views))
    x[[0, 1, 2, 3, 4, 6]] = 0.0
    return x, TRUTH.points_n + rng.normal(0, 0.3, TRUTH.points_n.shape)


@pytest.mark.parametrize("k", range(17))
def test_residuals_move_as_differences_say(k):
    x, points_n = state()
    move, turn = np.zeros(len(x)), np.zeros(3)
    if k < 14:
        move[k if k < 8 else slice(k, None, 6)] = 1e-4
    else:
        turn[k - 14] = 1e-4
    less, more = (FLIGHT.linearised(x + s * move, points_n + s * turn)[0] for s in (-1, 1))
    _, slopes = FLIGHT.linearised(x, points_n)
    expected = (less - more) / 2e-4
    # Poses that are off by 0.2 sigma, 0.03 deg, change a slope by less than 0.1 %.
    assert np.allclose(slopes[:, :, k], expected, atol=2e-3 * np.abs(expected).max())


def test_without_points_the_solution_is_that_with_them():
    (residual, slopes), count = FLIGHT.linearised(*state()), len(TRUTH.tracks.uv)
    points = len(TRUTH.points_n)
    weights = np.random.default_rng(2).uniform(0.5, 2.0, len(residual))
    picture = np.concatenate([TRUTH.tracks.picture, np.zeros(points + len(SURVEYED), int)])
    point = np.concatenate([TRUTH.tracks.point, np.arange(points), SURVEYED])
    size = 8 + 6 * len(TRUTH.views)
    normal = reduced(residual, slopes, weights, picture, point, size)

    design = np.zeros((len(residual), 2, size + 3 * points))
    for row, (k, m) in enumerate(zip(picture, point, strict=True)):
        columns = [
            *range(8),
            *range(8 + 6 * k, 14 + 6 * k),
            *range(size + 3 * m, size + 3 * m + 3),
        ]
        design[row][:, columns] = slopes[row]
    design = (design * np.sqrt(weights)[:, None, None]).reshape(2 * len(residual), -1)
    whole = np.linalg.inv(design.T @ design + np.diag(np.arange(design.shape[1]) < size))
    expected = whole @ design.T @ (residual * np.sqrt(weights)[:, None]).ravel()

    total = normal.information + np.eye(size)
    step = np.linalg.solve(total, normal.gradient)
    assert count < len(residual)
    assert np.allclose(step, expected[:size], atol=1e-5)
    assert np.allclose(normal.point_step(step).ravel(), expected[size:], atol=1e-4)
    assert np.allclose(np.linalg.inv(total), whole[:size, :size], atol=1e-5)


def test_the_prior_is_that_of_a_gauss_markov_process():
    times = np.array([0.0, 1.0, 1.5, 9.0])
    noise = Noise(0.7, 2.0, TAUS)
    information, log_determinant = prior(times, noise)
    covariance = np.linalg.inv(information)
    assert np.allclose(covariance[:8, :8], np.eye(8))
    apart = np.abs(times[:, None] - times)
    assert np.allclose(covariance[8::6, 8::6], np.exp(-apart / 60))
    assert np.allclose(covariance[13::6, 13::6], 4 * np.exp(-apart / 5))
    assert log_determinant == pytest.approx(np.linalg.slogdet(information)[1])


def test_pictures_of_one_instant_have_one_error():
    covariance = np.linalg.inv(prior(np.zeros(3), Noise(0.7, 1.0, TAUS))[0])
    assert covariance[8, 14] == pytest.approx(1.0, abs=1e-5)
