"""Rates, silence and latencies, on a clock that the test turns."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from tirgeo_ros.nodes import monitor as module
from tirgeo_ros.nodes.monitor import OK, WARN, Monitor


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


def test_rates_are_of_the_last_window(clock):
    monitor = Monitor()
    for _ in range(200):
        monitor.received("imu/data")
    clock[0] += 2.0
    assert monitor.item("x").values["imu/data rate [Hz]"] == "100.0"
    clock[0] += 1.0
    item = monitor.item("x")
    assert item.values["imu/data rate [Hz]"] == "0.0"
    assert item.values["imu/data age [s]"] == "3.00"


def test_silence_of_what_is_needed_is_a_warning(clock):
    monitor = Monitor()
    monitor.expects("imu/data")
    monitor.received("tirgeo/origin")  # once, for ever: not expected again
    assert monitor.item("x").level == OK
    clock[0] += 3.0
    item = monitor.item("x")
    assert (item.level, item.message) == (WARN, "silent: imu/data")
    monitor.received("imu/data")
    assert monitor.item("x").level == OK
