"""Messages of several topics, handled in the order in which they arrived.

An executor does not keep that order where a node cannot follow. The events executor remembers one
event a message, and takes for each the oldest message that its topic's queue still has: once a
queue has run over, that is a later one, and stays so until the node has caught up. The
single-threaded executor takes one message of each topic in turn, so the rare ones come first.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSProfile

from tirgeo_ros.core.streams.arrival_order import ArrivalOrder
from tirgeo_ros.nodes.callbacks import told
from tirgeo_ros.nodes.monitor import Monitor
from tirgeo_ros.nodes.topics import subscribe

#: So many messages are handled before the executor has its turn: timers, services, more messages.
_AT_ONCE = 4


class _Waiting(NamedTuple):
    """A message as its bytes, and the node's time when it was taken.

    As an object a message of the IMU takes 1.8 kB, as bytes 0.6: what the longest queue has taken
    stays with the process.
    """

    receive: Callable[[Any], None]
    data: bytes
    taken_ns: int


class Inbox:
    """Subscriptions of a node; whichever the executor serves, all that waits is taken.

    Of each topic as many messages wait as its queue holds; older ones are given up.
    """

    def __init__(self, node: Node, monitor: Monitor) -> None:
        self._node, self._monitor = node, monitor
        self._order: ArrivalOrder[_Waiting] = ArrivalOrder()
        # Of each topic: its depth, what takes a message and its numbers, and what puts them here.
        self._sources: list[tuple[int, Callable[[], Any], Callable[..., None]]] = []
        self._taking = self._resumes = False
        self.taken_ns = 0

    @property
    def diagnostics(self) -> dict[str, str]:
        """How many messages of each topic were given up, as values of a diagnostic."""
        return {f"given_up.{topic}": str(n) for topic, n in self._order.given_up.items()}

    def subscribe(self, topic: str, handle: Callable[[Any], None], qos: QoSProfile) -> None:
        """Have ``handle`` called with each message in its turn; ``taken_ns`` is its arrival."""
        deferred = partial(self._deferred, topic)
        made = subscribe(self._node, topic, handle, qos, self._monitor, wrapped=deferred, raw=True)
        depth = made.qos_profile.depth
        self._order.open(topic, depth)
        take = partial(made.handle.take_message, made.msg_type, made.raw)
        self._sources.append((depth, take, made.callback))

    def _deferred(self, topic: str, receive: Callable[[Any], None]) -> Callable[..., None]:
        clock = self._node.get_clock()

        def put(data: bytes, info: Any) -> None:
            # Not every middleware says when a message was received.
            arrived_ns = info["received_timestamp"] or info["source_timestamp"]
            waiting = _Waiting(receive, data, clock.now().nanoseconds)
            self._order.put(topic, arrived_ns, waiting)
            if not (self._taking or self._resumes):
                self._work()

        return told(put)

    def _work(self) -> None:
        """Handle what arrived first, and go on later where more waits."""
        self._resumes = False
        self._take()
        for _ in range(_AT_ONCE):
            waiting = self._order.pop()
            if waiting is None:
                return
            self.taken_ns = waiting.taken_ns
            waiting.receive(waiting.data)
        if self._order and self._node.executor is not None:
            self._resumes = True
            self._node.executor.create_task(self._work)

    def _take(self) -> None:
        """Take what waits in the queues of the middleware."""
        self._taking = True
        try:
            for most, take, put in self._sources:
                for _ in range(most):
                    found = take()
                    if found is None:
                        break
                    put(*found)
        finally:
            self._taking = False
