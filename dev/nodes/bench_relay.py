"""A node that does nothing but pass pictures on: what a picture costs on this machine at least."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from rclpy.node import Node

from tirgeo_ros.io.messages import Messages, image_pixels, stamp_ns
from tirgeo_ros.nodes.monitor import Monitor
from tirgeo_ros.nodes.qos import IMAGE_DEPTH, output, sensor_input
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.nodes.topics import advertise, message_class, subscribe


class Relay(Node):
    """Stands in overlay_node's place: a grey picture in, the same one in colour out."""

    def __init__(self) -> None:
        super().__init__("bench_relay")
        self._messages = Messages(message_class)
        self._image = advertise(self, "tirgeo/overlay/image", output(IMAGE_DEPTH))
        self._jpeg = advertise(self, "tirgeo/overlay/image/compressed", output(IMAGE_DEPTH))
        subscribe(self, "thermal/image_raw", self._pass_on, sensor_input(1), Monitor())

    def _pass_on(self, message: Any) -> None:
        colours = np.asarray(cv2.cvtColor(image_pixels(message), cv2.COLOR_GRAY2BGR))
        if self._image.get_subscription_count():
            self._image.publish(self._messages.image(stamp_ns(message), colours))
        if self._jpeg.get_subscription_count():
            jpeg = cv2.imencode(".jpg", colours)[1].tobytes()
            self._jpeg.publish(self._messages.compressed(stamp_ns(message), jpeg))


def main() -> int:
    """Run the node; the exit code."""
    return run("bench_relay", Relay)
