"""What the stamps and arrivals of one topic look like: rate, gaps, age by windows."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

#: Ages are looked at by their smallest over so long: what was on its way for the shortest time.
_WINDOW_NS = 1_000_000_000
_KEPT = 12  # windows
#: Samples after which a rate is one.
_LEAST_NUMBER = 8


class Window(NamedTuple):
    """A second of a topic."""

    arrival_ns: int  # when it began
    age_ns: int  # smallest arrival less stamp


class Stream:
    """Follows one topic; a sample costs less than 1 us."""

    def __init__(self, longest_step_s: float) -> None:
        self._longest_ns = round(longest_step_s * 1e9)
        self.count = self.unstamped = self.back = 0  # samples; with stamp 0; not after the last
        self.gaps = self.longest_ns = 0  # steps beyond longest_step_s
        self.first_ns = self.newest_ns = self.arrived_ns = 0
        self.windows: deque[Window] = deque(maxlen=_KEPT)  # ended
        self.first_window: Window | None = None
        self._flowing_ns = self._steps = 0  # of steps that are no gaps
        self._window: Window | None = None

    def add(self, stamp_ns: int, arrival_ns: int) -> bool:
        """Take the next sample to come; return whether that ended a window."""
        self.count += 1
        self.arrived_ns = arrival_ns
        if stamp_ns == 0:
            self.unstamped += 1
            stamp_ns = arrival_ns
        step_ns = stamp_ns - self.newest_ns
        if self.count == 1:
            self.first_ns = stamp_ns
        elif step_ns <= 0:
            self.back += 1
        elif step_ns > self._longest_ns:
            self.gaps += 1
            self.longest_ns = max(self.longest_ns, step_ns)
        else:
            self._flowing_ns += step_ns
            self._steps += 1
        self.newest_ns = stamp_ns
        return self._aged(arrival_ns - stamp_ns, arrival_ns)

    def _aged(self, age_ns: int, arrival_ns: int) -> bool:
        window = self._window
        if window is None or not 0 <= arrival_ns - window.arrival_ns < _WINDOW_NS:
            self._window = Window(arrival_ns, age_ns)
            if window is None:
                return False
            self.windows.append(window)
            self.first_window = self.first_window or window
            return True
        if age_ns < window.age_ns:
            self._window = Window(window.arrival_ns, age_ns)
        return False

    @property
    def rate_hz(self) -> float | None:
        """Return the mean rate but for gaps; None of too few samples."""
        return self._steps / (self._flowing_ns * 1e-9) if self._steps >= _LEAST_NUMBER else None
