"""Unwrap a free-running counter of few bits to a time that continues."""

from __future__ import annotations

#: Ticks of the aircraft's counters. Hard sync counts long ones, and so may the broadcast of
#: firmware before 3.3, in the field that counts milliseconds in newer firmware.
MILLISECOND_NS, LONG_TICK_NS = 1_000_000, 2_500_000
#: A fraction of a tick cannot be longer than this.
LONGEST_EXTRA_NS = 10_000_000


def is_long(passed: float, counted: float) -> bool:
    """Return whether a count taken for milliseconds is in ticks of 2.5 ms, by the time passed.

    A tenth is left for delays.
    """
    return abs(passed - counted * LONG_TICK_NS / MILLISECOND_NS) <= 0.1 * passed


class RunningCounter:
    """Unwrap a counter: choose the value nearest to the newest one taken, within half a turn."""

    def __init__(self, tick_ns: int, bits: int) -> None:
        self.tick_ns = tick_ns
        self._mask = (1 << bits) - 1
        self._half = 1 << (bits - 1)
        self._newest = 0
        self._newest_ns = 0
        self.wraps = 0

    def begin(self, ticks: int) -> int:
        """Start at these ticks; return their time in nanoseconds."""
        self._newest = ticks & self._mask
        self._newest_ns = self._newest * self.tick_ns
        return self._newest_ns

    def time_ns(self, ticks: int) -> int:
        """Return the time of the ticks in nanoseconds; before the newest where they went back."""
        ahead = (ticks - self._newest) & self._mask
        if ahead > self._half:
            ahead -= self._mask + 1
        return self._newest_ns + ahead * self.tick_ns

    def go_on(self, ticks: int, time_ns: int) -> None:
        """Take ticks, with their time from ``time_ns``, as the newest."""
        ticks &= self._mask
        if ticks < self._newest and time_ns > self._newest_ns:
            self.wraps += 1
        self._newest, self._newest_ns = ticks, time_ns
