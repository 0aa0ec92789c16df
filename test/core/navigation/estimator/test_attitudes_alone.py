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
"""Attitudes without an IMU's rates: methods raw and rtk run on them, ekf says what it lacks."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from stills import PLANE, START_NS, strip

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.streams.sanity_checks import ATTITUDE_ALONE, fault_of
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, ImuSample
from tirgeo_ros.core.types.verdicts import FilterState, Outcome
from tirgeo_ros.io.messages import Messages, imu_sample

NOTHING = np.full(3, np.nan)


def fed(method, samples):
    """The navigation and its step for each sample."""
    navigation = Navigation(EkfConfig(method=method))
    return navigation, [navigation.process(sample) for sample in samples]


def inputs(stills, rtk=True, order=1):
    """What the filter gets, position first, or last with ``order`` -1."""
    for still in stills:
        samples = [s for s in still.samples(rtk) if not isinstance(s, CameraAttitudeSample)]
        yield from samples[::order]


@pytest.mark.parametrize("method", ["raw", "rtk"])
@pytest.mark.parametrize("order", [1, -1], ids=["position first", "attitude first"])
@pytest.mark.parametrize("step_s", [1 / 30, 0.7, 2.0, 9.0])
def test_each_attitude_has_a_solution(method, order, step_s):
    stills = strip(step_s=step_s)
    if order < 0 and step_s < 1:  # a position of the last second would be used
        stills = stills[:1]
    navigation, steps = fed(method, inputs(stills, method == "rtk", order))
    solutions = [step.solution for step in steps if step.solution is not None]
    assert [each.stamp_ns for each in solutions] == [still.stamp_ns for still in stills]
    for still, solution in zip(stills, solutions, strict=True):
        place = solution.latitude_rad, solution.longitude_rad, solution.height_m
        assert_allclose(PLANE.ned_from_geodetic(*place), still.place_n, atol=1e-6)
        assert_array_equal(solution.angular_rate_b, 0)
        assert min(solution.rate_variance_b) > math.tau**2  # not known
        assert np.isfinite(solution.covariance).all()
    status = navigation.status()
    assert (status.state, status.reason) == (FilterState.RUNNING, "")
    assert {step.verdict.outcome for step in steps} == {Outcome.USED}


def test_the_state_stays_while_the_next_position_waits_for_its_attitude():
    navigation, _ = fed("rtk", inputs(strip()))
    states = set()
    for sample in inputs(strip(step_s=30.0)[1:]):
        navigation.process(sample)
        states.add(navigation.state_and_resets()[0])
    assert states == {FilterState.RUNNING}


def test_a_bag_that_begins_again_and_an_attitude_out_of_order():
    samples = [*inputs(strip(step_s=0.5))]
    _, steps = fed("rtk", [*samples, samples[-3], *samples])
    assert steps[len(samples)].verdict.outcome is Outcome.OUT_OF_ORDER
    again = [step.solution for step in steps[len(samples) + 1 :] if step.solution]
    assert len(again) == len(samples) // 2


def test_an_attitude_without_a_position_says_what_is_lacking():
    navigation, steps = fed("rtk", [s for s in inputs(strip()) if isinstance(s, ImuSample)])
    assert [step.solution for step in steps] == [None] * 12
    assert navigation.status().reason == "no rtk/fix within 1 s"


@pytest.mark.parametrize("method", ["ekf", "ekf_heading"])
def test_a_filter_says_that_it_needs_an_imu(method):
    navigation, steps = fed(method, inputs(strip()))
    verdicts = [step.verdict for step in steps[1::2]]
    assert {(v.outcome, v.reason) for v in verdicts} == {(Outcome.INVALID, ATTITUDE_ALONE)}
    status = navigation.status()
    assert (status.state, status.reason) == (FilterState.WAITING, ATTITUDE_ALONE)
    assert "method raw or rtk" in status.reason


def test_a_message_marks_rate_and_force_as_absent():
    sample = strip()[0].samples()[1]
    message = Messages().imu(sample)
    covariances = message.angular_velocity_covariance, message.linear_acceleration_covariance
    assert [each[0] for each in covariances] == [-1, -1]
    assert (message.angular_velocity.x, message.linear_acceleration.z) == (0, 0)
    back = imu_sample(message)
    assert back.is_attitude_alone
    assert_allclose(back.autopilot_q_nb, sample.autopilot_q_nb, atol=1e-15)
    message.linear_acceleration_covariance[0] = 0.0
    back = imu_sample(message)
    assert not back.is_attitude_alone
    assert fault_of(back) == "force or rate is not finite"


@pytest.mark.parametrize("q_nb", [None, np.zeros(4), np.full(4, np.nan)])
def test_neither_an_attitude_nor_rates_is_a_fault(q_nb):
    sample = ImuSample(START_NS, NOTHING, NOTHING, q_nb)
    assert fault_of(sample) == "force or rate is not finite"
