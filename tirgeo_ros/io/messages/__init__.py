"""Convert ROS messages to samples and back.

Only this package knows the messages' layouts, frames and topics. It reads rclpy's messages and its
own alike: their attributes have the same names.
"""

from tirgeo_ros.io.messages.json_codec import (
    FINDINGS_TOPIC as FINDINGS_TOPIC,
    STATE_TOPIC as STATE_TOPIC,
    NodeState as NodeState,
    PictureState as PictureState,
    TopicState as TopicState,
    answer_of as answer_of,
    finding_row as finding_row,
    findings_of as findings_of,
    node_state as node_state,
    targets_of as targets_of,
)
from tirgeo_ros.io.messages.message_parts import stamp_ns as stamp_ns
from tirgeo_ros.io.messages.result_messages import (
    DiagnosticItem as DiagnosticItem,
    Messages as Messages,
    body_pose as body_pose,
    camera_pose as camera_pose,
    navigation_item as navigation_item,
    pixel as pixel,
    tangent_plane as tangent_plane,
)
from tirgeo_ros.io.messages.sensor_messages import (
    DJI_TOPICS as DJI_TOPICS,
    NAVIGATION_INPUTS as NAVIGATION_INPUTS,
    SENSED_SAMPLES as SENSED_SAMPLES,
    SENSED_TOPICS as SENSED_TOPICS,
    SensedSample as SensedSample,
    camera_attitude as camera_attitude,
    imu_sample as imu_sample,
    joint_sample as joint_sample,
    sensed as sensed,
    topic_of as topic_of,
)
from tirgeo_ros.io.messages.topics import TOPIC_TYPES as TOPIC_TYPES
