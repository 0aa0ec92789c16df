"""Measure the latency from a frame's arrival to the publication of its picture."""

from __future__ import annotations

import math
import time
from collections import deque

_FRAMES = 100


class FrameTimes:
    """Hold the latencies of the newest hundred pictures, by this machine's steady clock."""

    def __init__(self) -> None:
        self._arrived_s: deque[tuple[int, float]] = deque(maxlen=_FRAMES)  # stamp (ns), time
        self._took_s: deque[float] = deque(maxlen=_FRAMES)

    def arrived(self, stamp_ns: int) -> None:
        """Record the arrival of a frame."""
        self._arrived_s.append((stamp_ns, time.monotonic()))

    def left(self, stamp_ns: int) -> float:
        """Record that its picture was published; return seconds since arrival, 0 if unknown."""
        now_s = time.monotonic()
        took_s = now_s - dict(self._arrived_s).get(stamp_ns, now_s)
        self._took_s.append(took_s)
        return took_s

    @property
    def values(self) -> dict[str, str]:
        """Return median and 95th percentile (ms) and the newest frame's stamp (s) as texts."""
        newest = {"newest_frame": _seconds(self._arrived_s[-1][0])} if self._arrived_s else {}
        ranked_ms = [1e3 * took_s for took_s in sorted(self._took_s)]
        return newest | {
            f"latency p{share} [ms]": f"{_at(ranked_ms, share):.1f}"
            for share in (50, 95)
            if ranked_ms
        }


def _seconds(stamp_ns: int) -> str:
    """Return a stamp in seconds, with nine decimals."""
    return "{}.{:09d}".format(*divmod(stamp_ns, 1_000_000_000))


def _at(ranked: list[float], percent: int) -> float:
    return ranked[math.ceil(percent / 100 * len(ranked)) - 1]
