"""Send a video with its poses to the overlay, for ``make bench``.

When it ends it writes the stamps of its frames as JSON to the file of its parameter ``output``.
"""

from __future__ import annotations

import json
import math
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import quat_from_euler, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.qos import IMAGE_DEPTH, latched, output
from tirgeo_ros.nodes.runner import run

FRAME_HZ, POSE_HZ = 30.0, 50.0


class VideoSource(GraphNode):
    """Frames, camera poses, camera info and origin, each stamped as it is sent."""

    def __init__(self, node_name: str = "bench_video") -> None:
        super().__init__(node_name)
        parameter = self.declare_parameter
        self.duration_s = parameter("duration_s", 10.0).value
        self.output = parameter("output", "").value
        latitude, longitude, height_m = parameter("origin_rad_m", [0.0, 0.0, 0.0]).value
        above_m, pitch_deg = parameter("camera_m_deg", [20.0, -30.0]).value
        self._position_n = np.array([0.0, 0.0, -above_m])
        self._q_nc = quat_multiply(
            quat_from_euler(0.0, math.radians(pitch_deg), 0.0), Q_BODY_OPTICAL
        )
        self._sent: list[int] = []
        messages = self.messages
        grey = np.random.default_rng(1).integers(60, 180, (XT2.height, XT2.width), np.uint8)
        self._frame = messages.image(0, grey)
        self._image = self.advertise("thermal/image_raw", output(IMAGE_DEPTH))
        self._info = self.advertise("thermal/camera_info", output(1))
        self._pose = self.advertise("tirgeo/camera_pose", output())
        self._origin = self.advertise("tirgeo/origin", latched())
        self._origin.publish(messages.origin(TangentPlane(latitude, longitude, height_m), 0))
        self.create_timer(1 / FRAME_HZ, self._send_frame)
        self.create_timer(1 / POSE_HZ, self._send_pose)

    def _send_frame(self) -> None:
        if len(self._sent) % round(FRAME_HZ) == 0:
            self._info.publish(self.messages.camera_info(XT2, time.time_ns()))
        now_ns = time.time_ns()
        stamp = self._frame.header.stamp
        stamp.sec, stamp.nanosec = divmod(now_ns, 1_000_000_000)
        self._image.publish(self._frame)
        self._sent.append(now_ns)

    def _send_pose(self) -> None:
        pose = CameraPose(time.time_ns(), self._position_n, self._q_nc, np.eye(6) * 1e-4)
        self._pose.publish(self.messages.camera_pose(pose))

    def found(self) -> dict[str, Any]:
        """What is written at the end."""
        return {"sent": self._sent}


def until_over(node: Any, stop: threading.Event) -> int:
    """Let a node work for its ``duration_s``, then write what it found to its ``output``."""
    stop.wait(node.duration_s)
    Path(node.output).write_text(json.dumps(node.found()))
    return 0


main = partial(run, "bench_video", VideoSource, until_over)
