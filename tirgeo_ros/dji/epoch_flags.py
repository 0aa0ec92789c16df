"""Values of RTK and their flags that come in messages of their own, put together again.

DJI's wrappers for ROS send the flag of a position or a yaw without a header, milliseconds before
or after the value that it belongs to: nothing says which. A value that does not wait for its flag
gets that of the epoch before, and where the fix is just lost it passes for fixed.
"""

from __future__ import annotations

from collections import deque
from typing import Literal

from tirgeo_ros.dji.readings import RtkReading

#: A value and its flag come within this, or one of them was lost: a fifth of RTK's 200 ms.
HOLD_NS = 40_000_000


class EpochFlags:
    """Gives each value of one topic the flag of its own epoch, by the order of their arrival.

    The value that waits longest takes the flag that waits longest, so that bursts come out right
    as well. Neither waits for longer than ``HOLD_NS``: a value then goes without a flag, a flag
    without a value, and whoever takes them judges by the newest. All times are of one clock;
    where it goes back, what waits is let go.
    """

    def __init__(self, field: Literal["position_flag", "yaw_flag"]) -> None:
        """``field`` is the flag's in RtkReading."""
        self._field = field
        self._values: deque[tuple[int, RtkReading]] = deque()  # with their arrivals
        self._flags: deque[tuple[int, RtkReading]] = deque()
        self.alone = 0  # values whose own flag did not come

    def value(self, reading: RtkReading, arrival_ns: int) -> list[RtkReading]:
        """A value came; what is complete now, or has waited long enough."""
        done = self.due(arrival_ns)
        self._values.append((arrival_ns, reading))
        return done + self._paired()

    def flag(self, flag: int, arrival_ns: int) -> list[RtkReading]:
        """A flag came; what is complete now, or has waited long enough."""
        done = self.due(arrival_ns)
        reading = RtkReading(arrival_ns)
        self._flags.append((arrival_ns, self._flagged(reading, flag)))
        return done + self._paired()

    def due(self, now_ns: int) -> list[RtkReading]:
        """What has waited long enough; to be called every now and then."""
        flags = _overdue(self._flags, now_ns)
        values = _overdue(self._values, now_ns)
        self.alone += len(values)
        return flags + values

    def _paired(self) -> list[RtkReading]:
        done = []
        while self._values and self._flags:
            reading, flag = self._values.popleft()[1], self._flags.popleft()[1]
            done.append(self._flagged(reading, getattr(flag, self._field)))
        return done

    def _flagged(self, reading: RtkReading, flag: int) -> RtkReading:
        if self._field == "yaw_flag":
            return reading._replace(yaw_flag=flag)
        return reading._replace(position_flag=flag)


def _overdue(waiting: deque[tuple[int, RtkReading]], now_ns: int) -> list[RtkReading]:
    found = []
    while waiting and not 0 <= now_ns - waiting[0][0] < HOLD_NS:
        found.append(waiting.popleft()[1])
    return found
