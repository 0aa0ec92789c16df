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
"""Define what nodes share: topics with their QoS, guarded callbacks, a log, reports."""

from __future__ import annotations

import importlib
import inspect
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.config.aircraft_parameters import FramesConfig, TransformsConfig
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.types.errors import ConfigError, TirgeoError, shown
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.io.messages import (
    FINDINGS_TOPIC,
    STATE_TOPIC,
    TOPIC_TYPES,
    DiagnosticItem,
    Messages,
    NodeState,
)
from tirgeo_ros.io.messages.cdr import Cdr
from tirgeo_ros.io.messages.json_codec import findings_text, state_text
from tirgeo_ros.io.messages.topics import OUTPUT_DEPTH, STREAM_DEPTH, TF_DEPTH
from tirgeo_ros.nodes.monitor import OK, WARN, Monitor
from tirgeo_ros.nodes.parameters import LiveParameters, unchanging

T = TypeVar("T")
_REPORT_S = 1.0
_THROTTLE_S = 10.0
#: The signature of a callback that takes a message and its MessageInfo (times and numbers).
_WITH_INFO = inspect.Signature(
    [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in ("message", "info")]
)


def sensor_input(depth: int = STREAM_DEPTH) -> QoSProfile:
    """Return the profile for a topic from a sensor, compatible with any publisher."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def output(depth: int = OUTPUT_DEPTH) -> QoSProfile:
    """Return the profile for a topic that this package publishes, or reads without loss."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def latched(depth: int = 1) -> QoSProfile:
    """Return the profile for a topic whose last message a late subscriber still gets."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


@cache
def message_class(typename: str) -> type:
    """Return the rclpy class of ``package/msg/Name``; raise ConfigError if it is not installed."""
    package, _, name = typename.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)  # type: ignore[no-any-return]
    except (ImportError, AttributeError):
        raise ConfigError(f"message type {typename} is not installed") from None


class Output:
    """Publish messages of our own classes, which are encoded as those of a bag are, or rclpy's."""

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher

    def publish(self, message: Any) -> None:
        """Publish a message, or its bytes."""
        is_ours = hasattr(message, "__msgtype__")
        self._publisher.publish(Cdr.serialize(message) if is_ours else message)

    @property
    def is_wanted(self) -> bool:
        """Return whether someone subscribes."""
        return self._publisher.get_subscription_count() > 0


def topic_names(listed: str) -> list[str]:
    """Return the relative names in a list separated by commas."""
    return [name.strip().lstrip("/") for name in listed.split(",") if name.strip()]


