"""Combine the five topics on which DJI's ROS 1 wrapper publishes one RTK epoch.

The wrapper publishes position, velocity, yaw and the two flags one after another when a packet
comes in. Yaw and flags have no header: only the time when they were recorded shows their epoch.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from tirgeo_ros.dji.sources.readings import Reading, RtkReading

#: Half of RTK's 200 ms: what comes later is nearer to the next epoch.
_HALF_EPOCH_NS = 100_000_000


class Arrived(NamedTuple):
    """Hold a reading and the time when the last of its messages was recorded."""

    arrival_ns: int
    reading: Reading


class RtkEpochs:
    """Collect parts in the order of their arrival; an epoch ends where the next begins.

    The next begins with a part that the epoch has already, or one more than half an epoch after
    its first. The stamp is that of the position, else of the velocity, which have headers, else of
    the first part.
    """

    def __init__(self) -> None:
        self._begun_ns = self._arrival_ns = self._stamp_ns = 0
        self._parts: dict[str, Any] = {}

    def take(self, part: RtkReading, arrival_ns: int) -> list[Arrived]:
        """Take the content of one message; return the epoch that it ends."""
        given = {name: value for name, value in part._asdict().items() if value is not None}
        stamp_ns = given.pop("stamp_ns")
        done = self.due(arrival_ns)
        if not given.keys().isdisjoint(self._parts):
            done = self.flush()
        if not self._parts:
            self._begun_ns, self._stamp_ns = arrival_ns, stamp_ns
        if "place" in given or ("velocity_n" in given and "place" not in self._parts):
            self._stamp_ns = stamp_ns
        self._parts |= given
        self._arrival_ns = arrival_ns
        return done

    def due(self, now_ns: int) -> list[Arrived]:
        """Return the epoch, if nothing more of it can come."""
        over = self._parts and not 0 <= now_ns - self._begun_ns <= _HALF_EPOCH_NS
        return self.flush() if over else []

    def flush(self) -> list[Arrived]:
        """Return the epoch as far as it has come."""
        parts, self._parts = self._parts, {}
        return [Arrived(self._arrival_ns, RtkReading(self._stamp_ns, **parts))] if parts else []
