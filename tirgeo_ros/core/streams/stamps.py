"""Judge the stamps of one stream: due, steady, silent, jumping alone; the time of exposure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.types.arrays import BoolArray, IntArray

#: A stream is steady after this many samples over at least this time.
_SAMPLES = 5
_STEADY_NS = 2_000_000_000
#: A steady stream is gone after this silence. Before that, a gap of this length or a step back of
#: the stamps restarts the count.
_SILENT_NS = 2_000_000_000


def exposure_ns(stamp_ns: int, video_latency_s: float) -> int:
    """Return when a picture was exposed, ns: its stamp less the video's latency."""
    return stamp_ns - round(video_latency_s * 1e9)


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


class Spacing:
    """Select the stamps of a stream that are an interval apart; one that goes back is due too."""

    def __init__(self, interval_ns: int) -> None:
        self._interval_ns = interval_ns
        self._newest_ns: int | None = None

    def is_due(self, stamp_ns: int) -> bool:
        """Return whether a stamp would be taken."""
        newest_ns = self._newest_ns
        return newest_ns is None or not 0 <= stamp_ns - newest_ns < self._interval_ns

    def take(self, stamp_ns: int) -> bool:
        """Take a stamp if it is due; return whether it was."""
        is_due = self.is_due(stamp_ns)
        if is_due:
            self._newest_ns = stamp_ns
        return is_due


class StreamPresence:
    """Track whether one stream is steady, from its stamps and those of another stream."""

    def __init__(self) -> None:
        self.steady = False
        self._first_ns = 0
        self._newest_ns = 0
        self._count = 0

    def heard(self, stamp_ns: int) -> bool:
        """Take a sample's stamp (ns); return True if the stream becomes steady with it."""
        if self._count and not 0 <= stamp_ns - self._newest_ns < _SILENT_NS:
            self._count = 0
        if self._count == 0:
            self._first_ns = stamp_ns
        self._newest_ns = stamp_ns
        self._count += 1
        long_enough = self._count >= _SAMPLES and stamp_ns - self._first_ns >= _STEADY_NS
        became = long_enough and not self.steady
        self.steady = self.steady or long_enough
        return became

    def gone(self, now_ns: int) -> bool:
        """Take a stamp (ns) of another stream; return True if this one has just fallen silent."""
        if not self.steady or now_ns - self._newest_ns < _SILENT_NS:
            return False
        self.steady = False
        self._count = 0
        return True


#: A stamp jumps if it is this far from the median of the five about it, which two steps are not.
_LEAST_NS, _LEAST_STEPS = 1_000_000_000, 3


def lone_stamps(stamps_ns: Sequence[int] | IntArray) -> BoolArray:
    """Return which stamps (N,) are far from those beside them; none of fewer than five.

    After a gap, or when a clock is set, there are others of the same time beside a stamp.
    """
    stamps = np.asarray(stamps_ns, np.int64)
    if len(stamps) < 5:
        return np.zeros(len(stamps), bool)
    near = np.sort(np.lib.stride_tricks.sliding_window_view(stamps, 5))
    steps = np.sort(np.diff(near))[:, 1]
    medians, steps = (np.pad(each, 2, mode="edge") for each in (near[:, 2], steps))
    return np.asarray(np.abs(stamps - medians) > np.maximum(_LEAST_NS, _LEAST_STEPS * steps))
