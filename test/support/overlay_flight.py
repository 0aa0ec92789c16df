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
"""A camera that stands still, as messages, for overlay_node over DDS."""

from __future__ import annotations

import json
import time

import numpy as np
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
from overlays import GREY, PLANE, ink_on, pose_at
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image, NavSatFix

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.io.messages.pictures import image_pixels
from tirgeo_ros.nodes.graph_node import Output

MESSAGES = Messages()
ITEM = "/overlay_node: overlay"


def has_lines(picture: Image) -> bool:
    ink = ink_on(image_pixels(picture))
    return (ink[:, 1] > 150).sum() > 100  # a notice stands above


def write_map(path, ring_n) -> None:
    latitude, longitude, _ = np.degrees(PLANE.geodetic_from_ned(ring_n))
    ring = np.column_stack([longitude, latitude]).tolist()
    geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    path.write_text(json.dumps({"type": "Feature", "properties": {}, "geometry": geometry}))


class Flight:
    """A camera that stands still, its video, and what overlay_node makes of it.

    ``prefix`` is its namespace, as uav1/; ``north`` is where it stands.
    """

    def __init__(self, stranger, prefix: str = "", north: float = 0.0) -> None:
        self.stranger, self.prefix, self.north = stranger, prefix, north
        node = stranger.node
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.origin = Output(node.create_publisher(NavSatFix, prefix + "tirgeo/origin", latched))
        self.origin.publish(MESSAGES.origin(PLANE, 0))
        self.info = Output(node.create_publisher(CameraInfo, prefix + "thermal/camera_info", 1))
        self.image = Output(node.create_publisher(Image, prefix + "thermal/image_raw", 1))
        pose = prefix + "tirgeo/camera_pose"
        self.pose = Output(node.create_publisher(PoseWithCovarianceStamped, pose, 10))
        self.pixel = node.create_publisher(PointStamped, prefix + "tirgeo/locate/pixel", 10)
        self.sent_s = 0.0
        self.unstamped = False

    def step(self) -> None:
        """Twenty frames a second, each with its pose."""
        if time.monotonic() - self.sent_s < 0.05:
            return
        self.sent_s = time.monotonic()
        now_ns = time.time_ns()
        self.info.publish(MESSAGES.camera_info(XT2, now_ns))
        self.pose.publish(MESSAGES.camera_pose(pose_at(now_ns, self.north)))
        self.image.publish(MESSAGES.image(0 if self.unstamped else now_ns, GREY))

    def until(self, done, timeout_s: float = 60.0) -> None:
        def stepped() -> bool:
            self.step()
            return done()

        self.stranger.spin_until(stepped, timeout_s)

    def shown(self) -> Image:
        """The next picture with lines."""
        pictures = self.stranger.received["tirgeo/overlay/image"]
        pictures.clear()
        self.until(lambda: pictures and has_lines(pictures[-1]))
        return pictures[-1]

    def diagnostics(self, item: str = ITEM) -> dict[str, str]:
        return self.stranger.diagnostic(item)

    def next_diagnostics(self) -> dict[str, str]:
        """Those of the next second: what has been published may not have come yet."""
        self.stranger.received["/diagnostics"].clear()
        self.until(self.diagnostics)
        return self.diagnostics()

    def click(self, u: float, v: float, stamp: int = 0) -> None:
        message = PointStamped()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.point.x, message.point.y = u, v
        self.pixel.publish(message)
