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
"""Run the navigation filter: IMU, RTK and GPS in; the body's pose in ``map`` out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import islice
from typing import Any

from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from tirgeo_ros.core.checks.navigation_checks import NavigationChecks
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding.fusion import METHOD_SOURCES
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.estimator.track import Track
from tirgeo_ros.core.streams.stamps import ArrivalOrder, Arrivals, RateLimit
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.measurements import NavigationInput, Source
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus, Outcome, Verdict
from tirgeo_ros.io.messages import NAVIGATION_INPUTS, TOPIC_TYPES, DiagnosticItem, navigation_item
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.io.messages.topics import STREAM_DEPTH
from tirgeo_ros.nodes.graph_node import (
    GraphNode,
    Transforms,
    latched,
    output,
    sensor_input,
    with_info,
)
from tirgeo_ros.nodes.monitor import OK, WARN
from tirgeo_ros.nodes.parameters import given_names
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.nodes.setup_checks import RECENT_S, InputChecks, OtherPublishers, SetupChecks

#: Number of messages handled before the executor runs again: timers, services, more messages.
_AT_ONCE = 8
#: Number of messages that wait for each other at most.
_GATHERED = 4
Decode = Callable[[Any], NavigationInput]
_IMU = NAVIGATION_INPUTS[Source.IMU][0]
_POSITIONS = (Source.RTK_POSITION, Source.GPS_POSITION)
_RESTARTS = (Outcome.TIME_JUMP, Outcome.GAP, Outcome.RESTART)
_SET_HEADING = "~/set_heading"
_PATH_RATE_HZ, _TRACK_RATE_HZ = 1.0, 10.0
_TAKEN = (Outcome.USED, Outcome.WAITING)

_BEST_FIRST = (
    *(FilterState.RUNNING, FilterState.DEGRADED, FilterState.DEAD_RECKONING),
    *(FilterState.ALIGNING, FilterState.WAITING, FilterState.LOST),
)

#: A waiting message: the function that takes it, its bytes, and the node's time (ns) of arrival.
#: It waits as bytes: an IMU message takes 1.8 kB as an object and 0.6 kB as bytes, and the process
#: keeps the memory of its longest queue.
_Waiting = tuple[Callable[[Any], None], bytes, int]


class Inbox:
    """Subscribe for a node, and handle the messages of all topics in the order of arrival.

    When the executor serves one topic, the waiting messages of all topics are taken. Each topic
    keeps as many as its queue holds; older ones are dropped and counted. Messages that may wait
    are handled with the next one that may not, or four together: at 400 Hz each alone finds the
    processor's caches cold, and takes twice the time.
    """

    def __init__(self, node: GraphNode) -> None:
        self._node, self._clock = node, node.get_clock()
        self._order: ArrivalOrder[_Waiting] = ArrivalOrder()
        # For each topic: its depth, the function that takes a message with its info, and the
        # callback that puts it into the order.
        self._sources: list[tuple[int, Callable[[], Any], Callable[..., None]]] = []
        self._taking = self._resumes = self._working = False
        self.taken_ns = 0

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return how many messages of each topic were dropped, as values of a diagnostic."""
        return {f"given_up.{topic}": str(n) for topic, n in self._order.given_up.items()}

    def subscribe(
        self,
        topic: str,
        handle: Callable[[Any], None],
        qos: QoSProfile,
        typename: str = "",
        may_wait: Callable[[bytes], bool] | None = None,
    ) -> None:
        """Call ``handle`` with each message in its turn; ``taken_ns`` is then its arrival time."""
        deferred = partial(self._deferred, topic, may_wait)
        subscription = self._node.listen(topic, handle, qos, typename, wrapped=deferred)
        depth = subscription.qos_profile.depth
        self._order.open(topic, depth)
        # Not public, so setup.py bounds the version of rclpy: test_ekf_node.py says why.
        take = partial(subscription.handle.take_message, subscription.msg_type, subscription.raw)
        self._sources.append((depth, take, subscription.callback))

    def _deferred(
        self, topic: str, may_wait: Callable[[bytes], bool] | None, receive: Callable[[Any], None]
    ) -> Callable[..., None]:
        def put(data: bytes, info: Any) -> None:
            # Not every middleware gives the time of reception.
            received_ns = info["received_timestamp"]
            is_time = received_ns and not self._clock.ros_time_is_active
            now_ns = received_ns if is_time else self._node.now_ns
            arrived_ns = received_ns or info["source_timestamp"]
            self._order.put(topic, arrived_ns, (receive, data, now_ns))
            if self._taking or self._resumes:
                return
            if not (may_wait and len(self._order) < _GATHERED and may_wait(data)):
                self.work()

        return with_info(put)

    def work(self) -> None:
        """Handle the messages that arrived first, and schedule another call if more wait.

        A call while a message is being handled does nothing.
        """
        if not self._working:
            self._resumes, self._working = False, True
            try:
                self._work()
            finally:
                self._working = False

    def _work(self) -> None:
        self._take()
        for _ in range(_AT_ONCE):
            waiting = self._order.pop()
            if waiting is None:
                return
            receive, data, self.taken_ns = waiting
            receive(data)
        if self._order and self._node.executor is not None:
            self._resumes = True
            self._node.executor.create_task(self.work)

    def _take(self) -> None:
        """Take the messages that wait in the queues of the middleware."""
        self._taking = True
        try:
            for most, take, put in self._sources:
                for message in islice(iter(take, None), most):
                    put(message)
        finally:
            self._taking = False


