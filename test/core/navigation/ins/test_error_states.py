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
"""F, feedback and the noise model against the non-linear mechanisation."""

from __future__ import annotations

import numpy as np
import pytest
from filter_states import ekf_config
from hypothesis import given, strategies as st
from motions import difference, state_at

from tirgeo_ros.core.config import EkfConfig, ImuConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.navigation.ins.error_states import (
    ANTENNA,
    BAROMETER_OFFSET,
    GPS_ERROR,
    STATES,
    feedback,
    has_antenna,
    states_of,
)
from tirgeo_ros.core.navigation.ins.propagation import CovariancePropagation
from tirgeo_ros.core.navigation.ins.strapdown import propagate

IMU, CONFIG = ImuConfig(), ekf_config()
WITH_ANTENNA = EkfConfig()  # not measured
#: Steps of the differences: small against the curvature of the model, large against rounding.
STEPS = np.array([1e-4] * 3 + [1e-2] * 3 + [10.0] * 3 + [1e-4] * 3 + [1e-2] * 3)


def state_of(lat, roll, pitch, yaw, velocity_n):
    biases = {"gyro_bias_b": (1e-4, -2e-4, 3e-4), "accel_bias_b": (0.01, 0.02, -0.03)}
    return state_at(lat, 1.0, 120.0, tuple(velocity_n), (roll, pitch, yaw), **biases)


def dynamics(state, rates):
    """F (15, 15) as the propagation of the covariance writes it."""
    propagation = CovariancePropagation(CONFIG)
    propagation.step(np.eye(ANTENNA.start), state, rates, rates.specific_force_n, 0.01)
    return propagation._f[:STATES, :STATES]


angles = st.floats(-0.5, 0.5)
speeds = st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-5, 5))


@given(st.floats(-1.2, 1.2), angles, angles, st.floats(-3, 3), speeds)
def test_dynamics_are_the_derivative_of_the_mechanisation(lat, roll, pitch, yaw, velocity):
    """Each column of F against central differences of one short step."""
    state = state_of(lat, roll, pitch, yaw, velocity)
    force, rate, step = (1.0, -2.0, -9.5), (0.1, -0.2, 0.3), 1e-3
    after, rates = propagate(state, force, rate, step)
    f = dynamics(state, rates)
    for column in range(STATES):
        error = np.zeros(STATES)
        error[column] = STEPS[column]
        plus, _ = propagate(feedback(state, error), force, rate, step)
        minus, _ = propagate(feedback(state, -error), force, rate, step)
        grown = (difference(plus, after) - difference(minus, after)) / 2
        measured = (grown - error) / step / STEPS[column]
        expected = f[:, column].copy()
        expected[9:] = 0.0  # the nominal biases stand still; their decay is the noise model's
        # Second order in the step: half of F^2 dt, whose largest terms are force times rate and
        # velocity gain (10 x 1 x 1e-3 / 2). Positions' angles round to 2e-16 rad, 1.4e-9 m each.
        bound = np.full(STATES, 6e-3)
        bound[6:9] += 5e-9 / step / STEPS[column]
        assert (np.abs(measured - expected) <= bound).all()


def test_small_terms_of_the_dynamics():
    """Transport, Coriolis and gravity terms, too small for the bound above, by a long step."""
    state = state_of(0.7, 0.0, 0.0, 0.0, (20.0, 15.0, -2.0))
    state = state._replace(gyro_bias_b=(0.0,) * 3, accel_bias_b=(0.0,) * 3)
    _, rates = propagate(state, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1e-6)
    f = dynamics(state, rates)
    for column, size in [(3, 10.0), (4, 10.0), (5, 10.0), (6, 1e4), (7, 1e4), (8, 1e3)]:
        error = np.zeros(STATES)
        error[column] = size
        step = 1.0
        plus, _ = propagate(feedback(state, error), (0.0,) * 3, (0.0,) * 3, step)
        minus, _ = propagate(feedback(state, -error), (0.0,) * 3, (0.0,) * 3, step)
        grown = difference(plus, minus) / 2 / size
        measured = (grown[:6] - np.eye(STATES)[column, :6]) / step
        # Relative to the largest term of the column; second order in the step is below 1e-3 of it.
        bound = np.full(6, 5e-3 * np.abs(f[:6, column]).max() + 1e-12)
        # F leaves out that gravity changes with latitude: 0.05 m/s2 over the earth's radius.
        bound[5] += 1e-8 if column == 6 else 0.0
        assert (np.abs(measured - f[:6, column]) <= bound).all(), column


@given(st.lists(st.floats(-1, 1), min_size=STATES, max_size=STATES))
def test_feedback_then_difference_is_the_error(values):
    """Feedback and the definition of the errors are inverse to first order."""
    state = state_of(0.7, 0.1, -0.2, 2.0, (3.0, -1.0, 0.5))
    error = np.array(values) * np.array([1e-3] * 3 + [1.0] * 12)
    error[9:] *= 1e-2
    # Metres through radians at 6e6 m: 1e-9; east by the cosine at the changed latitude: 1e-7 m.
    assert difference(feedback(state, error), state) == pytest.approx(error, abs=1e-6)


