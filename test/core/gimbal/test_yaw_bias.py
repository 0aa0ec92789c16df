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
"""The bias of the gimbal's north: its measurements, its estimate, refusals and variance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tirgeo_ros.core.config import NorthConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_euler, quat_from_matrix
from tirgeo_ros.core.gimbal.yaw_bias import SteadyMean, YawBiasFilter, YawBiasMeasurements
from tirgeo_ros.core.types.verdicts import Outcome

S = 1_000_000_000
NOISE = math.radians(0.2) ** 2


def seconds(count, start_s=0):
    return range(start_s * S, (start_s + count) * S, S)


def fed(readings_rad, config=None, *, centred=True):
    """Return the filter after one reading a second, and the outcome of each."""
    north = YawBiasFilter(config or NorthConfig())
    stamps = seconds(len(readings_rad))
    outcomes = [
        north.take(stamp, reading, NOISE, centred=centred)
        for stamp, reading in zip(stamps, readings_rad, strict=True)
    ]
    return north, outcomes


@pytest.mark.parametrize("centred", [True, False])
def test_many_readings_are_the_least_squares_solution(centred):
    """Without a walk P = (P0^-1 + n h h^T / R)^-1 and x = P (P0^-1 x0 + h sum z / R)."""
    config = NorthConfig(bias_deg=1.0, walk_deg=0.0)
    readings = np.radians(np.random.default_rng(3).normal(2.0, 0.2, 40))
    north, _ = fed(readings, config, centred=centred)
    prior = np.linalg.inv(np.diag(np.radians([3.0, 0.3]) ** 2))
    h = np.array([1.0, float(centred)])
    posterior = np.linalg.inv(prior + len(readings) * np.outer(h, h) / NOISE)
    state = posterior @ (prior @ np.radians([1.0, 0.0]) + h * sum(readings) / NOISE)
    # forty updates on numbers of 1e-3 and below
    assert north.bias_rad == pytest.approx(state[0], abs=1e-12)
    assert north.variance == pytest.approx(posterior[0, 0], rel=1e-9)


def test_a_clock_that_is_set_propagates_an_hour_at_most():
    north = YawBiasFilter(NorthConfig(sigma_deg=0.5))
    north.advance(0)
    north.advance(1_700_000_000 * S)
    assert math.degrees(math.sqrt(north.variance)) == pytest.approx(math.hypot(0.5, 0.03 * 60))
    north.advance(0)
    assert math.degrees(math.sqrt(north.variance)) == pytest.approx(math.hypot(0.5, 0.03 * 60))


def test_one_wrong_reading_raises_the_variance_only_until_the_next():
    north, _ = fed([0.0] * 30)
    before = north.bias_rad, north.variance
    assert north.take(30 * S, math.radians(8.0), NOISE, centred=True) is Outcome.GATED
    assert north.bias_rad == before[0]
    assert math.degrees(math.sqrt(north.variance)) > 8.0  # it may have stepped
    assert north.take(31 * S, 0.0, NOISE, centred=True) is Outcome.USED
    # two seconds of walk, 0.04 deg, and a reading of 0.2 deg change a sigma of 0.3 by a hundredth
    assert math.sqrt(north.variance) == pytest.approx(math.sqrt(before[1]), rel=0.02)
    assert (north.updates, north.refused, north.resets) == (31, 1, 0)


@pytest.mark.parametrize("step_deg", [4.0, -20.0, 170.0])
def test_a_step_is_followed_after_reset_after_s(step_deg):
    north, _ = fed([0.0] * 30)
    outcomes = []
    for stamp in seconds(7, 30):
        outcomes.append(north.take(stamp, math.radians(step_deg), NOISE, centred=True))
        error = math.remainder(math.radians(step_deg) - north.bias_rad, math.tau)
        # doubted from the first reading on, but for an angle that hardly can be any larger
        assert abs(error) < 3 * math.sqrt(north.variance)
    assert outcomes == [Outcome.GATED] * 5 + [Outcome.RESET, Outcome.USED]
    assert math.degrees(north.bias_rad) == pytest.approx(step_deg, abs=1e-6)
    assert (north.refused, north.resets) == (6, 1)


@given(st.floats(-math.pi, math.pi), st.lists(st.integers(-2, 2), min_size=1, max_size=12))
def test_readings_are_angles(reading, turns):
    config = NorthConfig(bias_deg=170.0, sigma_deg=10.0)
    plain, first = fed([reading] * len(turns), config)
    turned, second = fed([reading + math.tau * k for k in turns], config)
    assert first == second
    # a turn more is 6e-16 of rounding for each of the twelve
    difference = math.remainder(plain.bias_rad - turned.bias_rad, math.tau)
    assert difference == pytest.approx(0.0, abs=1e-13)


steps = st.tuples(
    st.one_of(st.integers(-5, 40), st.just(10**9)),  # seconds since the one before
    st.one_of(st.floats(-10, 10), st.just(math.nan), st.just(math.inf)),
    st.one_of(st.floats(1e-9, 1.0), st.sampled_from([0.0, -1.0, math.nan, math.inf])),
    st.booleans(),
)


@given(st.lists(steps, max_size=40), st.floats(0, 100), st.floats(0, 10), st.floats(0, 90))
def test_any_readings_leave_a_finite_estimate(readings, sigma_deg, walk_deg, centre_deg):
    north = YawBiasFilter(
        NorthConfig(sigma_deg=sigma_deg, walk_deg=walk_deg, centred_sigma_deg=centre_deg)
    )
    stamp_s, sound = 0, 0
    for elapsed_s, reading, variance, centred in readings:
        stamp_s += elapsed_s
        outcome = north.take(stamp_s * S, reading, variance, centred=centred)
        sound += outcome is not Outcome.INVALID
        assert -math.pi <= north.bias_rad <= math.pi
        # rounding: a covariance of 3 rad2 loses 1e-15 of itself in each of forty updates
        assert -1e-13 < north.variance <= math.pi**2 / 3
    assert north.updates + north.refused == sound + north.resets


def test_error_over_sigma_in_every_phase():
    """Prior, readings, silence, joints: 200 seeds; their rms has a sigma of 1 / sqrt(400)."""
    config = NorthConfig(sigma_deg=3.0, walk_deg=0.03, centred_sigma_deg=0.3)
    ratios = np.array([_phases(config, seed) for seed in range(200)])
    rms = np.sqrt(np.mean(ratios**2, axis=0))
    assert rms.shape == (5,)
    assert np.all(rms > 0.7), rms
    assert np.all(rms < 1.3), rms
    np.testing.assert_allclose(rms, 1.0, atol=4 / math.sqrt(400))


def _phases(config, seed):
    """Error over sigma at the end of each phase of a simulated bias."""
    rng = np.random.default_rng(seed)
    bias_deg = rng.normal(0.0, config.sigma_deg)
    centre_deg = rng.normal(0.0, config.centred_sigma_deg)
    north = YawBiasFilter(config)
    north.advance(0)
    result, t_s = [], 0
    for kind, count in (("none", 100), ("centred", 3), ("centred", 60), ("none", 200), ("j", 20)):
        for _ in range(count):
            t_s += 1
            bias_deg += rng.normal(0.0, config.walk_deg)
            north.advance(t_s * S)
            if kind != "none":
                shown = bias_deg + (centre_deg if kind == "centred" else 0.0)
                reading = math.radians(shown + rng.normal(0.0, 0.2))
                north.take(t_s * S, reading, NOISE, centred=kind == "centred")
        error = math.remainder(math.radians(bias_deg) - north.bias_rad, math.tau)
        result.append(error / math.sqrt(north.variance))
    return result


MS = 1_000_000
PERIOD_MS = 50
CENTRED = NorthConfig(centred=True)
headings = st.floats(-3.1, 3.1)
biases = st.floats(-0.6, 0.6)


def read(nose, bias, *, seconds=10.0, config=CENTRED, lag_s=0.0, joints=False, pitch=-0.5):
    """The filter after a flight with the nose's heading ``nose(t_s)`` and a lagging gimbal."""
    north, readings = YawBiasFilter(config), YawBiasMeasurements(config, 0.0)
    camera = nose(0.0)
    for t_ms in range(0, round(seconds * 1e3) + 1, PERIOD_MS):
        t_s = 1e-3 * t_ms
        gain = 1 - math.exp(-1e-3 * PERIOD_MS / lag_s) if lag_s else 1.0
        camera += gain * (nose(t_s) - camera)
        q_nb = quat_from_euler(0.03, -0.05, nose(t_s))
        q_ng = quat_from_euler(0.0, pitch, camera + bias)
        q_bg = None
        if joints:
            level = matrix_from_quat(quat_from_euler(0.0, pitch, camera))
            q_bg = quat_from_matrix(matrix_from_quat(q_nb).T @ level)
        readings.read(north, t_ms * MS, q_ng, q_nb, q_bg)
    return north


