"""What of the estimator's status comes into the log, and how loud."""

from __future__ import annotations

import math

import pytest
from kept_log import KeptLog

from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus
from tirgeo_ros.nodes.filter_status_log import StateLog


def status(state: FilterState, reason: str = "", **more: object) -> NavigationStatus:
    return NavigationStatus("ekf", state, reason, FixStatus.FIXED, math.nan, {}, {}, **more)


def told(*statuses: NavigationStatus) -> tuple[list[tuple[str, str]], list[bool]]:
    logger = KeptLog()
    log = StateLog(logger)
    changes = [log.note(item) for item in statuses]
    return logger.lines, changes


def test_a_transition_is_told_once_and_a_worse_state_is_a_warning():
    lines, changes = told(
        status(FilterState.WAITING),
        status(FilterState.WAITING, state_s=1.0),
        status(FilterState.ALIGNING, "too slow"),
        status(FilterState.RUNNING),
        status(FilterState.RUNNING, state_s=9.0),
        status(FilterState.DEGRADED, "rtk/heading"),
        status(FilterState.DEAD_RECKONING, "rtk/fix"),
        status(FilterState.LOST, "position"),
        status(FilterState.ALIGNING),
    )
    assert lines == [
        ("info", "ekf: waiting"),
        ("info", "ekf: aligning: too slow"),
        ("info", "ekf: running"),
        ("warning", "ekf: degraded: rtk/heading"),
        ("warning", "ekf: dead_reckoning: rtk/fix"),
        ("warning", "ekf: lost: position"),
        ("info", "ekf: aligning"),
    ]
    assert changes == [True, False, True, True, False, True, True, True, True]


def test_every_reset_is_told_once_with_what_it_changed():
    running = FilterState.RUNNING
    once = {"resets": {"rtk_position": 1}, "last_reset": "position by 3.2 m"}
    both = {"resets": {"rtk_position": 1, "rtk_heading": 1}, "last_reset": "heading by 170 deg"}
    lines, changes = told(
        status(running), status(running, **once), status(running, **once), status(running, **both)
    )
    assert lines[1:] == [
        ("warning", "reset by rtk_position: position by 3.2 m"),
        ("warning", "reset by rtk_heading: heading by 170 deg"),
    ]
    assert changes == [True, True, False, True]


def test_another_reason_is_told_when_asked_for():
    logger = KeptLog()
    log = StateLog(logger)
    for reason in ("needs rtk/fix", "needs rtk/vel", "needs rtk/vel"):
        log.note(status(FilterState.WAITING, reason))
    assert [text for _, text in logger.lines] == ["ekf: waiting: needs rtk/fix"]
    for _ in range(2):
        log.note_reason(status(FilterState.WAITING, "needs rtk/vel"))
    assert logger.lines[1:] == [("info", "ekf: waiting: needs rtk/vel")]


def test_ros_takes_what_is_told():
    """Its logger raises where one line of code logs with two severities."""
    logging = pytest.importorskip("rclpy.logging", reason="needs ROS 2 or its wheels")
    log = StateLog(logging.get_logger("test_state_log"))
    for state in (FilterState.RUNNING, FilterState.DEGRADED, FilterState.RUNNING):
        assert log.note(status(state))