@pytest.mark.parametrize("config", [CONFIG, WITH_ANTENNA])
def test_gauss_markov_errors_keep_their_standard_deviation(config):
    """Driving noise leaves the variance where it is, that of a bias with its turn-on part."""
    states = states_of(config)
    sigmas = np.zeros(states)
    sigmas[9:12] = np.hypot(IMU.gyro_bias_instability, IMU.gyro_turn_on_bias)
    sigmas[12:15] = np.hypot(IMU.accel_bias_instability, IMU.accel_turn_on_bias)
    sigmas[GPS_ERROR] = config.gps.position_sigma_m
    if has_antenna(states):
        sigmas[ANTENNA] = 0.1, 0.2, 0.3  # the variance of a constant stays
    covariance = np.diag(sigmas**2)
    state = state_of(0.7, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0))
    propagation = CovariancePropagation(config)
    _, rates = propagate(state, (0.0, 0.0, -9.8), (0.0,) * 3, 0.01)
    for _ in range(2000):  # 20 s: one correlation time of the fastest axis
        covariance = propagation.step(covariance, state, rates, rates.specific_force_n, 0.01)
    # Euler noise against the exact discrete one differs by dt/tau = 5e-4 at most.
    covariance[BAROMETER_OFFSET, BAROMETER_OFFSET] = 0.0  # it wanders
    assert np.diag(covariance)[9:] == pytest.approx(sigmas[9:] ** 2, rel=1e-3)


def test_step_is_the_transition_of_the_dynamics():
    """P to F P F' of I + F dt + (F dt)^2 / 2, with the random walks turned to n."""
    state = state_of(0.7, 0.3, -0.2, 1.0, (5.0, -3.0, 0.5))
    _, rates = propagate(state, (1.0, -2.0, -9.5), (0.1, -0.2, 0.3), 0.04)
    rng = np.random.default_rng(4)
    scales = np.r_[STEPS, np.ones(ANTENNA.start - 15)]
    root = rng.normal(size=(ANTENNA.start,) * 2) * scales[:, None]
    before = root @ root.T
    f = np.zeros((ANTENNA.start,) * 2)
    f[:15, :15] = dynamics(state, rates)
    times_s = [*IMU.gyro_bias_time_s, *IMU.accel_bias_time_s, *[CONFIG.gps.position_time_s] * 3]
    times_s += [np.inf, *[CONFIG.gps.position_time_s] * 3, np.inf]
    f[15:, 15:] = -np.diag(1 / np.array(times_s[6:]))
    phi = np.eye(ANTENNA.start) + 0.04 * f + 0.5 * (0.04 * f) @ (0.04 * f)
    rotation, gps = matrix_from_quat(np.array(state.q_nb)), CONFIG.gps
    sigmas = [*IMU.gyro_bias_instability, *IMU.accel_bias_instability, *gps.position_sigma_m]
    sigmas += [0.0] * 5
    noise = np.diag(np.r_[np.zeros(9), 2 * np.square(sigmas) / times_s])
    noise[:3, :3] = rotation @ np.diag(np.square(IMU.angle_random_walk)) @ rotation.T
    climb_m2_s = CONFIG.barometer.time_s * (CONFIG.barometer.scale_sigma * 0.5) ** 2
    noise[BAROMETER_OFFSET, BAROMETER_OFFSET] = CONFIG.barometer.density**2 + climb_m2_s
    noise[3:6, 3:6] = rotation @ np.diag(np.square(IMU.velocity_random_walk)) @ rotation.T
    expected = phi @ before @ phi.T + 0.04 * noise
    step = CovariancePropagation(CONFIG).step
    result = step(before, state, rates, rates.specific_force_n, 0.04)
    scaled = np.outer(scales, scales)
    # The states' sizes out of the way, entries are below 1e3 and round by 1e-16 times a few sums.
    np.testing.assert_allclose(result / scaled, expected / scaled, rtol=0, atol=1e-10)


@given(st.integers(0, 2**32 - 1))
def test_covariance_stays_symmetric_and_positive(seed):
    rng = np.random.default_rng(seed)
    scales = np.r_[STEPS, np.ones(ANTENNA.start - 15), np.full(3, 1e-2)]
    root = rng.normal(size=(ANTENNA.stop,) * 2) * scales
    covariance = root @ root.T
    state = state_of(0.7, 0.2, -0.3, 1.0, (3.0, 2.0, 0.1))
    propagation = CovariancePropagation(WITH_ANTENNA)
    for _ in range(20):
        after, rates = propagate(state, (0.5, 0.3, -9.7), (0.2, 0.1, -0.4), 0.02)
        covariance = propagation.step(covariance, state, rates, rates.specific_force_n, 0.02)
        state = after
    assert np.array_equal(covariance, covariance.T)
    scaled = covariance / np.outer(scales, scales)
    assert np.linalg.eigvalsh(scaled).min() > -1e-9 * np.linalg.eigvalsh(scaled).max()


def test_propagation_does_not_depend_on_earlier_calls():
    """The work arrays carry nothing from one call to the next."""
    state = state_of(0.7, 0.2, -0.3, 1.0, (3.0, 2.0, 0.1))
    other = state_of(-0.9, -0.4, 0.3, -2.0, (-8.0, 5.0, 1.0))
    _, rates = propagate(state, (0.5, 0.3, -9.7), (0.2, 0.1, -0.4), 0.04)
    _, other_rates = propagate(other, (-2.0, 3.0, -12.0), (1.2, 0.7, 0.9), 0.04)
    propagation, covariance = CovariancePropagation(CONFIG), np.eye(ANTENNA.start)
    first = propagation.step(covariance, state, rates, rates.specific_force_n, 0.04)
    kept = first.copy()
    propagation.step(covariance, other, other_rates, other_rates.specific_force_n, 0.01)
    again = propagation.step(covariance, state, rates, rates.specific_force_n, 0.04)
    assert np.array_equal(again, kept)
    assert np.array_equal(first, kept)  # an earlier result is not overwritten, either
    assert np.array_equal(covariance, np.eye(ANTENNA.start))
