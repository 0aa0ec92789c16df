"""What the page is told of an aircraft: unknown is None, silence is told, findings are whole."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from message_samples import BODY, PLANE, SOLUTION, STATUS

from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.messages import DiagnosticItem, Messages
from tirgeo_ros.nodes import aircraft_state as told
from tirgeo_ros.nodes.aircraft_state import SILENT_S, Heard, TrackNews

MESSAGES = Messages(Cdr().types)


def status_of(item):
    return MESSAGES.diagnostics(0, [item]).status[0]


@pytest.fixture
def heard():
    """An estimator and two nodes' items, heard at 100 s."""
    found = Heard()
    found.take(
        100.0, "ekf_node: navigation", status_of(MESSAGES.navigation_diagnostic("", STATUS))
    )
    stop = Finding(
        "map_empty", Severity.STOP, "no feature: 0 of 3", "overlay_node map", "give one"
    )
    values = {
        "levers": "NOTE: all are zero: ekf_node aircraft: measure",
        "map_empty": f"STOP: {stop.line}",
    }
    found.take(100.0, "overlay_node: set-up", status_of(DiagnosticItem("", 2, "NO GO", values)))
    ages = {"rtk/fix age [s]": "0.25", "imu/data age [s]": "nan"}
    found.take(100.0, "ekf_node: topics", status_of(DiagnosticItem("", 0, "ok", ages)))
    return found


def test_the_estimators_state_is_passed_on_until_it_is_silent(heard):
    fields = told.navigation_fields(heard, 101.0)
    assert fields["navigation"] == {"state": "aligning", "reason": "too slow"}
    assert fields["rtk"] == "float"
    assert fields["heading_sigma_deg"] == pytest.approx(math.degrees(0.0123))
    silent = told.navigation_fields(heard, 100.1 + SILENT_S)
    assert silent["navigation"] == {"state": "lost", "reason": "nothing is heard of ekf_node"}
    assert silent["rtk"] is None
    assert told.navigation_fields(Heard(), 0.0)["navigation"]["state"] == "waiting"


def test_findings_come_worst_first_and_decide_go(heard):
    fields = told.setup_fields(heard.of(101.0, "set-up"))
    assert fields["go"] is False
    assert fields["findings"] == [
        {
            "severity": "STOP",
            "title": "map empty",
            "text": "no feature: 0 of 3: overlay_node map",
            "mend": "give one",
        },
        {
            "severity": "NOTE",
            "title": "levers",
            "text": "all are zero: ekf_node aircraft",
            "mend": "measure",
        },
    ]
    assert told.setup_fields([{}])["go"] is True
    # Nobody knows while nobody says.
    assert told.setup_fields(heard.of(100.1 + SILENT_S, "set-up")) == {"findings": [], "go": None}


def test_numbers_that_are_none_are_none(heard):
    assert heard.number(101.0, "topics", "rtk/fix age [s]") == 0.25
    assert heard.number(101.0, "topics", "imu/data age [s]") is None
    assert heard.number(101.0, "topics", "absent") is None
    assert told.number("fast") is None


def test_the_position_is_that_of_the_odometry():
    odometry = MESSAGES.odometry(SOLUTION, BODY)
    level_n = BODY.position_n + np.array([[5, 5, 12.0], [9, 5, 12.0], [5, 9, 12.0]])
    fields = told.position_fields(odometry, PLANE, level_n)
    place = np.radians(fields["position"][:2])
    off_n = PLANE.ned_from_geodetic(*place, fields["position"][2]) - BODY.position_n
    np.testing.assert_allclose(off_n, 0.0, atol=1e-2)
    assert fields["above_ground_m"] == pytest.approx(12.0)
    north, east, _ = SOLUTION.velocity_n
    assert fields["speed_m_s"] == pytest.approx(math.hypot(north, east))
    worst = np.linalg.eigvalsh(BODY.covariance[:2, :2])[-1]
    assert fields["position_sigma_m"] == pytest.approx(math.sqrt(worst))
    nowhere = told.position_fields(odometry, PLANE, np.empty((0, 3)))
    assert math.isnan(nowhere["above_ground_m"])  # which the server sends as null


def test_only_new_points_of_the_track_are_told():
    news = TrackNews()
    first = [[48.0, 16.0], [48.1, 16.0], [48.2, 16.0]]
    assert news.fresh(first) == {"track": first, "track_from": 0}
    assert news.fresh(first) == {"track": [], "track_from": 3}
    moved = [*first[:2], [48.15, 16.0], [48.3, 16.0]]  # the last one is where it was just now
    assert news.fresh(moved) == {"track": moved[2:], "track_from": 2}
    thinned = moved[::2]
    assert news.fresh(thinned) == {"track": thinned[1:], "track_from": 1}
    assert news.fresh([]) == {"track": [], "track_from": 0}
