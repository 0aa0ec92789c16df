"""Track the stamps and arrivals of one topic: rate, gaps, order, age."""

from __future__ import annotations

#: Number of steps from which a rate is computed.
_LEAST_NUMBER = 8


class Stream:
    """Track one topic; a sample costs less than 1 us."""

    def __init__(self, longest_step_s: float) -> None:
        self._longest_ns = round(longest_step_s * 1e9)
        # samples; samples with stamp 0; stamps that are not later than the one before
        self.count = self.unstamped = self.back = 0
        self.gaps = self.longest_ns = 0  # steps longer than longest_step_s
        self.newest_ns = self.arrived_ns = 0
        self.age_ns = 0  # arrival minus stamp of the newest sample
        self._flowing_ns = self._steps = 0  # over the steps that are not gaps

    def add(self, stamp_ns: int, arrival_ns: int) -> None:
        """Take the next sample to arrive; one with stamp 0 gets its arrival time."""
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
        """Return the mean rate without gaps, Hz; None with too few samples."""
        return self._steps / (self._flowing_ns * 1e-9) if self._steps >= _LEAST_NUMBER else None
