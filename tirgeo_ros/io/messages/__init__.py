"""Convert ROS messages to samples and back.

Only this package knows the messages' layouts, frames and topics. It works with the message classes
of rclpy and with those of rosbags: their attributes and keyword arguments have the same names.
"""

from tirgeo_ros.io.messages.json_codec import (
    FINDINGS_TOPIC,
    STATE_TOPIC,
    NodeState,
    PictureState,
    TopicState,
    answer_of,
    finding_row,
    findings_of,
    node_state,
    targets_of,
)
from tirgeo_ros.io.messages.message_parts import stamp_ns
from tirgeo_ros.io.messages.result_messages import (
    DiagnosticItem,
    Messages,
    body_pose,
    camera_pose,
    navigation_item,
    pixel,
    tangent_plane,
)
from tirgeo_ros.io.messages.sensor_messages import (
    DJI_TOPICS,
    NAVIGATION_INPUTS,
    SENSED_SAMPLES,
    SENSED_TOPICS,
    SensedSample,
    camera_attitude,
    imu_sample,
    joint_sample,
    sensed,
    topic_of,
)
from tirgeo_ros.io.messages.topics import TOPIC_TYPES

__all__ = [
    "DJI_TOPICS",
    "FINDINGS_TOPIC",
    "NAVIGATION_INPUTS",
    "SENSED_SAMPLES",
    "SENSED_TOPICS",
    "STATE_TOPIC",
    "TOPIC_TYPES",
    "DiagnosticItem",
    "Messages",
    "NodeState",
    "PictureState",
    "SensedSample",
    "TopicState",
    "answer_of",
    "body_pose",
    "camera_attitude",
    "camera_pose",
    "finding_row",
    "findings_of",
    "imu_sample",
    "joint_sample",
    "navigation_item",
    "node_state",
    "pixel",
    "sensed",
    "stamp_ns",
    "tangent_plane",
    "targets_of",
    "topic_of",
]
