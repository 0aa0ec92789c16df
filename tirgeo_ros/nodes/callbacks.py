"""Callbacks that do not end their node: what goes wrong in one is counted, named and told."""

from __future__ import annotations

import inspect
import time
import traceback
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.core.types.quoted_text import shown
from tirgeo_ros.nodes.monitor import Monitor

_THROTTLE_S = 10.0
#: The signature of a callback to which rclpy tells times and numbers beside the message.
_TOLD = inspect.Signature(
    [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in ("message", "info")]
)


def guarded(
    node: Node, monitor: Monitor, name: str, work: Callable[..., None]
) -> Callable[..., bool]:
    """Return ``work`` as a callback that raises nothing, and says whether it went well.

    ``name`` is its topic, or what it does.
    A TirgeoError is bad data: a count (``unreadable``) with its reason, and a warning every ten
    seconds at most. Any other exception is a fault of this program: a count (``failed``), an
    error in the diagnostics from then on, and for each place in the program one traceback.
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
            if monitor.failed(name, _kind(error)):
                node.get_logger().error(f"{name}: {_told(error)}")
        else:
            return True
        return False

    return call


def told(work: Callable[[Any, Any], None]) -> Callable[..., None]:
    """Return ``work(message, info)`` as the callback of a subscription, under any executor."""

    def take(message: Any, info: Any = None) -> None:
        # The events executor gives both as one pair, the others as two arguments.
        if isinstance(message, tuple):
            message, info = message
        work(message, info)

    take.__signature__ = _TOLD  # type: ignore[attr-defined]
    return take


def steady_timer(
    node: Node, monitor: Monitor, name: str, period_s: float, work: Callable[[], None]
) -> Timer:
    """Return a timer by the steady clock, also under ``use_sim_time``, that calls ``work``."""
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period_s, guarded(node, monitor, name, work), clock=clock)


def _kind(error: Exception) -> str:
    """What was raised, and where: exceptions of one kind are one fault."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__} at {place.filename.rpartition('/')[2]}:{place.lineno}"


def _told(error: Exception) -> str:
    frames = "".join(traceback.format_tb(error.__traceback__))
    return (
        "a fault in this program; the node goes on, and counts it from here on. Please report:\n"
        f"{frames}{type(error).__name__}: {shown(error)}"
    )
