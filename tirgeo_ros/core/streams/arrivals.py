"""Order items by their arrival, and stamp samples that have no time stamp with it.

The latency from measurement to arrival, where it is known, is a parameter. The estimator subtracts
that of a receiver (``rtk.delay_s``, ``gps.delay_s``); that of the pictures is ``video_latency_s``.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import replace
from typing import Generic, TypeVar

from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample, NavigationInput

S = TypeVar("S", bound=NavigationInput | JointSample | CameraAttitudeSample)
T = TypeVar("T")
Entry = tuple[int, int, T]  # time of arrival in ns, number, item


class Arrivals:
    """Stamp samples without a time stamp, and count them by topic."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of samples without a stamp by topic."""
        return dict(self._counts)

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return the counts as key and value strings for diagnostics."""
        return {f"stamped_at_arrival.{topic}": str(n) for topic, n in self._counts.items()}

    def stamped(self, topic: str, sample: S, arrival_ns: int) -> S:
        """Return the sample; if its stamp is 0, a copy stamped with the time of arrival."""
        stamp_ns = self.stamp_ns(topic, sample.stamp_ns, arrival_ns)
        return sample if stamp_ns == sample.stamp_ns else replace(sample, stamp_ns=stamp_ns)

    def stamp_ns(self, topic: str, stamp_ns: int, arrival_ns: int) -> int:
        """Return the stamp; if it is 0, count it and return the time of arrival."""
        if stamp_ns != 0:
            return stamp_ns
        self._counts[topic] += 1
        return arrival_ns


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
