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
"""The fit of a window: its partials against differences, and the weight of headings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from alignments import aligned, error, samples_from
from flights import config_for

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.alignment.batch_least_squares import (
    AlignmentObservation,
    ObservationKind,
    _Terms,
    integrate,
)
from tirgeo_ros.core.navigation.alignment.window_estimate import heading_observations
from tirgeo_ros.core.navigation.ins.propagation import STILL
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

PERFECT = {
    "imu.noise_scale": 0.0,
    "rtk.position_sigma_m": [0.0, 0.0, 0.0],
    "rtk.velocity_sigma_m_s": [0.0, 0.0, 0.0],
    "heading.sigma_deg": 0.0,
    "heading.step_deg": 0.0,
    "autopilot.heading_rms_deg": 0.0,
    "route.shape": "figure_eight",
}


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_perfect_measurements_give_the_state_back(rate_hz):
    """Not exact: earth rate and Coriolis are left out, and integration has steps."""
    flown = fly(scenario_from({**PERFECT, "imu.rate_hz": rate_hz, "duration_s": 24.0}), 1)
    for start_s in (0.0, 9.3, 20.3):
        result, _ = aligned(samples_from(flown, start_s), config_for(flown))
        wrong = error(flown, result)
        # Coriolis at 3 m/s is 4e-4 m/s2, a 4e-5 of gravity; the earth turns 7e-5 rad in 1 s.
        assert np.abs(wrong[0:3]).max() < 2e-4
        assert np.abs(wrong[3:6]).max() < 1e-3
        assert np.abs(wrong[6:9]).max() < 1e-3


def observations(first_ns):
    """One of each kind at three instants between the IMU's."""
    arm_b = np.array([0.4, -0.3, -0.6])
    nothing = (np.zeros((3, 3)), np.zeros(3))
    return [
        AlignmentObservation(first_ns + at_ns, kind.value, kind, np.zeros(3), arm_b, *nothing)
        for at_ns in (3_000_000, 404_000_000, 997_000_000)
        for kind in ObservationKind
    ]


def test_partials_by_the_biases_are_those_of_differences():
    flown = fly(scenario_from({"duration_s": 14.0, "route.shape": "figure_eight"}), 2)
    imu = [s for s in samples_from(flown, 10.0, length_s=1.0) if isinstance(s, ImuSample)]
    observed = observations(imu[0].stamp_ns)
    stamps = [o.stamp_ns for o in observed]

    def terms(biases):
        return _Terms(integrate(imu, stamps, biases), observed, STILL)

    wanted = terms(np.zeros(6)).of_biases
    for k, size in enumerate([1e-4] * 3 + [1e-2] * 3):
        step = size * np.eye(6)[k]
        difference = (terms(step).body - terms(-step).body) / (2 * size)
        # Steps of 20 ms at 40 deg/s: (0.014 rad)^2 / 8 of a force of 10 over 1 s, and twice that.
        assert np.abs(wanted[:, :, k] - difference).max() < 2e-3


def readings(headings_deg):
    return [
        HeadingSample(1_000_000_000 * k, math.radians(h), math.radians(0.4) ** 2)
        for k, h in enumerate(headings_deg)
    ]


@pytest.mark.parametrize(
    ("headings_deg", "lasting_deg"),
    [
        ([20.0] * 5, math.sqrt(1 / 12)),  # all of the rounding error is in each
        ([359.0, 0.0, 1.0, 2.0, 3.0], 0.0),  # a turn: exp(-2 pi^2 1.9) of it
        ([20.0, 20.3, 19.8, 20.1, 20.0], 0.0),  # not rounded
        ([20.4, 20.4, 20.4], math.sqrt(1 / 12)),  # rounded, then turned by an offset
    ],
)
def test_whole_degrees_average_as_far_as_they_scatter(headings_deg, lasting_deg):
    observed = heading_observations(readings(headings_deg), EkfConfig())
    for observation in observed:
        assert math.degrees(observation.slow_sigma[0]) == pytest.approx(lasting_deg, abs=1e-6)
        assert math.degrees(math.sqrt(observation.white[0, 0])) == pytest.approx(0.6)


def test_averaged_rounding_error_is_as_large_as_computed():
    """Means of five rounded readings of one direction, by how much the readings scatter."""
    rng = np.random.default_rng(3)
    ratios = []
    for _ in range(4000):
        true_deg, noise_deg = rng.uniform(-0.5, 0.5), rng.choice([0.05, 0.2, 0.4])
        exact = true_deg + noise_deg * rng.standard_normal(5)
        rounded = np.round(exact)
        sigma = heading_observations(readings(rounded), EkfConfig())[0].slow_sigma[0]
        ratios.append(
            np.mean(rounded - true_deg) / math.hypot(math.degrees(sigma), 0.6 / math.sqrt(5))
        )
    # The floor of 0.6 deg is more than such noise; 4000 draws tell the rms to 1 %.
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.0
