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
"""Send a video with its poses to the overlay, for ``make bench``.

When it ends it writes the stamps of its frames as JSON to the file of its parameter ``output``.
"""

from __future__ import annotations

import math
import time
from functools import partial
from typing import Any

import numpy as np

from dev.nodes.bench_listener import until_over
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.frames.rotations import Q_BODY_OPTICAL, quat_from_euler, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.messages.topics import IMAGE_DEPTH
from tirgeo_ros.nodes.graph_node import GraphNode, latched, output
from tirgeo_ros.nodes.runner import run

FRAME_HZ, POSE_HZ = 30.0, 50.0


def scaled(camera: Camera, times: int) -> Camera:
    """Return the camera with as many times the pixels on each side, and the same view."""
    width, height, fx, fy = (
        times * each for each in (camera.width, camera.height, camera.fx, camera.fy)
    )
    cx, cy = (times * (each + 0.5) - 0.5 for each in (camera.cx, camera.cy))
    return Camera(round(width), round(height), fx, fy, cx, cy, camera.distortion)


class VideoSource(GraphNode):
    """Send frames, camera poses, camera info and origin, each stamped as it is sent."""

    def __init__(self) -> None:
        super().__init__("bench_video")
        parameter = self.declare_parameter
        self.duration_s = parameter("duration_s", 10.0).value
        self.output = parameter("output", "").value
        latitude, longitude, height_m = parameter("origin_rad_m", [0.0, 0.0, 0.0]).value
        camera = scaled(XT2, parameter("times", 1).value)
        above_m, pitch_deg = parameter("camera_m_deg", [20.0, -30.0]).value
        self._position_n = np.array([0.0, 0.0, -above_m])
        self._q_nc = quat_multiply(
            quat_from_euler(0.0, math.radians(pitch_deg), 0.0), Q_BODY_OPTICAL
        )
        self._sent: list[int] = []
        messages = self.messages
        shape = camera.height, camera.width
        grey = np.random.default_rng(1).integers(60, 180, shape, np.uint8)
        self._frame, self._camera = messages.image(0, grey), camera
        self._image = self.advertise("thermal/image_raw", output(IMAGE_DEPTH))
        self._info = self.advertise("thermal/camera_info", output(1))
        self._pose = self.advertise("tirgeo/camera_pose", output())
        self._origin = self.advertise("tirgeo/origin", latched())
        self._origin.publish(messages.origin(TangentPlane(latitude, longitude, height_m), 0))
        self.create_timer(1 / FRAME_HZ, self._send_frame)
        self.create_timer(1 / POSE_HZ, self._send_pose)

    def _send_frame(self) -> None:
        if len(self._sent) % round(FRAME_HZ) == 0:
            self._info.publish(self.messages.camera_info(self._camera, time.time_ns()))
        now_ns = time.time_ns()
        stamp = self._frame.header.stamp
        stamp.sec, stamp.nanosec = divmod(now_ns, 1_000_000_000)
        self._image.publish(self._frame)
        self._sent.append(now_ns)

    def _send_pose(self) -> None:
        pose = CameraPose(time.time_ns(), self._position_n, self._q_nc, np.eye(6) * 1e-4)
        self._pose.publish(self.messages.camera_pose(pose))

    def found(self) -> dict[str, Any]:
        """Return what is written at the end."""
        return {"sent": self._sent}


main = partial(run, "bench_video", VideoSource, until_over)
