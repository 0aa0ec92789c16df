"""The navigation filter: IMU, RTK and GPS in; the body's pose in ``map`` out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from tirgeo_ros.core.checks.navigation_checks import NavigationChecks
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding.aids import METHOD_SOURCES
from tirgeo_ros.core.navigation.estimator import Navigation
from tirgeo_ros.core.streams.arrival_stamps import Arrivals
from tirgeo_ros.core.streams.rates import RateLimit
from tirgeo_ros.core.types.measurements import NavigationInput, Source
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import NavigationStatus, Outcome, Verdict
from tirgeo_ros.io.messages import NAVIGATION_INPUTS, DiagnosticItem, Messages
from tirgeo_ros.nodes.callbacks import guarded
from tirgeo_ros.nodes.diagnostics import Diagnostics, item_name
from tirgeo_ros.nodes.filter_status_log import StateLog
from tirgeo_ros.nodes.inbox import Inbox
from tirgeo_ros.nodes.monitor import Monitor
from tirgeo_ros.nodes.parameters import declare, given_names
from tirgeo_ros.nodes.qos import STREAM_DEPTH, latched, output, sensor_input
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.nodes.setup_checks import InputChecks, SetupChecks
from tirgeo_ros.nodes.topics import advertise, message_class

Decode = Callable[[Any], NavigationInput]
_IMU = NAVIGATION_INPUTS[Source.IMU][0]
_POSITIONS = (Source.RTK_POSITION, Source.GPS_POSITION)
_RESTARTS = (Outcome.TIME_JUMP, Outcome.GAP, Outcome.RESTART)


class EkfNode(Node):
    """Connect one Navigation with its topics."""

    def __init__(self) -> None:
        super().__init__("ekf_node")
        config = declare(self, EkfConfig)
        self._navigation = Navigation(config)
        self._messages = Messages(message_class)
        self._monitor = Monitor()
        self._checks = NavigationChecks(config, given_names(self, EkfConfig))
        sources = METHOD_SOURCES[config.method]
        positions = [NAVIGATION_INPUTS[one][0] for one in sources if one in _POSITIONS]
        inputs = InputChecks(self, self._monitor, (_IMU,), positions)
        self._setup = SetupChecks(self, self._monitor, inputs, self._checks)
        self._arrivals = Arrivals()
        self._inbox = Inbox(self, self._monitor)
        self._state_log = StateLog(self.get_logger())
        self._state_log.note(self._navigation.status())
        self._odometry = advertise(self, "tirgeo/odometry", output(STREAM_DEPTH))
        self._fix_rate = RateLimit(config.fix_rate_hz)
        self._fix = advertise(self, "tirgeo/fix", output())
        self._origin = advertise(self, "tirgeo/origin", latched())
        self._published_plane: TangentPlane | None = None
        # Only the sources that the method uses: an unused subscription costs time at every
        # message.
        for source in sources:
            topic, decode = NAVIGATION_INPUTS[source]
            self._inbox.subscribe(topic, partial(self._take, topic, decode), sensor_input())
        # Only the IMU is expected here: the filter itself reports which other inputs it misses.
        self._monitor.expects(_IMU)
        self._restart = guarded(self, self._monitor, "reset", self._navigation.reset)
        self.create_service(Trigger, "~/reset", self._reset)
        self._diagnostics = Diagnostics(self, self._messages, self._monitor, self._items)

    def _take(self, topic: str, decode: Decode, message: Any) -> None:
        came, arrival_ns = decode(message), self._inbox.taken_ns
        step = self._navigation.process(self._arrivals.stamped(topic, came, arrival_ns))
        if step.verdict.outcome in _RESTARTS:
            self._warn(step.verdict)
        if step.solution is not None:
            self._publish(step.solution)
        status = self._navigation.status()
        if self._state_log.note(status):
            self._diagnostics.publish([self._item(status)])
        self._setup.take(self._checks.take, topic, came, arrival_ns)

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
        self._state_log.note_reason(status)
        return [self._item(status), self._setup.item()]

    def _item(self, status: NavigationStatus) -> DiagnosticItem:
        item = self._messages.navigation_diagnostic(item_name(self, "navigation"), status)
        item.values.update(self._arrivals.diagnostics | self._inbox.diagnostics)
        return item

    def _warn(self, verdict: Verdict) -> None:
        text = f"{verdict.source.value}: {verdict.outcome.value}: {verdict.reason}"
        self.get_logger().warning(text, throttle_duration_sec=5.0)

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._restart()
        response.message = "the filter starts again" if response.success else "failed: see the log"
        return response


main = partial(run, "ekf_node", EkfNode)