@settings(max_examples=15)  # each a flight
@given(headings, biases, st.floats(-math.pi / 2, 0.3))
def test_a_still_centred_gimbal_shows_the_bias(yaw, bias, pitch):
    config = NorthConfig(centred=True, sigma_deg=60.0, centred_sigma_deg=0.0)
    north = read(lambda _t: yaw, bias, seconds=6.0, config=config, pitch=pitch)
    assert north.updates == 2  # three seconds to settle, then one each second but for a sample
    # the prior of 60 deg pulls with (0.2 / 60)^2 / 2
    assert north.bias_rad == pytest.approx(bias, abs=1e-5)


@pytest.mark.parametrize("rate_deg_s", [1.0, -10.0, 60.0])
def test_nothing_is_read_while_the_nose_turns(rate_deg_s):
    north = read(lambda t: math.radians(rate_deg_s) * t, 0.1, seconds=30.0, lag_s=0.35)
    assert north.updates + north.refused == 0


def test_the_lag_of_a_turn_is_waited_for():
    def nose(t_s):
        return math.radians(40.0) * min(t_s, 3.0)

    north = read(nose, 0.1, seconds=7.5, lag_s=0.5)
    assert north.updates == 1  # three seconds of turn, three to settle, one to average
    # of the 20 deg of lag exp(-3 / 0.5) is left, 0.05 deg, and the prior's part of 0.1 rad
    prior_part = 0.1 * (0.3**2 + 0.2**2) / 3.0**2
    assert north.bias_rad == pytest.approx(0.1, abs=math.radians(0.05) + prior_part)


def test_joints_show_the_bias_without_the_gimbal_being_centred_and_looking_down():
    config = NorthConfig()
    for pitch in (-0.5, -math.pi / 2):
        north = read(lambda _t: 0.4, 0.1, seconds=3.1, config=config, joints=True, pitch=pitch)
        assert north.updates == 3
        prior_part = 0.1 * (0.2**2 / 3) / 3.0**2
        assert north.bias_rad == pytest.approx(0.1, abs=2 * prior_part)


def test_a_gap_or_a_clock_that_goes_back_begins_anew():
    mean = SteadyMean(0.0)
    assert mean.add(0, 0.0, 0.1) is None
    assert mean.add(900 * MS, 0.0, 0.1) is None
    assert mean.add(2600 * MS, 0.0, 0.1) is None  # after 1.7 s
    assert mean.add(3500 * MS, 0.0, 0.1) is None
    assert mean.add(0, 0.0, 0.1) is None  # back
    assert mean.add(1000 * MS, 0.0, 0.1) == pytest.approx(0.1)
