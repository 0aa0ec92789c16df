"""Set parameters of a running node: checked as at start, taken as a whole, or refused in words.

rclpy refuses a whole number for a double, and a list without numbers, whose type it cannot know;
nor does it say why a parameter is read-only or which names there are. So a request comes here
first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from tirgeo_ros.core.config.schema import (
    changed_in_flight,
    changes,
    parameters_of,
    values_of,
)
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.nodes.parameters import declare

T = TypeVar("T")
_Set = Callable[[list[Parameter]], SetParametersResult]


def unchanging(_config: Any) -> None:
    """Take new values where none is live: it is never called."""


class LiveParameters(Generic[T]):
    """Hold a node's parameters as ``config``; ``take`` is called with each new one.

    ``take`` may refuse it: it then raises a TirgeoError and has changed nothing.
    The executor serves the request between two messages, so each sample meets either all the old
    values or all the new ones.
    """

    def __init__(self, node: Node, kind: type[T], take: Callable[[T], None]) -> None:
        self.config = declare(node, kind)
        self._node, self._take = node, take
        self._names = {parameter.name for parameter in parameters_of(kind)}

    def set(self, given: Sequence[Parameter], by_ros: _Set) -> SetParametersResult:
        """Set parameters, all or none; ``by_ros`` sets those that change, as rclpy does."""
        others = [p for p in given if p.name not in self._names and self._has(p.name)]
        wanted = {p.name: p.value for p in given if p not in others}
        try:
            new = changed_in_flight(self.config, wanted)
            changed, values = changes(self.config, new), values_of(new)
            if changed:
                self._take(new)
        except TirgeoError as error:
            return SetParametersResult(successful=False, reason=str(error))
        result = by_ros([*(Parameter(name, value=values[name]) for name in changed), *others])
        if not result.successful:
            self._take(self.config)
        elif changed:
            self.config = new
            told = ", ".join(f"{name}: {old} -> {now}" for name, (old, now) in changed.items())
            self._node.get_logger().info(f"set in flight: {told}")
        return result

    def _has(self, name: str) -> bool:
        return bool(self._node.has_parameter(name))
