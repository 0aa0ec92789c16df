"""The map on the video: frames, camera poses and the map's origin in; the drawn picture out."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import cv2
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.map_layers import MapLayer
from tirgeo_ros.core.overlay import Overlay, OverlayResult
from tirgeo_ros.io.maps import load_map
from tirgeo_ros.io.messages import (
    DiagnosticItem,
    Messages,
    camera,
    camera_pose,
    compressed_pixels,
    image_pixels,
    navigation_status,
    stamp_ns,
    tangent_plane,
)
from tirgeo_ros.nodes.diagnostics import Diagnostics, counts_item, item_name
from tirgeo_ros.nodes.monitor import Monitor
from tirgeo_ros.nodes.parameters import declare
from tirgeo_ros.nodes.qos import IMAGE_DEPTH, latched, output, sensor_input
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.nodes.topics import advertise, message_class, subscribe

#: How often a frame that waits for its pose is looked at again.
_RELEASE_PERIOD_S = 0.02


class OverlayNode(Node):
    """One Overlay with its topics."""

    def __init__(self) -> None:
        super().__init__("overlay_node")
        cv2.setNumThreads(1)  # the work of a frame is too small to share
        self._config = declare(self, OverlayConfig)
        self._overlay = Overlay(self._config, self._load_map())
        self._messages = Messages(message_class)
        self._monitor = Monitor()
        self._image = advertise(self, "tirgeo/overlay/image", output(IMAGE_DEPTH))
        self._jpeg = advertise(self, "tirgeo/overlay/image/compressed", output(IMAGE_DEPTH))
        self._arrived_s: float | None = None  # of the frame that waits, if one does
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(_RELEASE_PERIOD_S, self._release, clock=steady)
        self._timer.cancel()
        self._subscribe()
        self._diagnostics = Diagnostics(self, self._messages, self._monitor, self._items)

    def _load_map(self) -> list[MapLayer]:
        if not self._config.map:
            self.get_logger().warning("no map: set the parameter map to its file")
            return []
        features = load_map(self._config.map, self._config.label_field)
        self.get_logger().info(f"{self._config.map}: {len(features)} features")
        return [MapLayer("map", features)]

    def _subscribe(self) -> None:
        frames, info = sensor_input(IMAGE_DEPTH), sensor_input(1)
        for topic, take, qos in (
            ("thermal/image_raw", partial(self._take_frame, image_pixels), frames),
            ("thermal/image_raw/compressed", partial(self._take_frame, compressed_pixels), frames),
            ("thermal/camera_info", self._take_camera_info, info),
            ("tirgeo/camera_pose", self._take_pose, output()),
            ("tirgeo/origin", self._take_origin, latched()),
            ("/diagnostics", self._take_diagnostics, output()),
        ):
            subscribe(self, topic, take, qos, self._monitor)
        for topic in ("thermal/camera_info", "tirgeo/camera_pose"):
            self._monitor.expects(topic)

    def _take_frame(self, pixels_of: Any, message: Any) -> None:
        self._overlay.add_frame(stamp_ns(message), pixels_of(message), self._now_ns())
        self._arrived_s = time.monotonic()
        self._timer.reset()
        self._release()

    def _take_pose(self, message: Any) -> None:
        self._overlay.add_pose(camera_pose(message))
        self._release()

    def _take_camera_info(self, message: Any) -> None:
        self._overlay.set_camera(camera(message))

    def _take_origin(self, message: Any) -> None:
        self._overlay.set_plane(tangent_plane(message))

    def _take_diagnostics(self, message: Any) -> None:
        for status in message.status:
            if self._is_filter(status.name):
                self._overlay.set_status(navigation_status(status))

    def _is_filter(self, name: str) -> bool:
        node, _, subject = name.partition(": ")
        namespace = self.get_namespace().rstrip("/")
        return subject == "navigation" and node.rpartition("/")[0] == namespace

    def _release(self) -> None:
        if self._arrived_s is None:
            return
        result = self._overlay.take(self._now_ns())
        if result is not None:
            self._timer.cancel()
            self._publish(result)
            self._monitor.took("tirgeo/overlay/image", time.monotonic() - self._arrived_s)
            self._arrived_s = None

    def _publish(self, result: OverlayResult) -> None:
        if self._image.get_subscription_count():
            self._image.publish(self._messages.image(result.stamp_ns, result.image))
        if self._jpeg.get_subscription_count():
            quality = [cv2.IMWRITE_JPEG_QUALITY, self._config.jpeg_quality]
            jpeg = cv2.imencode(".jpg", result.image, quality)[1].tobytes()
            self._jpeg.publish(self._messages.compressed(result.stamp_ns, jpeg))

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _items(self) -> list[DiagnosticItem]:
        return [counts_item(item_name(self, "overlay"), self._overlay.counts)]


def main() -> int:
    """Run the node; the exit code."""
    return run("overlay_node", OverlayNode)
