"""Publishers and subscriptions by contract topic: type, quality of service, overrides, counts."""

from __future__ import annotations

import importlib
from collections.abc import Callable
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
    """The rclpy class of ``package/msg/Name``; ConfigError if its package is not installed."""
    package, _, name = typename.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)  # type: ignore[no-any-return]
    except (ImportError, AttributeError):
        raise ConfigError(f"message type {typename} is not installed") from None


def advertise(node: Node, topic: str, qos: QoSProfile) -> Publisher:
    """A publisher of a contract topic whose quality of service a parameter can override."""
    kind = message_class(TOPIC_TYPES[topic])
    with_overrides = QoSOverridingOptions.with_default_policies()
    return _made(
        lambda: node.create_publisher(kind, topic, qos, qos_overriding_options=with_overrides)
    )


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
    """A subscription to a contract topic, whose messages do not end the node (``guarded``).

    Those that DDS says were lost on the way are counted, where it says so: not those that gave
    way to a newer one in a shallow queue. ``typename`` is for a topic that is not of the contract;
    ``wrapped`` makes the callback from that which takes a message; where this is ``raw``, it takes
    the bytes, from which the message is made when ``handle`` is to have it.
    """
    kind = message_class(typename or TOPIC_TYPES[topic])
    monitor.listens(topic)
    work = (lambda data: handle(_message(kind, data))) if raw else handle
    take = guarded(node, monitor, topic, work)

    def receive(message: Any) -> None:
        monitor.received(topic)
        take(message)

    callback = wrapped(receive) if wrapped else receive

    def lost(event: Any) -> None:
        monitor.lost(topic, event.total_count)

    def create(callbacks: SubscriptionEventCallbacks) -> Subscription:
        options = QoSOverridingOptions.with_default_policies()
        return node.create_subscription(
            kind,
            topic,
            callback,
            qos,
            raw=raw,
            qos_overriding_options=options,
            event_callbacks=callbacks,
        )

    return _made(lambda: _with_losses(create, lost))


def _message(kind: type, data: bytes) -> Any:
    try:
        return deserialize_message(data, kind)
    except RuntimeError:  # of the middleware
        raise MessageError(f"{len(data)} bytes are no {kind.__name__}") from None


def _with_losses(
    create: Callable[[SubscriptionEventCallbacks], Subscription], lost: Callable[[Any], None]
) -> Subscription:
    """A subscription that tells of losses, where the middleware does."""
    try:
        return create(SubscriptionEventCallbacks(message_lost=lost))
    except UnsupportedEventTypeError:
        return create(SubscriptionEventCallbacks())


def _made(create: Callable[[], Any]) -> Any:
    try:
        return create()
    except (InvalidQosOverridesError, RuntimeError, ValueError) as error:
        raise ConfigError(f"qos_overrides: {error}") from None
