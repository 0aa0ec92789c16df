"""Convert clicks on the picture into ground points: the topics of ``tirgeo/locate``."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.overlay.clicks import Clicks
from tirgeo_ros.io.messages import Messages, pixel
from tirgeo_ros.nodes.monitor import Monitor
from tirgeo_ros.nodes.qos import output, sensor_input
from tirgeo_ros.nodes.topics import advertise, message_class, subscribe

_CLICKS = 10


class LocateTopics:
    """Connect the Clicks of an overlay with their topics; ``values`` is for the diagnostics."""

    def __init__(self, node: Node, clicks: Clicks, monitor: Monitor) -> None:
        self._clicks = clicks
        self._node = node
        self._messages = Messages(message_class)
        self._fix = advertise(node, "tirgeo/locate/fix", output())
        self._point = advertise(node, "tirgeo/locate/point", output())
        self._refused = ""
        # Best effort, so that any publisher is compatible.
        subscribe(node, "tirgeo/locate/pixel", self._take, sensor_input(_CLICKS), monitor)

    @property
    def values(self) -> dict[str, str]:
        """Return how many clicks were located and refused, and why the last one was refused."""
        found = {f"clicks_{name}": str(n) for name, n in sorted(self._clicks.counts.items())}
        return found | ({"last_click_refused": self._refused} if self._refused else {})

    def _take(self, message: Any) -> None:
        stamp_ns, u, v = pixel(message)
        answer = self._clicks.locate((u, v), stamp_ns)
        if isinstance(answer, Located):
            self._fix.publish(self._messages.located_fix(answer))
            self._point.publish(self._messages.located_point(answer))
            self._refused = ""
            return
        self._refused = answer.reason.value
        self._node.get_logger().warning(
            f"tirgeo/locate/pixel: no point at ({u:.0f}, {v:.0f}): {self._refused}",
            throttle_duration_sec=1.0,
        )
