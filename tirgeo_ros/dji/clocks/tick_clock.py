"""Determine the length of a tick of the broadcast's counter from the speed at which it counts.

It counts milliseconds in firmware from 3.3 on. DJI's documents of older ones (M100, A3 3.1) state
ticks of 2.5 ms. The field's name is the same in both.
"""

from __future__ import annotations

from collections.abc import Callable

from tirgeo_ros.dji.clocks.aircraft_clock import AircraftClock
from tirgeo_ros.dji.clocks.running_counter import RunningCounter

MILLISECOND_NS, LONG_TICK_NS = 1_000_000, 2_500_000
_RATIO = LONG_TICK_NS / MILLISECOND_NS
#: Length of a look. A queue that appears or vanishes in it (50 ms) changes its length by a tenth.
_LOOK_NS = 500_000_000
_TOLERANCE = 0.1
#: Looks in a row that must agree: a line too slow by a factor of 2.5 would overflow any queue in
#: them.
_LOOKS = 2


def is_long(passed_ns: float, counted_ns: float) -> bool:
    """Return whether a count taken for milliseconds is in ticks of 2.5 ms."""
    return abs(passed_ns - _RATIO * counted_ns) <= _TOLERANCE * passed_ns


class TickClock:
    """Use an AircraftClock of 1 ms ticks, and change to 2.5 ms ticks where the counter shows them.

    It looks until either length has been seen twice in a row. If the ticks are long, stamps of the
    first second fall behind by 0.6 s; then they continue at their right times.
    """

    def __init__(self, make: Callable[[int], AircraftClock]) -> None:
        """Take ``make``, which returns a clock for ticks of a given length in nanoseconds."""
        self._make = make
        self._clock = make(MILLISECOND_NS)
        self._tick_ns = MILLISECOND_NS
        self._counter = RunningCounter(MILLISECOND_NS, 32)
        self._begun: tuple[int, int] | None = None  # start of the open look: arrival, count in ns
        self._seen: list[int] = []  # tick lengths of the newest looks, which agree

    def stamp_ns(self, ticks: int, arrival_ns: int, extra_ns: int = 0) -> int:
        """Return the stamp of a counter's value that arrived at ``arrival_ns``."""
        if len(self._seen) < _LOOKS:
            self._look(ticks, arrival_ns)
        return self._clock.stamp_ns(ticks, arrival_ns, extra_ns)

    def _look(self, ticks: int, arrival_ns: int) -> None:
        if self._begun is None:
            self._begun = (arrival_ns, self._counter.begin(ticks))
            return
        passed_ns = arrival_ns - self._begun[0]
        if 0 <= passed_ns < _LOOK_NS:
            return
        counted_ns = self._counter.time_ns(ticks) - self._begun[1]
        self._begun = (arrival_ns, self._counter.begin(ticks))
        is_short = abs(passed_ns - counted_ns) <= _TOLERANCE * passed_ns
        if not is_short and not is_long(passed_ns, counted_ns):
            self._seen = []
            return
        tick_ns = MILLISECOND_NS if is_short else LONG_TICK_NS
        self._seen = [*(seen for seen in self._seen if seen == tick_ns), tick_ns]
        if len(self._seen) >= _LOOKS and tick_ns == LONG_TICK_NS:
            self._tick_ns = LONG_TICK_NS
            self._clock = self._make(LONG_TICK_NS)

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return the clock's diagnostics, and the tick where it is not a millisecond."""
        tick = {"clock tick [ms]": "2.5"} if self._tick_ns == LONG_TICK_NS else {}
        return self._clock.diagnostics | tick
