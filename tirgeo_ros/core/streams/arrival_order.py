"""Hold items in several queues and return them in the order of their arrival."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")
Entry = tuple[int, int, T]  # time of arrival in ns, number, item


class ArrivalOrder(Generic[T]):
    """Merge several bounded FIFO queues, called lanes, by the time of arrival.

    The samples' own time stamps do not affect the order. The filter decides what is early, late
    or from another clock, and it needs the samples as they arrived to do so. A full lane discards
    its oldest item.
    """

    def __init__(self) -> None:
        self._lanes: dict[str, deque[Entry[T]]] = {}
        self._given_up: dict[str, int] = {}
        self._number = 0

    def __len__(self) -> int:
        return sum(map(len, self._lanes.values()))

    def open(self, lane: str, depth: int) -> None:
        """Create an empty lane that holds up to ``depth`` items."""
        self._lanes[lane] = deque(maxlen=depth)

    @property
    def given_up(self) -> dict[str, int]:
        """Return the number of discarded items by lane, without lanes that discarded none."""
        return dict(self._given_up)

    def put(self, lane: str, arrived_ns: int, item: T) -> None:
        """Append an item that arrived at ``arrived_ns`` to a lane; discard the oldest if full."""
        entries = self._lanes[lane]
        if len(entries) == entries.maxlen:
            self._given_up[lane] = self._given_up.get(lane, 0) + 1
        self._number += 1
        entries.append((arrived_ns, self._number, item))

    def pop(self) -> T | None:
        """Remove and return the earliest of the lanes' first items; None if all are empty."""
        waiting = [entries for entries in self._lanes.values() if entries]
        if not waiting:
            return None
        return min(waiting, key=lambda entries: entries[0][:2]).popleft()[2]
