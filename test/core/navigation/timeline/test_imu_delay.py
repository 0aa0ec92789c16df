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
"""The delay of the IMU's stamps: the state moved on by it, and what flights show of it."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest
from filter_states import state_of

from dev.flight_errors import errors, fitting_config, navigation_samples, published
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.ins.error_states import ANTENNA, DELAY
from tirgeo_ros.core.navigation.ins.imu_delay import at_stamp, later, motion_of
from tirgeo_ros.core.navigation.ins.strapdown import propagate
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import smoothed
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

FORCE_B, RATE_B = (1.5, -0.8, -9.4), (0.3, -0.2, 0.6)


def test_a_state_moved_on_is_one_that_was_propagated():
    state = state_of(0.2, -0.1, 1.0)._replace(velocity_n=(3.0, -2.0, 0.5))
    moved = later(state, motion_of(state, FORCE_B, RATE_B), 0.005)
    ahead, _ = propagate(state, FORCE_B, RATE_B, 0.005)
    # Second order: (0.7 rad/s x 5 ms)^2 / 2, and 0.7 rad/s x 9.9 m/s2 x (5 ms)^2 / 2.
    assert moved.q_nb == pytest.approx(ahead.q_nb, abs=6e-6)
    assert moved.velocity_n == pytest.approx(ahead.velocity_n, abs=1e-4)
    # 1e-11 rad on the ground are 0.06 mm, 2.5 m/s2 x (5 ms)^2 / 2.
    assert moved[2:4] == pytest.approx(ahead[2:4], abs=1e-11)
    assert moved.correction_n == state.correction_n  # no measurement has moved it


@pytest.mark.parametrize(("delay_s", "share"), [(0.0, 0.789), (0.005, 0.1415), (0.008, 0.00126)])
def test_the_stamps_may_be_on_time(delay_s, share):
    """Shares are 1 / (1 + 1 / odds), odds 0.6 / 0.4 x 5 / 2 x exp(-d^2 / 2 s^2) with s = 2 ms."""
    rng = np.random.default_rng(4)
    root, motion = rng.normal(size=(ANTENNA.stop, ANTENNA.stop)), rng.normal(size=12)
    covariance = root @ root.T
    covariance *= 0.002**2 / covariance[DELAY, DELAY]
    gain = covariance[:, DELAY] / covariance[DELAY, DELAY]
    on_time = -gain * delay_s  # from the filter's estimate; its covariance:
    known = covariance - np.outer(gain, covariance[DELAY])
    # Of two means that are on_time apart the variance is share (1 - share) on_time^2.
    spread = share * (1 - share) * np.outer(on_time, on_time)
    mixed = share * known + (1 - share) * covariance + spread
    later_by = np.eye(ANTENNA.stop)
    later_by[:12, DELAY] += motion
    moved = share * on_time
    moved[:12] += (1 - share) * delay_s * motion
    error, after = at_stamp(covariance, motion, delay_s, 0.005)
    np.testing.assert_allclose(error, moved, rtol=0.01)
    expected = later_by @ mixed @ later_by.T
    np.testing.assert_allclose(after, expected, atol=0.01 * expected.max())
    assert np.array_equal(after, after.T)


@pytest.mark.parametrize("variance", [0.0, 5e-324, 1e-40])
def test_a_delay_that_is_known_moves_nothing(variance):
    covariance, motion = np.zeros((ANTENNA.stop, ANTENNA.stop)), np.ones(12)
    covariance[DELAY, DELAY] = variance
    error, after = at_stamp(covariance, motion, 0.0, 0.005)
    assert not error.any()
    assert np.abs(after).max() <= 2 * variance


@functools.cache
def flown(seed: int, delay_s: float, shape: str = "lawnmower", seconds: float = 107.0):
    """A flight whose IMU is late, and which nobody told so."""
    values = {"seed": seed, "route.shape": shape, "duration_s": seconds}
    return fly(scenario_from(values | {"imu.stamp_delay_s": delay_s}))


def status_of(flight: SimulatedFlight):
    navigation = Navigation(fitting_config(flight))
    published(navigation, navigation_samples(flight))
    return navigation.status()


def test_turns_show_the_delay():
    status = status_of(flown(4, 0.007, "figure_eight", 90.0))
    assert status.imu_delay_sigma_s < 0.0017
    assert abs(status.imu_delay_s - 0.007) < 3 * status.imu_delay_sigma_s
    assert status.late_imu(0.0)
    assert "set imu.delay_s to 0.00" in "; ".join(status.warnings)


def test_errors_of_a_receiver_pass_for_no_delay():
    """Velocities that err more than they say: what they show of the delay is not to be trusted."""
    flight, rng = flown(4, 0.007, "figure_eight", 90.0), np.random.default_rng(2)

    def noisy(sample):
        if sample.source is not Source.RTK_VELOCITY:
            return sample
        velocity_n = sample.velocity_n + rng.normal(scale=0.05, size=3)
        return dataclasses.replace(sample, velocity_n=velocity_n)

    navigation = Navigation(fitting_config(flight))
    published(navigation, map(noisy, navigation_samples(flight)))
    assert navigation.status().nis["rtk_velocity"] > 2
    assert math.isnan(navigation.status().imu_delay_s)


def test_a_delay_that_is_set_in_flight_is_not_taken_twice():
    flight = flown(4, 0.007, "figure_eight", 60.0)
    samples, navigation = navigation_samples(flight), Navigation(fitting_config(flight))
    half = len(samples) // 2
    published(navigation, samples[:half])
    before_s = navigation.status().imu_delay_s
    navigation.configure(fitting_config(flight, imu__delay_s=round(before_s, 4)))
    published(navigation, samples[half : half + 10])
    # The whole delay stays: a hundredth of a second's measurements change it little.
    assert navigation.status().imu_delay_s == pytest.approx(before_s, abs=2e-4)
    assert not navigation.status().late_imu(round(before_s, 4))


def test_a_delay_that_no_imu_has_is_left_to_the_receivers():
    """RTK stamped 40 ms early looks like an IMU that is late: attitudes stay as they are."""
    status = status_of(flown(4, 0.04, "figure_eight", 60.0))
    assert math.isnan(status.imu_delay_s)
    assert not status.late_imu(0.0)


def test_a_delay_that_is_exact_is_not_estimated():
    flight = flown(4, 0.0, "figure_eight", 60.0)
    navigation = Navigation(fitting_config(flight, imu__delay_sigma_s=0.0))
    published(navigation, navigation_samples(flight))
    assert math.isnan(navigation.status().imu_delay_s)
    assert not navigation._ekf.estimate().covariance[DELAY].any()


SEEDS = range(1, 11)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    ("shape", "seconds", "delay_s", "sigma_s"),
    [
        ("lawnmower", 107.0, 0.007, 0.0017),
        ("lawnmower", 107.0, 0.0, 0.0017),
        ("figure_eight", 300.0, 0.003, 0.0012),
    ],
)
def test_ten_flights_show_their_delay(shape, seconds, delay_s, sigma_s):
    every = [status_of(flown(seed, delay_s, shape, seconds)) for seed in SEEDS]
    delays_s = np.array([status.imu_delay_s for status in every])
    sigmas_s = np.array([status.imu_delay_sigma_s for status in every])
    assert (sigmas_s <= sigma_s).all()
    # Ten flights of 1.5 ms each: 0.5 ms.
    assert abs(delays_s.mean() - delay_s) < 0.001
    assert (np.abs(delays_s - delay_s) < 3 * sigmas_s).all()
    assert delay_s > 0 or not any(status.late_imu(0.0) for status in every)


def late_errors(seed: int, smooth: bool):
    """Errors of a flight that is 10 ms late: a whole sample, so that each pose has its truth."""
    flight = flown(seed, 0.01)
    config, samples = fitting_config(flight), navigation_samples(flight)
    navigation = smoothed(config, samples) if smooth else Navigation(config)
    known_s = 60.0  # after four turns
    return errors(flight, published(navigation, samples)[:-2]).after(0.0 if smooth else known_s)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("smooth", "heading_deg"), [(False, 0.08), (True, 0.055)])
def test_poses_of_a_late_imu_are_nearly_as_good_as_of_one_on_time(smooth, heading_deg):
    """Uncorrected: 0.116 and 0.096 deg with 5 ms, and 2.5 times the sigma."""
    every = [late_errors(seed, smooth) for seed in SEEDS]
    heading = np.concatenate([each.rpy[:, 2] for each in every])
    assert np.degrees(np.sqrt(np.mean(heading**2))) < heading_deg
    ratio = np.concatenate([each.state / each.sigma for each in every])
    assert (np.sqrt(np.mean(ratio**2, axis=0)) < 1.3).all()
