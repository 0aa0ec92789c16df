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
"""An IMU whose biases are far beyond the turn-on sigmas: the alignment waits for motion."""

from __future__ import annotations

import numpy as np
import pytest
from alignments import aligned, duration_s, error, samples_from, spoilt
from flights import config_for, errors, flight

from tirgeo_ros.core.frames.rotations import flu_from_frd
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases
from tirgeo_ros.core.navigation.alignment.turn_on_bias import surprise
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

#: A consumer's IMU: 3 deg/s, 50 mg.
GYRO_RAD_S, ACCEL_M_S2 = 0.0524, 0.49
KEYS = ("imu.gyro_turn_on_bias", "imu.accel_turn_on_bias")


def estimates(count, truth_scale=1.0):
    """Linear estimates of six biases, two of them hardly observed, with their prior."""
    rng = np.random.default_rng(11)
    sigma = np.repeat([7e-3, 2e-2], 3)
    prior = Biases((0.0,) * 3, (0.0,) * 3, np.diag(sigma**2))
    for _ in range(count):
        design = rng.standard_normal((4, 6)) / sigma
        design[:, 4:] *= 1e-3
        covariance = np.linalg.inv(design.T @ design + np.linalg.inv(prior.covariance))
        truth = truth_scale * sigma * rng.standard_normal(6)
        observed = design @ truth + rng.standard_normal(4)
        yield covariance @ design.T @ observed, covariance, prior


def test_surprise_is_normal_where_the_prior_is_true():
    """Two directions are not observed; counting them would make it smaller."""
    result = np.array([surprise(*estimate) for estimate in estimates(1000)])
    # Four sigma of a mean and of a standard deviation; the cube root is good to some hundredths.
    assert result.mean() == pytest.approx(0.0, abs=4 / np.sqrt(1000) + 0.03)
    assert result.std() == pytest.approx(1.0, abs=4 / np.sqrt(2000) + 0.03)
    assert result.max() < 5.0


def test_biases_ten_times_the_prior_are_beyond_chance():
    result = [surprise(*estimate) > 4.0 for estimate in estimates(300, truth_scale=10.0)]
    # Four directions of ten sigma each: one draw in 100 has less than four in all.
    assert np.mean(result) > 0.9


def biased(samples, gyro_b, accel_b):
    """Samples of an IMU with biases added."""

    def change(s):
        return ImuSample(
            s.stamp_ns, s.specific_force_b + accel_b, s.angular_rate_b + gyro_b, s.autopilot_q_nb
        )

    return spoilt(samples, Source.IMU, change)


def consumer(samples):
    return biased(samples, GYRO_RAD_S * np.array([1, -1, 1]), ACCEL_M_S2 * np.array([-1, 1, 1]))


@pytest.fixture(scope="module")
def resting():
    """Twelve seconds in one place."""
    values = {"route.shape": "hover", "route.hover_s": 12.0, "duration_s": 12.0}
    return fly(scenario_from(values), 3)


def leaning(samples):
    """Biases along x and y alone look like a tilt of 4 deg, which the autopilot does not have."""
    return biased(samples, np.zeros(3), ACCEL_M_S2 * np.array([1, 1, 0]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "use_heading"), [(consumer, True), (consumer, False), (leaning, True)]
)
def test_at_rest_it_waits_and_names_the_parameters(resting, change, use_heading):
    samples = change(samples_from(resting))
    result, aligner = aligned(samples, config_for(resting), use_heading=use_heading)
    assert result is None
    assert "needs motion" in aligner.reason
    assert all(key in aligner.reason for key in KEYS)


def test_larger_turn_on_sigmas_start_at_rest(resting):
    """With an honest sigma: 0.5 m/s2 of gravity are 3 deg."""
    larger = {"imu__gyro_turn_on_bias": GYRO_RAD_S, "imu__accel_turn_on_bias": ACCEL_M_S2}
    samples = consumer(samples_from(resting))
    result, _ = aligned(samples, config_for(resting, **larger))
    assert duration_s(samples, result) < 1.4
    # The biases are one and two of their sigmas, at most two and a half together with tilt.
    assert (np.abs(error(resting, result))[:9] < 3 * np.sqrt(np.diag(result.covariance))[:9]).all()
    assert np.degrees(np.sqrt(result.covariance[0, 0])) > 2.0


