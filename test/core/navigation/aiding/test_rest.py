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
"""Rest gives the gyroscopes' biases; a hand, an engine, a turn and a car give none."""

from __future__ import annotations

import numpy as np
import pytest

from dev.flight_errors import (
    Squares,
    errors,
    fitting_config,
    navigation_samples,
    rms_of,
    solutions,
)
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.navigation.aiding.rest import RestTest
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample, Source, VelocitySample
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

IMU = EkfConfig().imu
BIAS = np.array([-0.0145, 0.008, 0.006])  # of a P4 RTK
STEP_NS = 10_000_000
T_S = np.arange(3000) * 0.01


def imu_at_rest(rate=0.0, force=0.0, attitudes=None):
    """30 s of an IMU with the configured noise, and what is added to it."""
    rng = np.random.default_rng(5)
    white = 10 * rng.standard_normal((2, len(T_S), 3))
    rates = BIAS + white[0] * IMU.angle_random_walk + rate
    forces = [0.0, 0.0, -9.8] + white[1] * IMU.velocity_random_walk + force
    quats = [None] * len(T_S) if attitudes is None else attitudes
    return [ImuSample(k * STEP_NS, forces[k], rates[k], quats[k]) for k in range(len(T_S))]


def rests(samples, watched=()):
    test, watched = RestTest(IMU), list(watched)
    found = []
    for sample in samples:
        while watched and watched[0].stamp_ns <= sample.stamp_ns:
            test.watch(watched.pop(0))
        found.append(test.add(sample))
    return [rest for rest in found if rest is not None]


def test_rest_is_known_after_six_seconds_and_then_every_two():
    found = rests(imu_at_rest())
    assert [round(rest.stamp_ns * 1e-9) for rest in found] == list(range(6, 30, 2))
    density = np.square(IMU.angle_random_walk)
    for rest, seconds in zip(found, [6.0, *[2.0] * 11], strict=True):
        np.testing.assert_allclose(rest.variance_b, density / seconds)
        ratio = (rest.angular_rate_b - BIAS) / np.sqrt(rest.variance_b)
        assert np.abs(ratio).max() < 4.5


def swing(amplitude, hz):
    return amplitude * np.sin(2 * np.pi * hz * T_S)[:, None] * [1.0, 0.5, 0.5]


def yawing(rate_rad_s):
    return quat_from_euler(0.0, 0.0, rate_rad_s * T_S)


TURN = 0.01  # rad/s, 0.6 deg/s: as a bias


@pytest.mark.parametrize(
    "samples",
    [
        imu_at_rest(rate=swing(2e-3, 0.3)),  # a hand that turns by 0.06 deg
        imu_at_rest(force=swing(0.1, 1.0)),  # and one that shifts by 3 mm
        imu_at_rest(rate=swing(0.01, 31.0)),  # an engine
        imu_at_rest(force=swing(1.0, 31.0)),
        imu_at_rest(attitudes=yawing(TURN)),  # a turntable, or a car on a long bend
        imu_at_rest(force=9.8 * np.outer(np.sin(TURN * T_S), [1, 0, 0])),  # a slow tilt
        [s for s in imu_at_rest() if s.stamp_ns % 1_000_000_000 > 50_000_000],  # with gaps
    ],
    ids=["turning", "shifting", "rotors", "shaking", "yawing", "tilting", "gaps"],
)
def test_no_motion_passes_for_rest(samples):
    assert not rests(samples)


def test_what_the_receivers_measure_may_deny_rest():
    seconds = [k * 1_000_000_000 for k in range(30)]
    headings = [HeadingSample(ns, TURN * ns * 1e-9, 1e-4) for ns in seconds]
    assert not rests(imu_at_rest(), headings)
    for speed_m_s, number in ((1.0, 0), (0.25, 12)):  # a car, and the noise of GPS
        velocity = speed_m_s * np.array([0.6, 0.8, 0.0]), np.eye(3) * 0.01
        moving = [VelocitySample(ns, Source.GPS_VELOCITY, *velocity) for ns in seconds]
        assert len(rests(imu_at_rest(), moving)) == number


