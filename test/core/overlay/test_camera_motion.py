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
"""Poses predicted a little beyond the newest one: their position, attitude, covariance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.core.frames.rotations import (
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.overlay.overlay import predicted
from tirgeo_ros.core.types.poses import CameraPose

STEP_S = 0.02
GAP_S = 0.25
SIGMA_M, SIGMA_RAD = 0.01, 0.001
COVARIANCE = np.diag(np.repeat([SIGMA_M, SIGMA_RAD], 3) ** 2)
rates = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)


def pose_of(time_s, position_n, q_nc):
    return CameraPose(round(time_s * 1e9), np.asarray(position_n, float), q_nc, COVARIANCE)


def moving(times_s, velocity_n, rate_n, q_nc):
    return [
        pose_of(t, np.asarray(velocity_n) * t, quat_multiply(quat_from_rotvec(rate_n * t), q_nc))
        for t in times_s
    ]


def error_of(pose, truth):
    turn = quat_multiply(truth.q_nc, quat_conjugate(pose.q_nc))
    return np.concatenate([truth.position_n - pose.position_n, rotvec_from_quat(turn)])


@given(rates, rates, rates, st.floats(0.001, 0.2), st.sampled_from([0.005, 0.02, 0.1]))
def test_steady_motion_goes_on(velocity_n, rate_n, rotvec, ahead_s, step_s):
    q_nc = quat_from_rotvec(rotvec)
    poses = moving(np.arange(0, 1.21, step_s), velocity_n, rate_n, q_nc)
    time_s = poses[-1].stamp_ns * 1e-9 + ahead_s
    result = predicted(poses, round(time_s * 1e9), GAP_S)
    assert isinstance(result, CameraPose)
    assert result.stamp_ns == round(time_s * 1e9)
    truth = moving([result.stamp_ns * 1e-9], velocity_n, rate_n, q_nc)[0]
    # slopes of sums near 1 over a tenth of a second, and 2 atan2 near zero: root of epsilon
    assert np.abs(error_of(result, truth)).max() < 1e-7


def wandering(rng, number):
    """True poses of a camera that accelerates at random, and the same with the poses' noise."""
    steps = rng.normal(0, 1, (number, 6)) * np.repeat([2.0, 0.8], 3) * STEP_S
    smooth = np.array([np.convolve(each, np.ones(15) / 15**0.5, "same") for each in steps.T]).T
    rates = smooth.cumsum(axis=0)
    places = rates.cumsum(axis=0) * STEP_S
    q = [quat_from_rotvec(place[3:] * 0.5) for place in places]
    truth = [pose_of(i * STEP_S, places[i, :3], q[i]) for i in range(number)]
    noise = rng.normal(0, 1, (number, 6)) @ np.sqrt(COVARIANCE)
    observed = [
        pose_of(
            i * STEP_S,
            places[i, :3] + noise[i, :3],
            quat_multiply(quat_from_rotvec(noise[i, 3:]), q[i]),
        )
        for i in range(number)
    ]
    return truth, observed


@pytest.mark.slow
@pytest.mark.parametrize("steps_ahead", [1, 3, 5])
def test_the_covariance_agrees_with_the_errors(steps_ahead):
    """Mean squared error over variance of each of six axes, over 300 flights.

    One for a covariance that is right. At most 1.3: its expected spread over 1800 errors is 0.03,
    and what a second of trials shows of a flight is itself uncertain by a fifth. At least 0.4: the
    newest pose's own noise is in the trials and in its covariance, and so counts up to twice.
    """
    rng = np.random.default_rng(steps_ahead)
    ratios = []
    for _ in range(300):
        truth, observed = wandering(rng, 61 + steps_ahead)
        met = truth[-1]
        result = predicted(observed[:61], met.stamp_ns, GAP_S)
        ratios.append(error_of(result, met) ** 2 / np.diag(result.covariance))
    assert 0.4 < np.mean(ratios) < 1.3
    assert np.linalg.eigvalsh(result.covariance)[0] > 0
    np.testing.assert_allclose(result.covariance, result.covariance.T, rtol=1e-12)


def test_few_poses_are_trusted_less():
    """With three poses no trial is possible: both ends of the line may be wrong."""
    q_nc = np.array([1.0, 0, 0, 0])
    poses = moving([0, 0.03, 0.06], np.array([3.0, 0, 0]), np.zeros(3), q_nc)
    result = predicted(poses, 160_000_000, GAP_S)
    assert result.position_n[0] == pytest.approx(0.48, abs=1e-9)
    # A slope over 50 ms between two ends of 1 cm each, over 100 ms: 2.83 cm; and the pose's own.
    assert result.covariance[0, 0] >= SIGMA_M**2 * (1 + 2 * 2**2)


def test_poses_before_a_gap_do_not_count():
    """The aircraft turned round meanwhile."""
    q_nc = np.array([1.0, 0, 0, 0])
    before = moving(np.arange(0, 0.5, 0.02), np.array([9.0, 0, 0]), np.zeros(3), q_nc)
    after = moving(np.arange(2, 2.2, 0.02), np.array([-3.0, 0, 0]), np.zeros(3), q_nc)
    result = predicted([*before, *after], 2_280_000_000, GAP_S)
    assert result.position_n[0] == pytest.approx(-3 * 2.28, abs=1e-6)
