"""What the page is told of an aircraft: unknown is None, silence is told, findings are whole."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from message_samples import BODY, PLANE, SOLUTION, STATUS

from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.messages import DiagnosticItem, Messages, finding_row
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


def test_findings_reach_the_page_part_by_part():
    """A remedy with a colon was cut at it, as the text was taken apart again."""
    mend = "give the velocity in ENU: z is up; psdk_ros2: its parameter"
    found = Finding("rtk_vel_up", Severity.STOP, "up: -1.0 m/s", "rtk/vel", mend)
    message = MESSAGES.findings("/uav1/ekf_node", 5, [found])
    heard = Heard()
    assert heard.findings(100.0) is None
    heard.take_findings(100.0, message)
    assert heard.findings(100.0) == [found]
    assert finding_row(found)["remedy"] == mend
    assert heard.findings(100.1 + SILENT_S) is None  # nobody knows while nobody says
    message.data = message.data.replace("findings/1", "findings/2")
    with pytest.raises(MessageError, match="its schema is not tirgeo/findings/1"):
        heard.take_findings(100.0, message)


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
