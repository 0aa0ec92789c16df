"""A highest rate for outputs that follow inputs."""

from __future__ import annotations


class RateLimit:
    """Says which of a stream of stamps are due at a rate.

    A quarter of a period of jitter is let pass, so that inputs at the rate itself are all due.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._next_ns: int | None = None

    def due(self, stamp_ns: int) -> bool:
        """Whether an output is due at a stamp; the next one then is a period later.

        After a pause, or when stamps go back, the schedule begins anew.
        """
        if self._next_ns is None or abs(stamp_ns - self._next_ns) > 2 * self._period_ns:
            self._next_ns = stamp_ns
        if stamp_ns < self._next_ns - self._period_ns // 4:
            return False
        self._next_ns += self._period_ns
        return True
