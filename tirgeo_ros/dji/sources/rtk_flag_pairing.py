"""Match values of RTK with their flags, which come in messages of their own.

DJI's wrappers for ROS send the flag of a position or a yaw without a header, milliseconds before
or after the values that it belongs to; nothing in it shows which comes first. A value that does
not wait for its flag would get that of the epoch before, and would pass for fixed where the fix
has just been lost.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

from tirgeo_ros.dji.sources.readings import RtkReading

#: A value and its flag come within this, or one of them was lost: a fifth of RTK's 200 ms.
HOLD_NS = 40_000_000

Waiting = deque[tuple[int, RtkReading]]  # with their arrivals


@dataclass(slots=True)
class _Flag:
    arrival_ns: int
    reading: RtkReading  # nothing but the flag
    served: set[str] = field(default_factory=set)  # topics whose value has it


class EpochFlags:
    """Give each value the flag of its own epoch, by the order of their arrival.

    For each topic the value that waits longest gets the flag that waits longest, so bursts are
    matched correctly as well. Neither waits for longer than ``HOLD_NS``. A value is then released
    without a flag, an unused flag without a value, and the receiver of both uses the newest. All
    times are of one clock; where it goes back, what waits is released.
    """

    def __init__(self, name: str) -> None:
        """Take ``name``, the field in RtkReading: position_flag or yaw_flag."""
        self._name = name
        self._values: dict[str, Waiting] = {}  # by topic
        self._flags: deque[_Flag] = deque()
        self.alone: Counter[str] = Counter()  # values of each topic whose own flag did not come

    def value(self, topic: str, reading: RtkReading, arrival_ns: int) -> list[RtkReading]:
        """Take a value; return what is complete now, or has waited long enough."""
        done = self.due(arrival_ns)
        self._values.setdefault(topic, deque()).append((arrival_ns, reading))
        return done + self._paired(topic)

    def flag(self, flag: int, arrival_ns: int) -> list[RtkReading]:
        """Take a flag; return what is complete now, or has waited long enough."""
        done = self.due(arrival_ns)
        number: dict[str, Any] = {self._name: flag}
        reading = RtkReading(arrival_ns)._replace(**number)
        self._flags.append(_Flag(arrival_ns, reading))
        return done + [reading for topic in self._values for reading in self._paired(topic)]

    def due(self, now_ns: int) -> list[RtkReading]:
        """Return what has waited long enough; to be called every now and then."""
        done = []
        while self._flags and _is_over(self._flags[0].arrival_ns, now_ns):
            flag = self._flags.popleft()
            done += [] if flag.served else [flag.reading]
        for topic, values in self._values.items():
            while values and _is_over(values[0][0], now_ns):
                self.alone[topic] += 1
                done.append(values.popleft()[1])
        return done

    def _paired(self, topic: str) -> list[RtkReading]:
        done, values = [], self._values[topic]
        for flag in self._flags:
            if values and topic not in flag.served:
                flag.served.add(topic)
                number: dict[str, Any] = {self._name: getattr(flag.reading, self._name)}
                done.append(values.popleft()[1]._replace(**number))
        return done


def _is_over(arrival_ns: int, now_ns: int) -> bool:
    return not 0 <= now_ns - arrival_ns < HOLD_NS
