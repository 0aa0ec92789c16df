"""The time of a bag that is being played: a line through real time, and ticks along it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class PlayClock:
    """Bag time that runs at ``rate`` from the first stamp asked for.

    ``tick(bag_ns)`` is called every ``1 / tick_rate_hz`` of real time, between messages too; the
    ticks never go back and never pass the message that is waited for.
    """

    def __init__(self, rate: float, tick_rate_hz: float, tick: Callable[[int], None]) -> None:
        self._rate = rate
        self._period_s = 1 / tick_rate_hz
        self._tick = tick
        self._begin: tuple[float, int] | None = None  # real s, bag ns
        self._next_tick_s = 0.0

    def begin(self, bag_ns: int, in_s: float) -> None:
        """Bag time will be ``bag_ns`` in so many seconds; else it begins with the first wait."""
        self._begin = (time.monotonic() + in_s, bag_ns)

    def wait_until(self, bag_ns: int, stop: threading.Event) -> bool:
        """Sleep and tick until the bag's time is ``bag_ns``; False if stopped before."""
        if self._begin is None:
            self._begin = (time.monotonic(), bag_ns)
        due_s = self._begin[0] + (bag_ns - self._begin[1]) * 1e-9 / self._rate
        while not stop.is_set():
            now_s = time.monotonic()
            self._tick_if_due(now_s, bag_ns)
            if now_s >= due_s:
                return True
            stop.wait(min(due_s, self._next_tick_s) - now_s)
        return False

    def _tick_if_due(self, now_s: float, limit_ns: int) -> None:
        if now_s < self._next_tick_s or self._begin is None:
            return
        self._next_tick_s += self._period_s
        if self._next_tick_s <= now_s:  # a stall, or the start: missed ticks are left out
            self._next_tick_s = now_s + self._period_s
        elapsed_ns = max(0, round((now_s - self._begin[0]) * self._rate * 1e9))
        self._tick(min(self._begin[1] + elapsed_ns, limit_ns))
