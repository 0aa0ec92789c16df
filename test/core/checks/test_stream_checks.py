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
"""Rates, gaps, order and silence of topics; the ages of their samples against the IMU's."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tirgeo_ros.core.checks.stream_checks import (
    StampChecks,
    Stream,
    lone_findings,
    stream_findings,
)
from tirgeo_ros.core.config import EkfConfig, RtkConfig
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.measurements import PressureSample

S = 1_000_000_000


def at(stamp_ns):
    return PressureSample(stamp_ns, 1e5, 1.0)


def test_a_rate_is_that_between_gaps():
    stream = Stream(0.2)
    for k in [*range(100), *range(150, 250)]:
        stream.add(at(k * S // 100), k * S // 100)
    assert stream.rate_hz == pytest.approx(100)
    assert (stream.gaps, stream.longest_ns) == (1, 51 * S // 100)


def aged(ages_s, config=EkfConfig()):  # noqa: B008 - frozen
    """Return findings on rtk/fix with an age in each second, and an IMU without delay."""
    imu, rtk = Stream(0.2), Stream(1.5)
    checks = StampChecks(config)
    for second, age_s in enumerate(ages_s, start=10):
        for k in range(5):
            arrival_ns = second * S + k * S // 5
            imu.add(at(arrival_ns), arrival_ns)
            rtk.add(at(arrival_ns - round(age_s * 1e9)), arrival_ns)
            checks.take("rtk/fix", rtk, imu)
    return {item.check: item for item in checks.findings()}


def test_delays_that_a_link_has_are_no_fault():
    assert aged([0.08] * 60) == {}
    assert aged([0.0, 0.3] * 30) == {}  # a link that is slow now and then
    assert aged([0.08] * 20 + [2.0] + [0.08] * 20) == {}  # one second was late


def test_a_known_delay_is_taken_off():
    ahead = aged([-0.3] * 9)
    assert ahead["stamp_ahead"].severity is Severity.STOP
    assert "0.30 s ahead" in ahead["stamp_ahead"].evidence
    assert aged([-0.3] * 9, replace(EkfConfig(), rtk=RtkConfig(delay_s=0.3))) == {}


def test_a_clock_that_jumps():
    jumped = aged([0.05] * 20 + [0.35] * 20)
    assert set(jumped) == {"stamp_jump"}
    assert "+0.30 s" in jumped["stamp_jump"].evidence


def test_two_publishers_are_reported_by_their_order():
    stream = Stream(0.2)
    for k in range(100):
        stream.add(at(k * S // 100), k * S // 100)
        stream.add(at(k * S // 100 - 1), k * S // 100)
    result = stream_findings({"imu/data": stream}, EkfConfig(), S, math.inf)
    assert "stamp_order" in [item.check for item in result]


@pytest.mark.parametrize("off_s", [-20.0, 20.0])
def test_a_stamp_that_jumps_alone_is_no_gap(off_s):
    stream = Stream(0.2)
    for k in range(200):
        stream.add(
            at(k * S // 100 + 90 * S + round(off_s * S) * (k == 100)), k * S // 100 + 90 * S
        )
    assert (stream.gaps, stream.alone) == (0, 1)
    assert stream.rate_hz == pytest.approx(100, rel=0.01)  # one sample of 200 is missing
    (result,) = lone_findings({"imu/data": stream}, math.inf)
    assert (result.check, result.severity) == ("stamp_alone", Severity.CAUTION)
    assert "imu/data (1 of 200)" in result.evidence
    assert result in stream_findings({"imu/data": stream}, EkfConfig(), S, math.inf)


def test_a_gap_and_a_clock_that_is_set_are_no_lone_jumps():
    stream = Stream(0.2)
    for jump_s in (0, 20, -900):
        for k in range(100):
            stamp_ns = 2000 * S + jump_s * S + k * S // 100
            stream.add(at(stamp_ns), stamp_ns)
    assert (stream.gaps, stream.back, stream.alone) == (1, 1, 0)


@pytest.mark.parametrize(
    ("method", "present", "absent"),
    [
        ("ekf_heading", ("imu/data", "rtk/fix", "rtk/vel", "rtk/heading"), []),
        ("ekf_heading", ("imu/data", "rtk/fix", "rtk/vel"), ["no_rtk_heading"]),
        ("ekf", ("imu/data", "rtk/fix", "rtk/vel"), []),
        ("ekf", ("imu/data", "rtk/fix"), ["no_rtk_vel"]),
        ("rtk", ("imu/data", "gps/fix"), ["no_rtk_fix"]),
        ("raw", ("imu/data", "gps/fix"), []),
        ("raw", ("gps/fix",), ["no_imu_data"]),
    ],
)
def test_topics_that_a_method_needs(method, present, absent):
    config, streams = replace(EkfConfig(), method=method), dict.fromkeys(present, Stream(1.0))
    assert stream_findings(streams, config, 5 * S, math.inf) == []  # it may still come
    result = stream_findings(streams, config, 10 * S, math.inf)
    assert [item.check for item in result] == absent
