"""Convert between bag time and real time while a bag is played, and publish clock ticks."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class PlayClock:
    """Run bag time at ``rate`` times real time from the first stamp that is waited for.

    ``tick(bag_ns)`` is called every ``1 / tick_rate_hz`` of real time, between messages too. The
    ticks never go back and never pass the message that is waited for.
    """

    def __init__(self, rate: float, tick_rate_hz: float, tick: Callable[[int], None]) -> None:
        self._rate = rate
        self._period_s = 1 / tick_rate_hz
        self._tick = tick
        self._begin: tuple[float, int] | None = None  # real s, bag ns
        self._next_tick_s = 0.0

    def begin(self, bag_ns: int, in_s: float) -> None:
        """Start bag time so that it is ``bag_ns`` in ``in_s`` seconds.

        Else the first wait starts it.
        """
        self._begin = (time.monotonic() + in_s, bag_ns)

    def wait_until(self, bag_ns: int, stop: threading.Event) -> bool:
        """Sleep and tick until bag time reaches ``bag_ns``; return False if stopped before."""
        if self._begin is None:
            self._begin = (time.monotonic(), bag_ns)
        due_s = self._begin[0] + (bag_ns - self._begin[1]) * 1e-9 / self._rate
        while not stop.is_set():
            now_s = time.monotonic()
            if now_s >= self._next_tick_s:
                self._next_tick_s += self._period_s
                if self._next_tick_s <= now_s:  # missed ticks are skipped
                    self._next_tick_s = now_s + self._period_s
                elapsed_ns = max(0, round((now_s - self._begin[0]) * self._rate * 1e9))
                self._tick(min(self._begin[1] + elapsed_ns, bag_ns))
            if now_s >= due_s:
                return True
            stop.wait(min(due_s, self._next_tick_s) - now_s)
        return False
