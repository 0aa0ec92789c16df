"""What of the estimator's status comes into the log, and how loud."""

from __future__ import annotations

import math

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import KeptLog

from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus
from tirgeo_ros.nodes.ekf_node import StateLog


def status(state: FilterState, reason: str = "", **more: object) -> NavigationStatus:
    return NavigationStatus("ekf", state, reason, FixStatus.FIXED, math.nan, {}, {}, **more)


def test_a_transition_is_told_once_and_a_worse_state_is_a_warning():
    node = KeptLog()
    log = StateLog(node)
    given = (
        status(FilterState.WAITING),
        status(FilterState.WAITING, "needs rtk/vel", state_s=1.0),
        status(FilterState.ALIGNING, "too slow"),
        status(FilterState.RUNNING),
        status(FilterState.DEGRADED, "rtk/heading"),
        status(FilterState.LOST, "position"),
        status(FilterState.ALIGNING),
    )
    assert [log.note(one) for one in given] == [True, False, True, True, True, True, True]
    assert node.lines == [
        ("info", "ekf: waiting"),
        ("info", "ekf: aligning: too slow"),
        ("info", "ekf: running"),
        ("warning", "ekf: degraded: rtk/heading"),
        ("warning", "ekf: lost: position"),
        ("info", "ekf: aligning"),
    ]


def test_every_reset_is_told_once_with_what_it_changed():
    node, running = KeptLog(), FilterState.RUNNING
    log = StateLog(node)
    once = {"resets": {"rtk_position": 1}, "last_reset": "position by 3.2 m"}
    both = {"resets": {"rtk_position": 1, "rtk_heading": 1}, "last_reset": "heading by 170 deg"}
    given = (status(running), *[status(running, **once)] * 2, status(running, **both))
    assert [log.note(one) for one in given] == [True, True, False, True]
    assert node.texts("warning") == [
        "reset by rtk_position: position by 3.2 m",
        "reset by rtk_heading: heading by 170 deg",
    ]


def test_another_reason_is_told_when_asked_for():
    node = KeptLog()
    log = StateLog(node)
    for reason, reasons in (("a", False), ("b", False), ("b", True), ("b", True)):
        log.note(status(FilterState.WAITING, reason), reasons=reasons)
    assert node.texts() == ["ekf: waiting: a", "ekf: waiting: b"]


def test_ros_takes_both_severities():
    """Its logger raises where one line of code logs with two of them."""
    logging = pytest.importorskip("rclpy.logging", reason="needs ROS 2 or its wheels")

    class Node(KeptLog):
        def get_logger(self):
            return logging.get_logger("test_state_log")

    log = StateLog(Node())
    for state in (FilterState.RUNNING, FilterState.DEGRADED, FilterState.RUNNING):
        assert log.note(status(state))
