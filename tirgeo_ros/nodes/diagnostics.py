"""Publish a node's diagnostics: once a second of real time, and at once when the node asks."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from tirgeo_ros.io.messages import DiagnosticItem, Messages
from tirgeo_ros.nodes.callbacks import steady_timer
from tirgeo_ros.nodes.monitor import Monitor
from tirgeo_ros.nodes.qos import output
from tirgeo_ros.nodes.topics import advertise

PERIOD_S = 1.0


class Diagnostics:
    """Publish the items that ``items()`` returns and the monitor's item, on a steady timer."""

    def __init__(
        self,
        node: Node,
        messages: Messages,
        monitor: Monitor,
        items: Callable[[], list[DiagnosticItem]],
    ) -> None:
        self._node = node
        self._messages = messages
        self._monitor = monitor
        self._items = items
        self._publisher = advertise(node, "/diagnostics", output())
        # Real time also under use_sim_time: a stopped simulation clock must not stop the
        # diagnostics.
        self._timer = steady_timer(node, monitor, "diagnostics", PERIOD_S, self._report)

    def publish(self, items: list[DiagnosticItem]) -> None:
        """Publish items at once, without the monitor's: its rates need a full period."""
        now_ns = self._node.get_clock().now().nanoseconds
        self._publisher.publish(self._messages.diagnostics(now_ns, items))

    def _report(self) -> None:
        items: list[DiagnosticItem] = []
        try:
            items = self._items()
        finally:  # if ``items()`` raises, the monitor's item reports it
            self.publish([*items, self._monitor.item(item_name(self._node, "topics"))])


def item_name(node: Node, subject: str) -> str:
    """Return ``/namespace/node: subject``, as diagnostic aggregators expect."""
    return f"{node.get_fully_qualified_name()}: {subject}"
