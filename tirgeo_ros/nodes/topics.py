"""Create publishers and subscriptions of contract topics, with type, QoS, overrides and counts."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from tirgeo_ros.core.types.errors import ConfigError, MessageError
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.nodes.callbacks import guarded
from tirgeo_ros.nodes.monitor import Monitor


@cache
def message_class(typename: str) -> type:
    """Return the rclpy class of ``package/msg/Name``; raise ConfigError if it is not installed."""
    package, _, name = typename.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)  # type: ignore[no-any-return]
    except (ImportError, AttributeError):
        raise ConfigError(f"message type {typename} is not installed") from None


def advertise(node: Node, topic: str, qos: QoSProfile) -> Publisher:
    """Return a publisher of a contract topic whose quality of service a parameter can override."""
    kind = message_class(TOPIC_TYPES[topic])
    with_overrides = QoSOverridingOptions.with_default_policies()
    with _overrides():
        return node.create_publisher(kind, topic, qos, qos_overriding_options=with_overrides)


def subscribe(
    node: Node,
    topic: str,
    handle: Callable[[Any], None],
    qos: QoSProfile,
    monitor: Monitor,
    typename: str = "",
    wrapped: Callable[[Callable[[Any], None]], Callable[..., None]] | None = None,
    *,
    raw: bool = False,
) -> Subscription:
    """Return a subscription to a contract topic; a failing callback does not end the node.

    The callback is ``guarded``. Messages that DDS reports as lost in transport are counted, if the
    middleware reports them; messages replaced by a newer one in a shallow queue are not among
    them. ``typename`` is for a topic outside the contract. ``wrapped`` makes the subscription's
    callback from the one that takes a message. With ``raw`` that one takes the bytes, and the
    message is decoded just before ``handle``.
    """
    kind = message_class(typename or TOPIC_TYPES[topic])
    work = (lambda data: handle(_message(kind, data))) if raw else handle
    take = guarded(node, monitor, topic, work)

    def receive(message: Any) -> None:
        monitor.received(topic)
        take(message)

    callback = wrapped(receive) if wrapped else receive

    def create(**events: Callable[[Any], None]) -> Subscription:
        return node.create_subscription(
            kind,
            topic,
            callback,
            qos,
            raw=raw,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            event_callbacks=SubscriptionEventCallbacks(**events),
        )

    with _overrides():
        try:
            return create(message_lost=lambda event: monitor.lost(topic, event.total_count))
        except UnsupportedEventTypeError:
            return create()


def _message(kind: type, data: bytes) -> Any:
    try:
        return deserialize_message(data, kind)
    except RuntimeError:  # raised by the middleware
        raise MessageError(f"{len(data)} bytes are no {kind.__name__}") from None


@contextmanager
def _overrides() -> Iterator[None]:
    try:
        yield
    except (InvalidQosOverridesError, RuntimeError, ValueError) as error:
        raise ConfigError(f"qos_overrides: {error}") from None
