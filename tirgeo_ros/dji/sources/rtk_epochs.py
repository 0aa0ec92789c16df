"""Combine the five topics on which DJI's ROS wrappers publish one RTK epoch.

The wrappers publish position, velocity, yaw and the two flags within milliseconds, in any order.
Flags have no header (in ROS 1, nor does the yaw): only the time of arrival shows their epoch. A
value that did not wait for its flag would get that of the epoch before, and would pass for fixed
where the fix has just been lost.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from tirgeo_ros.dji.sources.readings import Reading, RtkReading

#: Half of RTK's 200 ms: what comes later is nearer to the next epoch.
_HALF_EPOCH_NS = 100_000_000


class Arrived(NamedTuple):
    """Hold a reading and the time when the last of its messages arrived."""

    arrival_ns: int
    reading: Reading


class RtkEpochs:
    """Collect parts in the order of their arrival.

    An epoch ends with its fifth part, or with the first part of the next: one that the epoch has
    already, or one more than half an epoch after its first. The stamp is that of the position,
    else of the velocity, which have headers, else of the first part.
    """

    def __init__(self) -> None:
        self._begun_ns = self._arrival_ns = self._stamp_ns = 0
        self._parts: dict[str, Any] = {}

    def take(self, part: RtkReading, arrival_ns: int) -> list[Arrived]:
        """Take the content of one message; return the epochs that it ends."""
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
        is_whole = len(self._parts) == len(RtkReading._fields) - 1
        return [*done, *self.flush()] if is_whole else done

    def due(self, now_ns: int) -> list[Arrived]:
        """Return the epoch, if nothing more of it can come."""
        over = self._parts and not 0 <= now_ns - self._begun_ns <= _HALF_EPOCH_NS
        return self.flush() if over else []

    def flush(self) -> list[Arrived]:
        """Return the epoch as far as it has come."""
        parts, self._parts = self._parts, {}
        return [Arrived(self._arrival_ns, RtkReading(self._stamp_ns, **parts))] if parts else []
