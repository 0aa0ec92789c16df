# ruff: noqa: E402 what follows imports ROS, which may be absent
"""A hover without any heading: the filter asks for one, is given one as RViz does, and runs."""

from __future__ import annotations

import math

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from flights import flight
from geometry_msgs.msg import PoseWithCovarianceStamped
from graph_helpers import await_words
from nav_msgs.msg import Odometry
from process_bags import write_hover

from tirgeo_ros.core.frames.heading import heading_of, wrapped
from tirgeo_ros.io.messages import body_pose

pytestmark = pytest.mark.graph
TOPIC, ITEM, SIGMA_DEG = "/ekf_node/set_heading", "/ekf_node: navigation", 2.0


@pytest.fixture(scope="module")
def hover(tmp_path_factory):
    """A hover whose bag has no rtk/heading and no attitude of the autopilot."""
    flown = flight(1, 25.0, "hover")
    return flown, write_hover(tmp_path_factory.mktemp("hover") / "hover.mcap", flown)


def heading(heading_rad: float, sigma_deg: float = SIGMA_DEG, frame: str = "map"):
    """A pose of which only yaw and its variance count, with the stamp 0: now."""
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame
    message.pose.pose.position.x = 17.0
    yaw = 0.5 * math.pi - heading_rad
    turned = message.pose.pose.orientation
    turned.z, turned.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    message.pose.covariance[35] = math.radians(sigma_deg) ** 2
    return message


@pytest.mark.slow
def test_the_filter_begins_with_a_heading_that_is_set(spawn, meet, hover):
    flown, bag = hover
    true_rad = heading_of(flown.truth.q_nb[0])  # it keeps still
    clock = ("-p", "use_sim_time:=true")
    node = spawn("ekf_node", "-p", "method:=ekf", *clock)
    await_words(node, "ready")
    stranger = meet(**{"/diagnostics": DiagnosticArray, "/tirgeo/odometry": Odometry})
    count = "count.set_heading."

    def told(name: str) -> int:
        return int(stranger.diagnostic(ITEM).get(count + name, 0))

    # Refused with the reason: not finite, too early, in another frame.
    wrong = heading(math.nan), heading(true_rad), heading(true_rad, frame="base_link")
    stranger.send(
        {TOPIC: list(wrong)},
        lambda: told("invalid") and told("standby") and "its frame is" in node.text(),
    )
    assert "~/set_heading: standby: the alignment does not wait for a heading" in node.text()
    spawn("bag_player", "-p", f"bag:={bag}", "-p", "wait_for:=imu/data,rtk/fix,rtk/vel")
    stranger.spin_until(lambda: "~/set_heading" in stranger.diagnostic(ITEM).get("reason", ""))
    stranger.send({TOPIC: [heading(true_rad)]}, lambda: told("used"))
    stranger.spin_until(lambda: stranger.received["/tirgeo/odometry"])
    first = body_pose(stranger.received["/tirgeo/odometry"][0])
    sigma_rad = math.sqrt(first.covariance[5, 5])
    assert abs(wrapped(heading_of(first.q_nb) - true_rad)) < 3 * sigma_rad
    # The gyroscopes' bias adds to it, 0.4 deg/s since it was said.
    assert math.radians(0.9 * SIGMA_DEG) < sigma_rad < math.radians(4 * SIGMA_DEG)
    assert "~/set_heading: used: the filter begins with it" in node.text()
