"""A second graph in the same domain is named; what a killed node leaves behind is none."""

from __future__ import annotations

import signal
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import await_words
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.io.messages import NodeState
from tirgeo_ros.nodes import setup_checks
from tirgeo_ros.nodes.setup_checks import OtherPublishers, Restarts

pytestmark = pytest.mark.graph
ODOMETRY, POSE = "/tirgeo/odometry", "/tirgeo/camera_pose"


def test_a_second_publisher_is_a_finding_that_names_it_once_it_lasts(meet):
    stranger, other = meet(), meet().node
    own = stranger.node
    own.create_publisher(Odometry, "tirgeo/odometry", 1)
    own.create_subscription(Imu, "imu/data", print, 1)
    watch = OtherPublishers(own)
    assert not any(watch.findings() for _ in range(100))
    for topic, kind in (("tirgeo/odometry", Odometry), ("imu/data", Imu), ("imu/data", Imu)):
        other.create_publisher(kind, topic, 1)

    def named(topic):  # DDS brings a node's name after its publishers
        return [one.node_name for one in own.get_publishers_info_by_topic(topic)]

    twice = (ODOMETRY, "/imu/data")
    stranger.spin_until(lambda: all(named(topic) == ["stranger"] * 2 for topic in twice))
    (twin,) = watch.findings()
    assert (twin.severity, twin.parameter) == (Severity.STOP, "tirgeo/odometry")
    assert twin.evidence == "/tirgeo/odometry has 2 publishers: /stranger, /stranger"
    counts = [len(watch.findings()) for _ in range(30)]
    assert counts == [1] * 24 + [2] * 6
    assert watch.findings()[1].severity is Severity.CAUTION
    # At a node's start the other may be what its killed predecessor left.
    fresh = OtherPublishers(own)
    assert [len(fresh.findings()) for _ in range(30)] == [0] * 25 + [2] * 5


@pytest.mark.slow
def test_a_second_filter_is_found_and_a_killed_node_is_not(spawn, meet):
    stranger = meet(**{"/diagnostics": DiagnosticArray})
    ekf, gimbal = spawn("ekf_node"), spawn("gimbal_node")
    await_words(ekf, "ready")
    await_words(gimbal, "ready")
    stranger.spin_until(lambda: stranger.node.count_publishers(POSE) == 1)
    gimbal.signal(signal.SIGKILL)
    gimbal.wait(10.0)
    spawn("gimbal_node")
    stranger.spin_until(lambda: stranger.node.count_publishers(POSE) == 2)
    stranger.spin_until(lambda: stranger.node.count_publishers(POSE) == 1)  # the lease is over
    await_words(spawn("ekf_node"), "ready")

    check = "publishers_of_tirgeo_odometry"
    stranger.spin_until(lambda: check in stranger.diagnostic("/ekf_node: set-up"))
    line = stranger.diagnostic("/ekf_node: set-up")[check]
    assert line.startswith("STOP: /tirgeo/odometry has 2 publishers: /ekf_node, /ekf_node: ")
    heard = [one for array in stranger.received["/diagnostics"] for one in array.status]
    checks = {item.key for one in heard for item in one.values}
    assert "publishers_of_tirgeo_camera_pose" not in checks


def test_each_new_start_of_a_node_counts_once(monkeypatch):
    clock, restarts = [100.0], Restarts()
    monkeypatch.setattr(setup_checks, "time", SimpleNamespace(monotonic=lambda: clock[0]))

    def said(node, started_ns):
        restarts.take(NodeState(f"/uav1/{node}", 0, started_ns))

    for started_ns in (1, 1, 2, 1, 3):
        said("ekf_node", started_ns)
    said("overlay_node", 4)
    said("video_writer", 5)
    said("video_writer", 6)  # each recording starts one
    (found,) = restarts.findings()
    assert found.evidence == "ekf_node ended and was started again; restarts so far: 2"
    assert found.severity is Severity.CAUTION
    clock[0] += 61.0
    assert [one.severity for one in restarts.findings()] == [Severity.NOTE]
