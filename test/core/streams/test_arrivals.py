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
"""Lanes are merged by time of arrival; a sample without a stamp gets its time of arrival."""

from __future__ import annotations

import dataclasses

import message_samples as readings
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.core.streams.stamps import ArrivalOrder, Arrivals


def order_of(depth: int, *lanes: str) -> ArrivalOrder[str]:
    order: ArrivalOrder[str] = ArrivalOrder()
    for lane in lanes:
        order.open(lane, depth)
    return order


def remaining(order: ArrivalOrder[str]) -> list[str]:
    items = []
    while (item := order.pop()) is not None:
        items.append(item)
    assert len(order) == 0
    return items


def test_a_lane_keeps_its_order_where_the_clock_of_arrivals_was_set_back():
    order = order_of(9, "imu", "fix")
    for arrived_ns in (100, 5, 6):
        order.put("imu", arrived_ns, f"imu {arrived_ns}")
    order.put("fix", 7, "fix 7")
    assert remaining(order) == ["fix 7", "imu 100", "imu 5", "imu 6"]


def test_a_full_lane_gives_up_its_oldest_and_no_other_lanes():
    order = order_of(2, "imu", "fix")
    order.put("fix", 1, "fix 1")
    for arrived_ns in (2, 3, 4, 5):
        order.put("imu", arrived_ns, f"imu {arrived_ns}")
    assert order.given_up == {"imu": 2}
    assert remaining(order) == ["fix 1", "imu 4", "imu 5"]


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 9)), max_size=30))
def test_nothing_is_lost_or_doubled_and_lanes_that_rise_come_out_sorted(entries):
    order: ArrivalOrder[tuple[int, int]] = ArrivalOrder()
    for lane in "abc":
        order.open(lane, 30)
    for number, (lane, arrived_ns) in sorted(enumerate(entries), key=lambda pair: pair[1]):
        order.put(lane, arrived_ns, (arrived_ns, number))
    taken = remaining(order)
    assert sorted(number for _, number in taken) == list(range(len(entries)))
    assert [arrived_ns for arrived_ns, _ in taken] == sorted(ns for _, ns in entries)


SAMPLES = [
    readings.IMU,
    readings.POSITION,
    readings.VELOCITY,
    readings.HEADING,
    readings.JOINTS,
    readings.CAMERA_ATTITUDE,
]


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: type(sample).__name__)
def test_a_sample_without_a_stamp_gets_its_time_of_arrival(sample):
    arrivals = Arrivals()
    assert arrivals.stamped("some/topic", sample, 5_000) is sample
    assert arrivals.counts == {}
    without = dataclasses.replace(sample, stamp_ns=0)
    stamped = arrivals.stamped("some/topic", without, 5_000)
    assert stamped.stamp_ns == 5_000
    for item in dataclasses.fields(sample):
        if item.name != "stamp_ns":
            assert getattr(stamped, item.name) is getattr(sample, item.name)
    assert arrivals.diagnostics == {"stamped_at_arrival.some/topic": "1"}
