"""The gimbal: the body's pose and the gimbal's angles in, the camera's pose out."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.node import Node

from tirgeo_ros.core.checks.gimbal_checks import GimbalChecks
from tirgeo_ros.core.checks.parameter_checks import parameter_findings
from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.gimbal.composer import GimbalComposer
from tirgeo_ros.core.streams.arrival_stamps import Arrivals
from tirgeo_ros.core.types.poses import CameraPose
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
from tirgeo_ros.nodes.parameters import declare, given_names
from tirgeo_ros.nodes.qos import STREAM_DEPTH, output, sensor_input
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.nodes.setup_checks import InputChecks, SetupChecks
from tirgeo_ros.nodes.topics import advertise, message_class, subscribe


class GimbalNode(Node):
    """Connect one GimbalComposer with its topics."""

    def __init__(self) -> None:
        super().__init__("gimbal_node")
        config = declare(self, GimbalConfig)
        self._composer = GimbalComposer(config)
        self._messages = Messages(message_class)
        self._monitor = Monitor()
        given = given_names(self, GimbalConfig)
        self._checks = GimbalChecks(config, given)
        known = parameter_findings(given, (), "", pictures=True, option="--params-file")
        self._setup = SetupChecks(
            self,
            self._monitor,
            InputChecks(self, self._monitor, ("gimbal/joint_states", "gimbal/attitude")),
            self._checks,
            known=known,
        )
        self._arrivals = Arrivals()
        stream = output(STREAM_DEPTH)
        self._camera_pose = advertise(self, "tirgeo/camera_pose", stream)
        subscribe(self, "tirgeo/odometry", self._take_body, stream, self._monitor)
        self._monitor.expects("tirgeo/odometry")
        if config.composition != "paper":
            self._listen("gimbal/joint_states", self._take_joints)
        self._listen("gimbal/attitude", self._take_attitude)
        self._imu: Any = None  # the subscription, or None while there is none
        self._listen_for_paper()
        self._logged_composition = ""
        self._diagnostics = Diagnostics(self, self._messages, self._monitor, self._items)

    def _listen(self, topic: str, take: Any) -> Any:
        return subscribe(self, topic, take, sensor_input(), self._monitor)

    def _take_body(self, message: Any) -> None:
        pose = body_pose(message)
        self._publish(self._composer.add_body(pose))
        self._setup.take(self._checks.body, pose)

    def _take_joints(self, message: Any) -> None:
        sample = self._stamped("gimbal/joint_states", joint_sample(message))
        self._publish(self._composer.add_joints(sample))
        self._setup.take(self._checks.joints, sample)

    def _take_attitude(self, message: Any) -> None:
        sample = self._stamped("gimbal/attitude", camera_attitude(message))
        if self._imu is not None:  # the checks below compare it with the joint angles in any case
            self._publish(self._composer.add_attitude(sample))
        self._setup.take(self._checks.reported, sample)

    def _take_autopilot(self, message: Any) -> None:
        sample = self._stamped("imu/data", imu_sample(message))
        if sample.autopilot_q_nb is not None:
            self._publish(self._composer.add_autopilot(sample.stamp_ns, sample.autopilot_q_nb))
            self._setup.take(self._checks.autopilot, sample.stamp_ns, sample.autopilot_q_nb)

    def _stamped(self, topic: str, sample: Any) -> Any:
        return self._arrivals.stamped(topic, sample, self.get_clock().now().nanoseconds)

    def _publish(self, poses: list[CameraPose]) -> None:
        for pose in poses:
            self._camera_pose.publish(self._messages.camera_pose(pose))
            self._monitor.published("tirgeo/camera_pose", self.get_clock(), pose.stamp_ns)

    def _items(self) -> list[DiagnosticItem]:
        composition = self._composer.composition
        if composition != self._logged_composition:
            self.get_logger().info(f"composition: {composition}")
            self._logged_composition = composition
        self._listen_for_paper()
        name = item_name(self, "camera pose")
        values = self._composer.diagnostics | self._arrivals.diagnostics
        item = DiagnosticItem(name, OK, f"composition: {composition}", values)
        return [item, self._setup.item()]

    def _listen_for_paper(self) -> None:
        """Subscribe to the IMU, which the composition "paper" needs.

        Unsubscribe while encoders are used.
        """
        if self._composer.composition != "encoders":
            self._imu = self._imu or self._listen("imu/data", self._take_autopilot)
        elif self._imu is not None:
            self.destroy_subscription(self._imu)
            self._monitor.forget("imu/data")
            self._imu = None


main = partial(run, "gimbal_node", GimbalNode)
