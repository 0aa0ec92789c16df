"""Wrap callbacks so that an exception does not end the node: it is counted, named and logged."""

from __future__ import annotations

import inspect
import time
import traceback
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer

from tirgeo_ros.core.types.errors import TirgeoError, shown
from tirgeo_ros.nodes.monitor import OK, WARN, Monitor

_THROTTLE_S = 10.0
#: The signature of a callback that takes a message and its MessageInfo (times and numbers).
_WITH_INFO = inspect.Signature(
    [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in ("message", "info")]
)


def log(node: Any, level: int, text: str) -> None:
    """Log a text with the severity of a diagnostic level."""
    # Three separate calls: rclpy raises if one line of code logs with two severities.
    if level == OK:
        node.get_logger().info(shown(text))
    elif level == WARN:
        node.get_logger().warning(shown(text))
    else:
        node.get_logger().error(shown(text))


def guarded(
    node: Node, monitor: Monitor, name: str, work: Callable[..., None]
) -> Callable[..., bool]:
    """Return ``work`` as a callback that raises nothing and returns whether it succeeded.

    ``name`` is the callback's topic, or what it does.
    A TirgeoError means bad data: it is counted (``unreadable``) with its reason, and a warning is
    logged at most every ten seconds. Any other exception is a fault of this program: it is counted
    (``failed``), the diagnostics show an error from then on, and one traceback is logged for each
    place in the program.
    """
    warned_s = float("-inf")

    def call(*arguments: Any) -> bool:
        nonlocal warned_s
        try:
            work(*arguments)
        except TirgeoError as error:
            monitor.refused(name, str(error))
            if time.monotonic() - warned_s >= _THROTTLE_S:
                warned_s = time.monotonic()
                node.get_logger().warning(f"{name}: {error}")
        except Exception as error:  # noqa: BLE001 an aircraft in flight keeps the rest of its node
            place = traceback.extract_tb(error.__traceback__)[-1]
            file = place.filename.rpartition("/")[2]
            # Equal strings of type and place are the same fault.
            if monitor.failed(name, f"{type(error).__name__} at {file}:{place.lineno}"):
                frames = "".join(traceback.format_tb(error.__traceback__))
                node.get_logger().error(
                    f"{name}: a fault in this program; the node goes on, and counts it from here "
                    f"on. Please report:\n{frames}{type(error).__name__}: {shown(error)}"
                )
        else:
            return True
        return False

    return call


def told(work: Callable[[Any, Any], None]) -> Callable[..., None]:
    """Return ``work(message, info)`` as the callback of a subscription, for any executor."""

    def take(message: Any, info: Any = None) -> None:
        # The events executor passes both as one pair, the other executors as two arguments.
        if isinstance(message, tuple):
            message, info = message
        work(message, info)

    take.__signature__ = _WITH_INFO  # type: ignore[attr-defined]
    return take


def steady_timer(
    node: Node, monitor: Monitor, name: str, period_s: float, work: Callable[[], None]
) -> Timer:
    """Return a timer that calls ``work`` by the steady clock, also under ``use_sim_time``."""
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period_s, guarded(node, monitor, name, work), clock=clock)
