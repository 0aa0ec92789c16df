"""The gimbal: the body's pose and the gimbal's angles in, the camera's pose out."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node

from tirgeo_ros.core.arrival import Arrivals
from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.gimbal import GimbalComposer
from tirgeo_ros.core.samples import CameraPose
from tirgeo_ros.io.messages import (
    DiagnosticItem,
    Messages,
    body_pose,
    camera_attitude,
    imu_sample,
    joint_sample,
)
from tirgeo_ros.nodes.diagnostics import Diagnostics, item_name
from tirgeo_ros.nodes.monitor import OK, Monitor
from tirgeo_ros.nodes.parameters import declare
from tirgeo_ros.nodes.qos import STREAM_DEPTH, output, sensor_input
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.nodes.topics import advertise, message_class, subscribe


class GimbalNode(Node):
    """One GimbalComposer with its topics."""

    def __init__(self) -> None:
        super().__init__("gimbal_node")
        config = declare(self, GimbalConfig)
        self._composer = GimbalComposer(config)
        self._messages = Messages(message_class)
        self._monitor = Monitor()
        self._arrivals = Arrivals()
        stream = output(STREAM_DEPTH)
        self._camera_pose = advertise(self, "tirgeo/camera_pose", stream)
        subscribe(self, "tirgeo/odometry", self._take_body, stream, self._monitor)
        self._monitor.expects("tirgeo/odometry")
        if config.composition != "paper":
            self._listen("gimbal/joint_states", self._take_joints)
        self._for_paper: dict[str, Any] = {}  # topic to subscription, while it is listened to
        self._listen_for_paper()
        self._told = ""
        self._diagnostics = Diagnostics(self, self._messages, self._monitor, self._items)

    def _listen(self, topic: str, take: Any) -> Any:
        return subscribe(self, topic, take, sensor_input(), self._monitor)

    def _take_body(self, message: Any) -> None:
        self._publish(self._composer.add_body(body_pose(message)))

    def _take_joints(self, message: Any) -> None:
        sample = self._stamped("gimbal/joint_states", joint_sample(message))
        self._publish(self._composer.add_joints(sample))

    def _take_attitude(self, message: Any) -> None:
        sample = self._stamped("gimbal/attitude", camera_attitude(message))
        self._publish(self._composer.add_attitude(sample))

    def _take_autopilot(self, message: Any) -> None:
        sample = self._stamped("imu/data", imu_sample(message))
        if sample.autopilot_q_nb is not None:
            self._publish(self._composer.add_autopilot(sample.stamp_ns, sample.autopilot_q_nb))

    def _stamped(self, topic: str, sample: Any) -> Any:
        return self._arrivals.stamped(topic, sample, self.get_clock().now().nanoseconds)

    def _publish(self, poses: list[CameraPose]) -> None:
        for pose in poses:
            self._camera_pose.publish(self._messages.camera_pose(pose))
            self._monitor.published("tirgeo/camera_pose", self.get_clock(), pose.stamp_ns)

    def _items(self) -> list[DiagnosticItem]:
        composition = self._composer.composition
        if composition != self._told:
            self.get_logger().info(f"composition: {composition}")
            self._told = composition
        self._listen_for_paper()
        name = item_name(self, "camera pose")
        values = self._composer.diagnostics | self._arrivals.diagnostics
        return [DiagnosticItem(name, OK, f"composition: {composition}", values)]

    def _listen_for_paper(self) -> None:
        """What the composition "paper" needs beside odometry: given up while encoders drive."""
        if self._composer.composition == "encoders":
            while self._for_paper:
                topic, subscription = self._for_paper.popitem()
                self.destroy_subscription(subscription)
                self._monitor.forget(topic)
        elif not self._for_paper:
            takers = {"gimbal/attitude": self._take_attitude, "imu/data": self._take_autopilot}
            self._for_paper = {topic: self._listen(topic, take) for topic, take in takers.items()}


def main() -> int:
    """Run the node; the exit code."""
    return run("gimbal_node", GimbalNode)