def test_biases_learned_in_flight_allow_a_start_at_once(resting):
    """Known biases are no surprise, however large; their disappearance is one."""
    samples = consumer(samples_from(resting))
    sigma = np.repeat([1e-3, 5e-3], 3)
    gyro, accel = GYRO_RAD_S * np.array([1, -1, 1]), ACCEL_M_S2 * np.array([-1, 1, 1])
    prior = Biases(tuple(gyro.tolist()), tuple(accel.tolist()), np.diag(sigma**2))
    expected = config_for(  # by several flights: forward, left, up
        resting,
        imu__gyro_bias=flu_from_frd(gyro).tolist(),
        imu__accel_bias=flu_from_frd(accel).tolist(),
        imu__gyro_turn_on_bias=1e-3,
        imu__accel_turn_on_bias=5e-3,
    )
    for config, known in ((config_for(resting), prior), (expected, None)):
        result, _ = aligned(samples, config, prior=known)
        assert duration_s(samples, result) < 1.4
        tilt = np.degrees(error(resting, result)[:2])
        assert np.abs(tilt).max() < 0.5  # 0.01 m/s2 of the simulated IMU itself are 0.06 deg


@pytest.mark.slow
@pytest.mark.parametrize("use_heading", [True, False])
def test_a_turn_separates_biases_from_tilt(use_heading):
    flown = flight(5, 50.0, "figure_eight")
    samples = consumer(samples_from(flown, 8.3))
    result, _ = aligned(samples, config_for(flown), use_heading=use_heading)
    assert result is not None
    ratio = error(flown, result)[:9] / np.sqrt(np.diag(result.covariance))[:9]
    assert np.abs(ratio).max() < 4.5
    assert np.degrees(np.sqrt(result.covariance[:2, :2].diagonal())).max() <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["lawnmower", "hover", "figure_eight"])
@pytest.mark.parametrize("method", ["ekf_heading", "ekf"])
@pytest.mark.parametrize("seed", [3, 4])
def test_no_pose_is_far_off_with_a_small_sigma(shape, method, seed):
    """From the ground on and from flight on, biases drawn with consumers' sigmas."""
    values = {
        "route.shape": shape,
        "duration_s": 40.0,
        "imu.gyro_turn_on_bias_rad_s": GYRO_RAD_S,
        "imu.accel_turn_on_bias_m_s2": ACCEL_M_S2,
    }
    flown = fly(scenario_from(values), seed)
    for start_s in (0.0, 10.0):
        result, states, reasons = run(flown, method, start_s)
        assert FilterState.LOST not in states
        assert any(all(key in reason for key in KEYS) for reason in reasons)
        wrong = errors(flown, result)
        assert wrong.t_s[-1] > 39.9  # turns have come: it has started, and goes on
        attitude = np.abs(wrong.state[:, 3:6])
        assert (attitude / wrong.sigma[:, 3:6]).max() < 5.0
        assert np.degrees(attitude[:, :2]).max() < 5.0
        if method == "ekf_heading":
            assert np.degrees(attitude[:, 2]).max() < 2.0  # five sigma of the start's 0.4 deg


def run(flown, method, start_s):
    """Poses, states and reasons without a pose, each half second, of a flight from a time on."""
    navigation = Navigation(config_for(flown, method=method))
    result, states, reasons = [], set(), []
    for number, sample in enumerate(samples_from(flown, start_s, length_s=100.0)):
        solution = navigation.process(sample).solution
        if solution is not None:
            result.append(solution)
        if number % 50 == 0:
            status = navigation.status()
            states.add(status.state)
            if solution is None and not status.state.navigating:
                reasons.append(status.reason)
    return result, states, reasons
