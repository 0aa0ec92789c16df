# ruff: noqa: E402 what follows imports ROS, which may be absent
"""What the nodes offer is what their topics have in a bag."""

from __future__ import annotations

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

import tf_messages  # noqa: F401 makes tf2_msgs importable
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy

from tirgeo_ros.io.messages.offered_qos import offered_qos
from tirgeo_ros.nodes.dji_node import DjiNode
from tirgeo_ros.nodes.ekf_node import EkfNode
from tirgeo_ros.nodes.gimbal_node import GimbalNode
from tirgeo_ros.nodes.overlay_node import OverlayNode
from tirgeo_ros.nodes.viewer_node import ViewerNode

pytestmark = pytest.mark.graph


@pytest.mark.parametrize("make", [EkfNode, GimbalNode, OverlayNode, ViewerNode, DjiNode])
def test_each_publisher_offers_what_bags_say_of_its_topic(
    environment, make, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # for the file of the targets
    words = ["--ros-args", "-p", "source:=psdk"] if make is DjiNode else []
    rclpy.init(args=words, domain_id=int(environment["ROS_DOMAIN_ID"]))
    try:
        node = make()
        offered = {one.topic_name: one.qos_profile for one in node.publishers}
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    offered.pop("/parameter_events")  # rclpy's own
    assert len(offered) > 1
    for topic, found in offered.items():
        told = offered_qos(f"/uav1{topic}")
        assert found.history == HistoryPolicy.KEEP_LAST
        assert found.reliability == ReliabilityPolicy.RELIABLE
        assert (topic, found.depth) == (topic, told.depth)
        latched = found.durability == DurabilityPolicy.TRANSIENT_LOCAL
        assert (topic, latched) == (topic, told.latched)
