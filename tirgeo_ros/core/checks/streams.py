"""What the stamps and arrivals of one topic look like: rate, gaps, order, age."""

from __future__ import annotations

#: Samples after which a rate is one.
_LEAST_NUMBER = 8


class Stream:
    """Follows one topic; a sample costs less than 1 us."""

    def __init__(self, longest_step_s: float) -> None:
        self._longest_ns = round(longest_step_s * 1e9)
        self.count = self.unstamped = self.back = 0  # samples; with stamp 0; not after the last
        self.gaps = self.longest_ns = 0  # steps beyond longest_step_s
        self.newest_ns = self.arrived_ns = 0
        self.age_ns = 0  # arrival less stamp of the newest
        self._flowing_ns = self._steps = 0  # of steps that are no gaps

    def add(self, stamp_ns: int, arrival_ns: int) -> None:
        """Take the next sample to come; one without a stamp counts as measured at arrival."""
        if stamp_ns == 0:
            self.unstamped += 1
            stamp_ns = arrival_ns
        if self.count:
            self._step(stamp_ns - self.newest_ns)
        self.count += 1
        self.newest_ns, self.arrived_ns = stamp_ns, arrival_ns
        self.age_ns = arrival_ns - stamp_ns

    def _step(self, step_ns: int) -> None:
        if step_ns <= 0:
            self.back += 1
        elif step_ns > self._longest_ns:
            self.gaps += 1
            self.longest_ns = max(self.longest_ns, step_ns)
        else:
            self._flowing_ns += step_ns
            self._steps += 1

    @property
    def rate_hz(self) -> float | None:
        """Return the mean rate but for gaps; None of too few samples."""
        return self._steps / (self._flowing_ns * 1e-9) if self._steps >= _LEAST_NUMBER else None
