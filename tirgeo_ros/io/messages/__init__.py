# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
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
