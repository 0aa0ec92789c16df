"""The navigation filter: IMU, RTK and GPS in; the body's pose in ``map`` out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.navigation import METHOD_SOURCES, Navigation
from tirgeo_ros.core.rate import RateLimit
from tirgeo_ros.core.samples import NavigationInput, NavSolution, Outcome, Verdict
from tirgeo_ros.io.messages import (
    NAVIGATION_INPUTS,
    DiagnosticItem,
    Messages,
)
from tirgeo_ros.nodes.diagnostics import Diagnostics, item_name
from tirgeo_ros.nodes.monitor import Monitor
from tirgeo_ros.nodes.parameters import declare
from tirgeo_ros.nodes.qos import latched, output, sensor_input
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.nodes.topics import advertise, message_class, subscribe

Decode = Callable[[Any], NavigationInput]
_RESTARTS = (Outcome.TIME_JUMP, Outcome.GAP, Outcome.RESTART)


class EkfNode(Node):
    """One Navigation with its topics."""

    def __init__(self) -> None:
        super().__init__("ekf_node")
        config = declare(self, EkfConfig)
        self._navigation = Navigation(config)
        self._messages = Messages(message_class)
        self._monitor = Monitor()
        self._odometry = advertise(self, "tirgeo/odometry", output())
        self._fix_rate = RateLimit(config.fix_rate_hz)
        self._fix = advertise(self, "tirgeo/fix", output())
        self._origin = advertise(self, "tirgeo/origin", latched())
        self._published_plane: TangentPlane | None = None
        self._told_state = ""
        # Of what the method takes alone: an idle subscription would cost time at every message.
        for source in METHOD_SOURCES[config.method]:
            topic, decode = NAVIGATION_INPUTS[source]
            subscribe(self, topic, partial(self._take, decode), sensor_input(), self._monitor)
            self._monitor.expects(topic)
        self.create_service(Trigger, "~/reset", self._reset)
        self._diagnostics = Diagnostics(self, self._messages, self._monitor, self._items)

    def _take(self, decode: Decode, message: Any) -> None:
        step = self._navigation.process(decode(message))
        if step.verdict.outcome in _RESTARTS:
            self._warn(step.verdict)
        if step.solution is not None:
            self._publish(step.solution)

    def _publish(self, solution: NavSolution) -> None:
        plane = self._navigation.plane
        if plane is None:
            return
        if plane != self._published_plane:
            self._origin.publish(self._messages.origin(plane, solution.stamp_ns))
            self._published_plane = plane
        self._odometry.publish(self._messages.odometry(solution, plane.body_pose(solution)))
        if self._fix_rate.due(solution.stamp_ns) and self._fix.get_subscription_count():
            self._fix.publish(self._messages.fix(solution))
        self._monitor.published("tirgeo/odometry", self.get_clock(), solution.stamp_ns)

    def _items(self) -> list[DiagnosticItem]:
        status = self._navigation.status()
        item = self._messages.navigation_diagnostic(item_name(self, "navigation"), status)
        if item.message != self._told_state:
            self.get_logger().info(f"{status.method}: {item.message}")
            self._told_state = item.message
        return [item]

    def _warn(self, verdict: Verdict) -> None:
        text = f"{verdict.source.value}: {verdict.outcome.value}: {verdict.reason}"
        self.get_logger().warning(text, throttle_duration_sec=5.0)

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._navigation.reset()
        response.success, response.message = True, "the filter starts again"
        return response


def main() -> int:
    """Run the node; the exit code."""
    return run("ekf_node", EkfNode)
