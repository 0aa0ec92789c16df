"""Pass pictures on and do no more: the least that a picture costs on this machine."""

from __future__ import annotations

from functools import partial
from typing import Any

import cv2
import numpy as np

from tirgeo_ros.io.messages import image_pixels, stamp_ns
from tirgeo_ros.io.messages.sensor_messages import IMAGE_DEPTH
from tirgeo_ros.nodes.graph_node import GraphNode, output, sensor_input
from tirgeo_ros.nodes.runner import run


class Relay(GraphNode):
    """Take overlay_node's place: a grey picture in, the same one in colour out."""

    def __init__(self) -> None:
        super().__init__("bench_relay")
        self._image = self.advertise("tirgeo/overlay/image", output(IMAGE_DEPTH))
        self._jpeg = self.advertise("tirgeo/overlay/image/compressed", output(IMAGE_DEPTH))
        self.listen("thermal/image_raw", self._pass_on, sensor_input(1))

    def _pass_on(self, message: Any) -> None:
        colours = np.asarray(cv2.cvtColor(image_pixels(message), cv2.COLOR_GRAY2BGR))
        if self._image.get_subscription_count():
            self._image.publish(self.messages.image(stamp_ns(message), colours))
        if self._jpeg.get_subscription_count():
            jpeg = cv2.imencode(".jpg", colours)[1].tobytes()
            self._jpeg.publish(self.messages.compressed(stamp_ns(message), jpeg))


main = partial(run, "bench_relay", Relay)
