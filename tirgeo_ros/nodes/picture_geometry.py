"""Publish what relates the finished pictures to the world: their calibration, their footprint."""

from __future__ import annotations

from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.overlay.picture_painter import OverlayResult
from tirgeo_ros.core.streams.rates import RateLimit
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.qos import IMAGE_DEPTH, output


class PictureGeometry:
    """Publish ``tirgeo/overlay/camera_info`` and ``tirgeo/footprint``, while someone listens."""

    def __init__(self, node: GraphNode, overlay: Overlay, footprint_rate_hz: float) -> None:
        self._messages, self._overlay = node.messages, overlay
        self._rate = RateLimit(footprint_rate_hz)
        self._info = node.advertise("tirgeo/overlay/camera_info", output(IMAGE_DEPTH))
        self._footprint = node.advertise("tirgeo/footprint", output())

    def publish(self, result: OverlayResult) -> None:
        """Publish a picture's calibration, and its footprint if that is due.

        The footprint of a picture without a trusted pose is empty, so that no viewer keeps an old
        one.
        """
        stamp_ns = result.stamp_ns
        if result.camera is not None and self._info.get_subscription_count():
            self._info.publish(self._messages.camera_info(result.camera, stamp_ns))
        if self._footprint.get_subscription_count() and self._rate.due(stamp_ns):
            outline_n = self._overlay.footprint(result.pose)
            self._footprint.publish(self._messages.footprint(stamp_ns, outline_n))
