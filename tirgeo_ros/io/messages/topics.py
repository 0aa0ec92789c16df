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
"""List the topics with their message types and the QoS that is offered on each."""

from __future__ import annotations

from typing import NamedTuple

from tirgeo_ros.io.messages.sensor_messages import BY_TOPIC, SENSED_TOPICS

#: Topic to type. A leading slash marks a topic that no namespace applies to.
TOPIC_TYPES: dict[str, str] = {topic: row.typename for topic, row in BY_TOPIC.items()} | {
    "thermal/image_raw": "sensor_msgs/msg/Image",
    "thermal/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
    "thermal/temperature/compressed": "sensor_msgs/msg/CompressedImage",
    "thermal/camera_info": "sensor_msgs/msg/CameraInfo",
    "tirgeo/locate/pixel": "geometry_msgs/msg/PointStamped",
    "tirgeo/odometry": "nav_msgs/msg/Odometry",
    "tirgeo/fix": "sensor_msgs/msg/NavSatFix",
    "tirgeo/origin": "sensor_msgs/msg/NavSatFix",
    "tirgeo/camera_pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "tirgeo/overlay/image": "sensor_msgs/msg/Image",
    "tirgeo/overlay/image/compressed": "sensor_msgs/msg/CompressedImage",
    "tirgeo/overlay/clean/compressed": "sensor_msgs/msg/CompressedImage",
    "tirgeo/overlay/shapes": "sensor_msgs/msg/CompressedImage",
    "tirgeo/overlay/markers": "visualization_msgs/msg/ImageMarker",
    "tirgeo/overlay/camera_info": "sensor_msgs/msg/CameraInfo",
    "tirgeo/footprint": "geometry_msgs/msg/PolygonStamped",
    "tirgeo/path": "nav_msgs/msg/Path",
    "tirgeo/locate/fix": "sensor_msgs/msg/NavSatFix",
    "tirgeo/locate/point": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "tirgeo/locate/answer": "std_msgs/msg/String",
    "tirgeo/targets": "std_msgs/msg/String",
    "tirgeo/targets/markers": "visualization_msgs/msg/MarkerArray",
    "tirgeo/findings": "std_msgs/msg/String",
    "tirgeo/state": "std_msgs/msg/String",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
}

CAMERA_INFO = "thermal/camera_info"
PICTURES = ("thermal/image_raw", "thermal/image_raw/compressed")
TEMPERATURES = "thermal/temperature/compressed"

#: For streams of which every sample counts: 2 s of an IMU at 400 Hz. A node that pauses for 2 s
#: still gets every sample, if the transport buffers as much (``config/fastdds.xml``).
STREAM_DEPTH = 800
#: A frame that waits behind another is already too late.
IMAGE_DEPTH = 2
OUTPUT_DEPTH = 20
#: The depth that tf2's own broadcasters use.
TF_DEPTH = 100
_STREAMS = (*SENSED_TOPICS, "tirgeo/odometry", "tirgeo/camera_pose")
_IMAGES = (
    *("image_raw", "image_raw/compressed"),
    *("overlay/image", "overlay/image/compressed", "overlay/camera_info"),
    *("overlay/clean/compressed", "overlay/shapes", "overlay/markers"),
)
_LATCHED = (
    *("tirgeo/origin", "tirgeo/targets", "tirgeo/targets/markers", "tirgeo/state"),
    "tf_static",
)
#: A QoS profile in the words and the order of rosbag2's metadata, version 9 (Jazzy) and later.
#: The times are ROS's infinity: what a recorder writes if the publisher sets none.
_TEXT = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""


class OfferedQos(NamedTuple):
    """Hold what a reliable publisher offers: the depth of its queue, and whether it latches."""

    depth: int
    latched: bool = False  # durability transient local: a late subscriber gets the last message

    @property
    def text(self) -> str:
        """Return the profile as rosbag2 reads it in ``offered_qos_profiles``: YAML, a list."""
        durability = "transient_local" if self.latched else "volatile"
        return _TEXT.format(depth=self.depth, durability=durability)


def prefix(namespace: str) -> str:
    """Return the prefix of a relative name: a slash, or the namespace between two slashes."""
    name = str(namespace or "").strip("/")
    return f"/{name}/" if name else "/"


def resolved(topic: str, namespace: str) -> str:
    """Return a contract topic's name in a bag.

    A name with a leading slash ignores the namespace.
    """
    return topic if topic.startswith("/") else prefix(namespace) + topic


def offered_qos(topic: str) -> OfferedQos:
    """Return the QoS that is offered on a topic, whatever its namespace."""
    if _ends(topic, _LATCHED):
        return OfferedQos(1, latched=True)
    if _ends(topic, _STREAMS):
        return OfferedQos(STREAM_DEPTH)
    if _ends(topic, ("tf",)):
        return OfferedQos(TF_DEPTH)
    return OfferedQos(IMAGE_DEPTH if _ends(topic, _IMAGES) else OUTPUT_DEPTH)


def _ends(topic: str, names: tuple[str, ...]) -> bool:
    return f"/{topic}".endswith(tuple(f"/{name}" for name in names))