class StateLog:
    """Log changes of the estimator's status on a node's log."""

    def __init__(self, node: GraphNode) -> None:
        self._node = node
        self._logged: tuple[FilterState | None, str] = (None, "")  # state and reason
        self._resets: dict[str, int] = {}

    def note(self, status: NavigationStatus, *, reasons: bool = False) -> bool:
        """Log a new state (a worse one as a warning) and resets; return whether there was any.

        With ``reasons``, log a new reason of the same state too: do not ask for this at each
        sample, because a reason may contain a number that changes.
        """
        before, self._logged = self._logged, (status.state, status.reason)
        moved = status.state is not before[0]
        if moved or (reasons and self._logged != before):
            ranks = [_BEST_FIRST.index(state) for state in (before[0], status.state) if state]
            reason = f": {status.reason}" if status.reason else ""
            text = f"{status.method}: {status.state.value}{reason}"
            self._node.log(WARN if ranks[0] < ranks[-1] else OK, text)
        elif not reasons:
            self._logged = before
        reset = [name for name, n in status.resets.items() if n > self._resets.get(name, 0)]
        if reset:
            self._node.log(WARN, f"reset by {', '.join(reset)}: {status.last_reset}")
        self._resets = status.resets
        return moved or bool(reset)


class EkfNode(GraphNode):
    """Connect one Navigation with its topics."""

    def __init__(self) -> None:
        super().__init__("ekf_node")
        config = self.configured(EkfConfig, self._reconfigure)
        self._navigation = Navigation(config, self._log_set_heading)
        explicit = given_names(self, EkfConfig)
        self._checks = NavigationChecks(config, explicit, RECENT_S, self.pause)
        sources = METHOD_SOURCES[config.method]
        positions = [NAVIGATION_INPUTS[source][0] for source in sources if source in _POSITIONS]
        inputs = InputChecks(self, (_IMU,), positions)
        self._setup = SetupChecks(self, inputs, OtherPublishers(self), self._checks)
        self._arrivals = Arrivals()
        self._inbox = Inbox(self)
        self._state_log = StateLog(self)
        self._state_log.note(self._navigation.status())
        self._noted, self._revision = self._navigation.state_and_resets(), 0
        self._odometry = self.advertise("tirgeo/odometry", output(STREAM_DEPTH))
        self._fix_rate = RateLimit(config.fix_rate_hz)
        self._fix = self.advertise("tirgeo/fix", output())
        self._origin = self.advertise("tirgeo/origin", latched())
        self._track = Track(self.messages.track_point)
        self._path_rate, self._track_rate = RateLimit(_PATH_RATE_HZ), RateLimit(_TRACK_RATE_HZ)
        self._path = self.advertise("tirgeo/path", output())
        self._transforms = Transforms(self, config)
        self._transforms.fixed(config.aircraft)
        self._published_plane: TangentPlane | None = None
        # Only the sources that the method uses: an unused subscription costs time at every
        # message.
        for source in sources:
            topic, decode = NAVIGATION_INPUTS[source]
            take = partial(self._take, topic, decode)
            if source is Source.SET_HEADING:  # sent only once, so it must not be lost
                kind = TOPIC_TYPES[topic]
                self._inbox.subscribe(_SET_HEADING, partial(self._in_map, take), output(), kind)
            else:
                may_wait = self._may_wait if source is Source.IMU else None
                self._inbox.subscribe(topic, take, sensor_input(), may_wait=may_wait)
        # Only the IMU is expected here: the filter itself reports which other inputs it misses.
        self.monitor.expects(_IMU)
        self._restart = self.guarded("reset", self._navigation.reset)
        self.create_service(Trigger, "~/reset", self._reset)
        self.report_each_second(
            self._items, self._setup.findings, navigation=self._navigation.status
        )

    def _reconfigure(self, config: EkfConfig) -> None:
        self._navigation.configure(config)
        self._fix_rate = RateLimit(config.fix_rate_hz)
        self._setup.take(self._checks.configure, config)

    def _take(self, topic: str, decode: Decode, message: Any) -> None:
        sample, arrival_ns = decode(message), self._inbox.taken_ns
        step = self._navigation.process(self._arrivals.stamped(topic, sample, arrival_ns))
        verdict = step.verdict
        if verdict.outcome in _RESTARTS:
            text = f"{verdict.source.value}: {verdict.outcome.value}: {verdict.reason}"
            self.get_logger().warning(text, throttle_duration_sec=5.0)
        if step.solution is not None:
            self._publish(step.solution)
        self._note_state()
        self._setup.take(self._checks.take, topic, sample, arrival_ns)

    def _may_wait(self, data: bytes) -> bool:
        """Return whether an IMU sample makes no solution due."""
        try:
            return not self._navigation.is_due(header_stamp_ns(data))
        except MessageError:
            return False

    def _note_state(self) -> None:
        """Log and report a change at once; called at each sample, so the whole status waits."""
        if self._navigation.revision == self._revision:
            return
        self._revision = self._navigation.revision
        state = self._navigation.state_and_resets()
        if state == self._noted:
            return
        self._noted = state
        status = self._navigation.status()
        if self._state_log.note(status):
            self.report([self._item(status)])

    def _in_map(self, take: Callable[[Any], None], message: Any) -> None:
        """Take a heading in the axes of ``map``; raise MessageError for any other frame."""
        frame, own_frame = message.header.frame_id, self.messages.frames.map
        if frame not in {"", own_frame}:
            raise MessageError(
                f"its frame_id is {frame!r}: send it in {own_frame} (RViz: Fixed Frame)"
            )
        take(message)

    def _log_set_heading(self, verdict: Verdict) -> None:
        if verdict.source is Source.SET_HEADING:
            taken = verdict.outcome in _TAKEN
            text = f"{_SET_HEADING}: {verdict.outcome.value}: {verdict.reason}"
            self.log(OK if taken else WARN, text.removesuffix(": "))

    def _publish(self, solution: NavSolution) -> None:
        plane = self._navigation.plane
        if plane is None:
            return
        if plane != self._published_plane:
            self._origin.publish(self.messages.origin(plane, solution.stamp_ns))
            self._published_plane = plane
            self._track.clear()  # it was in another plane
        stamp_ns = solution.stamp_ns
        if self._fix_rate.due(stamp_ns) and self._fix.is_wanted:
            self._fix.publish(self.messages.fix(solution))
        is_heard = self._odometry.is_wanted
        is_track_point = self._track_rate.due(stamp_ns)
        if not (is_heard or is_track_point or self._transforms.are_heard):
            return
        body = plane.body_pose(solution)
        self._transforms.body(body)
        if is_heard:
            self._odometry.publish(self.messages.odometry(solution, body))
            self.monitor.published("tirgeo/odometry", 1e-9 * (self.now_ns - stamp_ns))
        if is_track_point:
            self._track.add(body)
            if self._path_rate.due(stamp_ns) and self._path.is_wanted:
                self._path.publish(self.messages.path(stamp_ns, self._track.points()))

    def pause(self) -> None:
        """Handle the messages that came meanwhile."""
        self._inbox.work()

    def _items(self) -> list[DiagnosticItem]:
        self._inbox.work()  # also the last samples of an IMU that fell silent
        set_up = self._setup.report()
        status = self._navigation.status()
        self._state_log.note(status, reasons=True)
        return [self._item(status), set_up]

    def _item(self, status: NavigationStatus) -> DiagnosticItem:
        item = navigation_item(self.item_name("navigation"), status)
        item.values.update(self._arrivals.diagnostics | self._inbox.diagnostics)
        return item

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._restart()
        response.message = "the filter starts again" if response.success else "failed: see the log"
        return response


main = partial(run, "ekf_node", EkfNode)
