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
    clock[0] += 3.0
    monitor.forget("imu/data")
    assert monitor.item("x").level == OK


def test_what_the_transport_lost_is_counted_on_until_it_is_forgotten(clock):
    monitor = Monitor()
    for number in (1, 5, 5):
        monitor.lost("thermal/image_raw", number)
        clock[0] += 1.0
    assert monitor.item("x").values["thermal/image_raw lost"] == "5"
    assert monitor.item("x").values["thermal/image_raw lost"] == "5"
    monitor.forget("thermal/image_raw")
    monitor.lost("thermal/image_raw", 1)
    assert "thermal/image_raw lost" not in monitor.item("x").values


def test_a_forgotten_topic_stays_forgotten(clock):
    """An executor hands over what it had queued after the subscription was destroyed."""
    monitor = Monitor()
    monitor.listens("imu/data")
    monitor.received("imu/data")
    monitor.refused("imu/data")
    monitor.forget("imu/data")
    monitor.received("imu/data")
    monitor.refused("imu/data")
    for _ in range(2):
        clock[0] += 1.0
        assert monitor.item("x").values == {}
    monitor.listens("imu/data")
    monitor.received("imu/data")
    clock[0] += 1.0
    assert monitor.item("x").values["imu/data rate [Hz]"] == "1.0"
