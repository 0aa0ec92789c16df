"""Publish the transforms between the frames on /tf and /tf_static, where tf2_msgs is installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.config.aircraft_parameters import TransformsConfig
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.io.messages.sensor_messages import TF_DEPTH
from tirgeo_ros.nodes.graph_node import GraphNode, latched, message_class, output
from tirgeo_ros.nodes.monitor import OK

if TYPE_CHECKING:
    from rclpy.publisher import Publisher


class Transforms:
    """Publish transforms while someone listens, the fixed ones once; none without tf2_msgs."""

    def __init__(self, node: GraphNode, config: TransformsConfig) -> None:
        self._node = node
        self._tf: Publisher | None = None
        self._tf_static: Publisher | None = None
        if not config.publish_tf:
            return
        try:
            message_class(TOPIC_TYPES["/tf"])
        except ConfigError:
            node.log(OK, "no /tf: tf2_msgs is not installed (apt: ros-jazzy-tf2-msgs)")
            return
        self._tf = node.advertise("/tf", output(TF_DEPTH))

    def fixed(self, aircraft: AircraftConfig) -> None:
        """Publish where antennas, gimbal and IMU are on the aircraft."""
        if self._tf is not None:
            messages = self._node.messages
            self._tf_static = self._node.advertise("/tf_static", latched())
            transforms = messages.fixed_transforms(aircraft, self._node.now_ns)
            self._tf_static.publish(messages.tf(transforms))

    def body(self, pose: BodyPose) -> None:
        """Publish map -> base_link."""
        if self._tf is not None and self._tf.get_subscription_count():
            messages = self._node.messages
            self._tf.publish(messages.tf([messages.body_transform(pose)]))

    def camera(self, pose: CameraPose, body_at: Callable[[int], BodyPose | Miss]) -> None:
        """Publish base_link -> camera; ``body_at`` gives the pose that the camera's is made of."""
        if self._tf is not None and self._tf.get_subscription_count():
            messages, body = self._node.messages, body_at(pose.stamp_ns)
            if not isinstance(body, Miss):
                self._tf.publish(messages.tf([messages.camera_transform(body, pose)]))