class GraphNode(Node):
    """Serve as the base of the nodes.

    ``messages`` builds messages for the outputs; ``monitor`` counts what comes and goes.
    """

    _parameters_of_kind: LiveParameters[Any] | None = None

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self._cdr = Cdr()
        self.messages = Messages()
        self.monitor = Monitor()

    def configured(self, kind: type[T], take: Callable[[T], None] = unchanging) -> T:
        """Declare the parameters of ``kind`` and return their values, for the start.

        If some are live, ``take`` gets all values together each time that one changes. Raises
        ConfigError as ``parameters.declare`` does.
        """
        self._parameters_of_kind = LiveParameters(self, kind, take)
        config = self._parameters_of_kind.config
        if isinstance(config, FramesConfig):
            self.messages = Messages(config.frame_ids)
        return config

    def set_parameters_atomically(self, parameter_list: Sequence[Parameter]) -> Any:
        """Set parameters, all or none; the services of the node call this too."""
        by_ros, own = super().set_parameters_atomically, self._parameters_of_kind
        return own.set(parameter_list, by_ros) if own else by_ros(parameter_list)

    def set_parameters(self, parameter_list: Sequence[Parameter]) -> list[SetParametersResult]:
        """Set parameters one by one."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    @property
    def now_ns(self) -> int:
        """Return the time of the node's clock (ns)."""
        clock = self.get_clock()
        return int(clock.now().nanoseconds) if clock.ros_time_is_active else time.time_ns()

    def log(self, level: int, text: str) -> None:
        """Log a text with the severity of a diagnostic level."""
        # Three separate calls: rclpy raises if one line of code logs with two severities.
        if level == OK:
            self.get_logger().info(shown(text))
        elif level == WARN:
            self.get_logger().warning(shown(text))
        else:
            self.get_logger().error(shown(text))

    def guarded(self, name: str, work: Callable[..., None]) -> Callable[..., bool]:
        """Return ``work`` as a callback that raises nothing and returns whether it succeeded.

        ``name`` is the callback's topic, or what it does.
        A TirgeoError means bad data: it is counted (``unreadable``) with its reason, and a warning
        is logged at most every ten seconds. Any other exception is a fault of this program: it is
        counted (``failed``), the diagnostics show an error from then on, and one traceback is
        logged for each place in the program.
        """
        warned_s = float("-inf")

        def call(*arguments: Any) -> bool:
            nonlocal warned_s
            try:
                work(*arguments)
            except TirgeoError as error:
                self.monitor.refused(name, str(error))
                if time.monotonic() - warned_s >= _THROTTLE_S:
                    warned_s = time.monotonic()
                    self.get_logger().warning(f"{name}: {error}")
            except Exception as error:  # noqa: BLE001 the rest of a node in flight goes on
                place = traceback.extract_tb(error.__traceback__)[-1]
                file = place.filename.rpartition("/")[2]
                # Equal strings of type and place are the same fault.
                if self.monitor.failed(name, f"{type(error).__name__} at {file}:{place.lineno}"):
                    frames = "".join(traceback.format_tb(error.__traceback__))
                    self.get_logger().error(
                        f"{name}: a fault in this program. The node goes on and "
                        f"counts repetitions. Please report it:\n{frames}{type(error).__name__}: "
                        f"{shown(error)}"
                    )
            else:
                return True
            return False

        return call

    def steady_timer(self, name: str, period_s: float, work: Callable[[], None]) -> Timer:
        """Return a timer that calls ``work`` by the steady clock, also under ``use_sim_time``."""
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        return self.create_timer(period_s, self.guarded(name, work), clock=clock)

    def advertise(self, topic: str, qos: QoSProfile, typename: str = "") -> Output:
        """Return an output to a contract topic whose QoS a parameter can override."""
        options = QoSOverridingOptions.with_default_policies()
        kind = message_class(typename or TOPIC_TYPES[topic])
        with _overrides():
            return Output(self.create_publisher(kind, topic, qos, qos_overriding_options=options))

    def listen(
        self,
        topic: str,
        handle: Callable[[Any], None],
        qos: QoSProfile,
        typename: str = "",
        wrapped: Callable[[Callable[[Any], None]], Callable[..., None]] | None = None,
        *,
        decoded: bool = True,
    ) -> Subscription:
        """Return a subscription to a contract topic; a failing callback does not end the node.

        ``typename`` is for a topic outside the contract. ``wrapped`` makes the callback from the
        function that takes the message's bytes. They are decoded before ``handle``, faster than by
        rclpy, unless ``decoded`` is false; rclpy decodes a type that is none of Jazzy's.
        """
        typename = typename or TOPIC_TYPES[topic]
        kind, cdr = message_class(typename), self._cdr
        raw = typename in cdr
        decodes = raw and decoded
        work = (lambda data: handle(cdr.deserialize(data, typename))) if decodes else handle
        take = self.guarded(topic, work)

        def receive(message: Any) -> None:
            self.monitor.received(topic)
            take(message)

        lost = SubscriptionEventCallbacks(
            message_lost=lambda event: self.monitor.lost(topic, event.total_count)
        )
        with _overrides():
            return self.create_subscription(
                kind,
                topic,
                wrapped(receive) if wrapped else receive,
                qos,
                event_callbacks=lost,
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                raw=raw,
            )

    def decoded(self, data: bytes, topic: str) -> Any:
        """Return the message in the bytes that ``listen`` with ``decoded`` false passes on."""
        return self._cdr.deserialize(data, TOPIC_TYPES[topic])

    def pause(self) -> None:
        """Do what cannot wait; called between the parts of a report, which take some 6 ms."""

    def item(
        self, subject: str, values: Mapping[str, str], message: str = "ok", level: int = OK
    ) -> DiagnosticItem:
        """Return a diagnostic item of this node."""
        return DiagnosticItem(self.item_name(subject), level, message, dict(values))

    def item_name(self, subject: str) -> str:
        """Return ``/namespace/node: subject``, as diagnostic aggregators expect."""
        return f"{self.get_fully_qualified_name()}: {subject}"

    def report_each_second(
        self,
        items: Callable[[], list[DiagnosticItem]],
        findings: Callable[[], Sequence[Finding]] = tuple,
        **state: Callable[[], Any],
    ) -> None:
        """Publish diagnostics, ``tirgeo/findings`` and ``tirgeo/state`` each second of real time.

        ``items()`` and the monitor's are the diagnostics; ``state`` has the fields of NodeState
        that are this node's own. Real time also under ``use_sim_time``: a stopped simulation
        clock must not stop the reports.
        """
        self._diagnostics = self.advertise("/diagnostics", output())
        self._findings = self.advertise(FINDINGS_TOPIC, output())
        self._state, self._state_fields = self.advertise(STATE_TOPIC, latched()), state

        def report() -> None:
            own: list[DiagnosticItem] = []
            try:
                own = items()
            finally:  # if ``items()`` raises, the monitor's item reports it
                name = self.get_fully_qualified_name()
                text = findings_text(name, self.now_ns, findings())
                self._findings.publish(self.messages.text(text))
                self.pause()
                self.report([*own, self.monitor.report(self.item_name("topics"))])

        self._report_timer = self.steady_timer("diagnostics", _REPORT_S, report)

    def report(self, items: list[DiagnosticItem]) -> None:
        """Publish diagnostic items, and the state."""
        self._diagnostics.publish(self.messages.diagnostics(self.now_ns, items))
        self.pause()
        own = {name: field() for name, field in self._state_fields.items()}
        node, started_ns = self.get_fully_qualified_name(), self.monitor.started_ns
        state = NodeState(node, self.now_ns, started_ns, self.monitor.topics(), **own)
        self._state.publish(self.messages.text(state_text(state)))