def standing(seed=1, **values):
    scenario = {
        "duration_s": 26.0,
        "route.standing_s": 20.0,
        "imu.gyro_bias_rad_s": (BIAS * [1, -1, -1]).tolist(),
    }
    return fly(
        scenario_from(scenario | {k.replace("__", "."): v for k, v in values.items()}), seed
    )


def run(flown, keep=lambda _sample: True):
    """Run the filter to the end; return it and error over sigma (n, 3) of its gyroscope biases."""
    navigation, ratios = Navigation(fitting_config(flown)), []
    row = {stamp: k for k, stamp in enumerate(flown.truth.stamp_ns)}
    for sample in filter(keep, navigation_samples(flown)):
        navigation.process(sample)
        if isinstance(sample, ImuSample) and not row[sample.stamp_ns] % 10:
            found = navigation.biases
            if found is not None:
                off = np.array(found.gyro_b) - flown.truth.gyro_bias_b[row[sample.stamp_ns]]
                ratios.append(off / np.sqrt(np.diag(found.covariance)[:3]))
    return navigation, np.array(ratios)


def test_a_stand_before_take_off_tells_the_biases():
    flown = standing()
    navigation, ratios = run(flown, lambda s: s.stamp_ns < flown.scenario.start_ns + 20e9)
    assert navigation.status().counts["rest", "used"] == 7  # from 6 to 18 s
    # White noise of 1.7e-4 rad/sqrt(s) over 20 s, and a bias that varies by 3.7e-5 about y.
    sigma = np.sqrt(np.diag(navigation.biases.covariance)[:3])
    np.testing.assert_array_less(sigma, [4e-5, 6e-5, 4e-5])
    assert np.abs(ratios).max() < 4


def test_the_alignment_begins_with_what_a_rest_has_told():
    flown = standing(2)

    def comes(sample):  # receivers have no fix for 12 s
        late = sample.stamp_ns > flown.scenario.start_ns + 12e9
        return late or isinstance(sample, ImuSample)

    def until_aligned(sample):
        return comes(sample) and sample.stamp_ns < flown.scenario.start_ns + 14.9e9

    navigation, ratios = run(flown, until_aligned)
    assert navigation.biases is not None, navigation.status()
    sigma = np.sqrt(np.diag(navigation.biases.covariance)[:3])
    # White noise of 1.8e-4 rad/sqrt(s) over 12 s is 5e-5 rad/s, with a bias that varies about y.
    np.testing.assert_array_less(sigma, 8e-5)
    assert np.abs(ratios).max() < 4


ENGINE = {"engine_before_s": 20.0, "gyro_vibration_rad_s": 0.05, "accel_vibration_m_s2": 3.0}
HAND = {"standing_on": "hand"}
STEADY = HAND | {"hand_turn_deg": 0.1, "hand_shift_m": 0.001}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [ENGINE, HAND, STEADY], ids=["engine", "hand", "steady"])
def test_an_engine_or_a_hand_makes_no_wrong_bias(kind):
    values = {f"{'imu' if 'vib' in name else 'route'}__{name}": x for name, x in kind.items()}
    for seed in range(1, 21):
        flown = standing(seed, duration_s=20.0, **values)
        navigation, ratios = run(flown)
        assert not [key for key in navigation.status().counts if key[0] == "rest"]
        assert np.abs(ratios[-1]).max() < 4  # of its sigmas, at take-off


@pytest.mark.slow
def test_a_rest_is_nearly_as_good_as_known_biases():
    """The heading over the first 40 s in the air, of ten flights."""
    squares = {}
    for known in (False, True):
        values = {"imu__gyro_bias_rad_s": [0.0] * 3, "imu__gyro_turn_on_bias_rad_s": 0.0}
        prior = {"imu__gyro_turn_on_bias": 1e-5}
        for seed in range(1, 11):
            flown = standing(seed, duration_s=60.0, **(values if known else {}))
            config = fitting_config(flown, **(prior if known else {}))
            found = errors(flown, solutions(flown, config))
            squares.setdefault(known, []).append(Squares.of(found, 20.0))
    rest_rad, known_rad = (float(rms_of(squares[known], "rpy")[2]) for known in (False, True))
    # A Kalman filter of heading and bias, with headings of 0.49 deg at 5 Hz, says 1.16.
    assert rest_rad < 1.25 * known_rad
    assert np.degrees(rest_rad) < 0.06
