"""Unwrap a free-running counter of few bits to a time that continues."""

from __future__ import annotations

#: A fraction of a tick cannot be longer than this (a tick has 1 or 2.5 ms).
LONGEST_EXTRA_NS = 10_000_000


class RunningCounter:
    """Unwrap a counter: choose the value nearest to the newest one taken, within half a turn."""

    def __init__(self, tick_ns: int, bits: int) -> None:
        self._tick_ns = tick_ns
        self._mask = (1 << bits) - 1
        self._half = 1 << (bits - 1)
        self._newest = 0
        self._newest_ns = 0
        self.wraps = 0

    def begin(self, ticks: int) -> int:
        """Start at these ticks; return their time in nanoseconds."""
        self._newest = ticks & self._mask
        self._newest_ns = self._newest * self._tick_ns
        return self._newest_ns

    def time_ns(self, ticks: int) -> int:
        """Return the time of the ticks in nanoseconds; before the newest where they went back."""
        ahead = (ticks - self._newest) & self._mask
        if ahead > self._half:
            ahead -= self._mask + 1
        return self._newest_ns + ahead * self._tick_ns

    def go_on(self, ticks: int, time_ns: int) -> None:
        """Take ticks, with their time from ``time_ns``, as the newest."""
        ticks &= self._mask
        if ticks < self._newest and time_ns > self._newest_ns:
            self.wraps += 1
        self._newest, self._newest_ns = ticks, time_ns