def with_info(work: Callable[[Any, Any], None]) -> Callable[..., None]:
    """Return ``work(message, info)`` as the callback of a subscription."""

    def take(both: tuple[Any, Any]) -> None:  # as the events executor passes them
        work(*both)

    take.__signature__ = _WITH_INFO  # type: ignore[attr-defined]
    return take


@contextmanager
def _overrides() -> Iterator[None]:
    try:
        yield
    except (InvalidQosOverridesError, RuntimeError, ValueError) as error:
        raise ConfigError(f"qos_overrides: {error}") from None


class Transforms:
    """Publish transforms while someone listens, the fixed ones once; none without tf2_msgs."""

    def __init__(self, node: GraphNode, config: TransformsConfig) -> None:
        self._node = node
        self._tf: Output | None = None
        self._tf_static: Output | None = None
        if not config.publish_tf:
            return
        try:
            message_class(TOPIC_TYPES["/tf"])
        except ConfigError:
            node.log(OK, "no /tf: tf2_msgs is not installed (apt: ros-jazzy-tf2-msgs)")
            return
        self._tf = node.advertise("/tf", output(TF_DEPTH))

    def fixed(self, aircraft: AircraftConfig) -> None:
        """Publish where antennas, gimbal and IMU are on the aircraft."""
        if self._tf is not None:
            messages = self._node.messages
            self._tf_static = self._node.advertise("/tf_static", latched())
            transforms = messages.fixed_transforms(aircraft, self._node.now_ns)
            self._tf_static.publish(messages.tf(transforms))

    @property
    def are_heard(self) -> bool:
        """Return whether someone listens to the transforms."""
        return self._tf is not None and self._tf.is_wanted

    def body(self, pose: BodyPose) -> None:
        """Publish map -> base_link."""
        if self._tf is not None and self.are_heard:
            messages = self._node.messages
            self._tf.publish(messages.tf([messages.body_transform(pose)]))

    def camera(self, pose: CameraPose, body_at: Callable[[int], BodyPose | Miss]) -> None:
        """Publish base_link -> camera; ``body_at`` gives the body's pose at a stamp (ns)."""
        if self._tf is not None and self.are_heard:
            messages, body = self._node.messages, body_at(pose.stamp_ns)
            if not isinstance(body, Miss):
                self._tf.publish(messages.tf([messages.camera_transform(body, pose)]))
