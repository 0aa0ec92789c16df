"""What waits in several queues, in the order in which it arrived."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")
Entry = tuple[int, int, T]  # time of arrival in ns, number, item


class ArrivalOrder(Generic[T]):
    """One queue a lane, each in the order in which it was filled; the lanes merged by arrival.

    The stamps of samples have no say: what is early, late or of another clock is for the filter
    to judge, and it judges by what came before. A full lane gives up its oldest item.
    """

    def __init__(self) -> None:
        self._lanes: dict[str, deque[Entry[T]]] = {}
        self._given_up: dict[str, int] = {}
        self._number = 0

    def __len__(self) -> int:
        return sum(map(len, self._lanes.values()))

    def open(self, lane: str, depth: int) -> None:
        """Have a lane that holds ``depth`` items."""
        self._lanes[lane] = deque(maxlen=depth)

    @property
    def given_up(self) -> dict[str, int]:
        """How many items each lane has given up; without those that gave up none."""
        return dict(self._given_up)

    def put(self, lane: str, arrived_ns: int, item: T) -> None:
        """Add an item that arrived at ``arrived_ns``, behind those of its lane."""
        entries = self._lanes[lane]
        if len(entries) == entries.maxlen:
            self._given_up[lane] = self._given_up.get(lane, 0) + 1
        self._number += 1
        entries.append((arrived_ns, self._number, item))

    def pop(self) -> T | None:
        """Take the item that arrived first of those at the lanes' heads; None where none waits."""
        waiting = [entries for entries in self._lanes.values() if entries]
        if not waiting:
            return None
        return min(waiting, key=_head).popleft()[2]


def _head(entries: deque[Entry[T]]) -> tuple[int, int]:
    return entries[0][:2]
