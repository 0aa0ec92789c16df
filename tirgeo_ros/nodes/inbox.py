"""Handle the messages of several topics in the order of their arrival.

An executor does not keep that order when a node is too slow. The events executor stores one event
per message, and for each event takes the oldest message that is still in the topic's queue. Once a
queue has overflowed, that is a later message, until the node has caught up. The single-threaded
executor takes one message of each topic in turn, so messages of slow topics come too early.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.qos import QoSProfile

from tirgeo_ros.core.streams.arrivals import ArrivalOrder
from tirgeo_ros.nodes.graph_node import GraphNode, told

#: Number of messages handled before the executor runs again: timers, services, more messages.
_AT_ONCE = 4


#: A function that takes a message, the message, and the node's time (ns) at which it came. It
#: waits as bytes: an IMU message takes 1.8 kB as an object and 0.6 kB as bytes, and the process
#: keeps the memory of its longest queue.
_Waiting = tuple[Callable[[Any], None], bytes, int]


class Inbox:
    """Subscribe for a node and take all waiting messages, whichever topic the executor serves.

    Each topic keeps as many waiting messages as its queue holds; older ones are dropped and
    counted.
    """

    def __init__(self, node: GraphNode) -> None:
        self._node = node
        self._order: ArrivalOrder[_Waiting] = ArrivalOrder()
        # For each topic: its depth, the function that takes a message with its info, and the
        # callback that puts it into the order.
        self._sources: list[tuple[int, Callable[[], Any], Callable[..., None]]] = []
        self._taking = self._resumes = False
        self.taken_ns = 0

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return how many messages of each topic were dropped, as values of a diagnostic."""
        return {f"given_up.{topic}": str(n) for topic, n in self._order.given_up.items()}

    def subscribe(
        self, topic: str, handle: Callable[[Any], None], qos: QoSProfile, typename: str = ""
    ) -> None:
        """Have ``handle`` called with each message in its turn; ``taken_ns`` is its arrival.

        ``typename`` as in ``GraphNode.listen``.
        """
        deferred = partial(self._deferred, topic)
        made = self._node.listen(topic, handle, qos, typename, wrapped=deferred, raw=True)
        depth = made.qos_profile.depth
        self._order.open(topic, depth)
        # Not public, so setup.py bounds the version of rclpy: test_inbox.py says why.
        take = partial(made.handle.take_message, made.msg_type, made.raw)
        self._sources.append((depth, take, made.callback))

    def _deferred(self, topic: str, receive: Callable[[Any], None]) -> Callable[..., None]:
        def put(data: bytes, info: Any) -> None:
            # Not every middleware gives the time of reception.
            arrived_ns = info["received_timestamp"] or info["source_timestamp"]
            self._order.put(topic, arrived_ns, (receive, data, self._node.now_ns))
            if not (self._taking or self._resumes):
                self._work()

        return told(put)

    def _work(self) -> None:
        """Handle the messages that arrived first, and schedule another call if more wait."""
        self._resumes = False
        self._take()
        for _ in range(_AT_ONCE):
            waiting = self._order.pop()
            if waiting is None:
                return
            receive, data, self.taken_ns = waiting
            receive(data)
        if self._order and self._node.executor is not None:
            self._resumes = True
            self._node.executor.create_task(self._work)

    def _take(self) -> None:
        """Take the messages that wait in the queues of the middleware."""
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
