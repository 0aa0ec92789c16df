"""Limit the rate of outputs that follow inputs."""

from __future__ import annotations


class RateLimit:
    """Select from a stream of time stamps those at which an output is due at a rate (Hz).

    A stamp may be early by a quarter of a period, so that all inputs at the rate itself are due.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._next_ns: int | None = None

    def due(self, stamp_ns: int) -> bool:
        """Return whether an output is due at a stamp (ns).

        If it is, the next one is scheduled a period later. If the stamp is more than
        two periods from the schedule (after a pause, or when stamps go back), the schedule
        restarts at this stamp.
        """
        if self._next_ns is None or abs(stamp_ns - self._next_ns) > 2 * self._period_ns:
            self._next_ns = stamp_ns
        if stamp_ns < self._next_ns - self._period_ns // 4:
            return False
        self._next_ns += self._period_ns
        return True
