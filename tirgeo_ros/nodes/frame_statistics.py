"""Measure how long pictures take, and count the frames that never came.

A frame that never came shows only in the publication sequence numbers: a newer one replaced it in
a shallow queue, or it was lost in transport.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from tirgeo_ros.nodes.callbacks import told

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
        newest = {}
        if self._arrived_s:
            seconds = divmod(self._arrived_s[-1][0], 1_000_000_000)
            newest = {"newest_frame": "{}.{:09d}".format(*seconds)}
        ranked_ms = [1e3 * took_s for took_s in sorted(self._took_s)]
        for share in (50, 95) if ranked_ms else ():
            took_ms = ranked_ms[math.ceil(share / 100 * len(ranked_ms)) - 1]
            newest[f"latency p{share} [ms]"] = f"{took_ms:.1f}"
        return newest


class SentNumbers:
    """Track the sequence numbers of one publisher's messages, or of the publisher after it.

    ``sent`` counts messages since the first that came, ``missed`` those of them that did not come.
    A number that goes back means a new publisher. With two publishers at once both counts are
    wrong.
    """

    def __init__(self) -> None:
        self.sent = self.missed = 0
        self._last = 0

    def heard(self, number: int) -> None:
        """Count the message with this sequence number, and those missed before it."""
        skipped = number - self._last - 1 if 0 < self._last < number else 0
        self.missed += skipped
        self.sent += skipped + 1
        self._last = number

    def listening(self, receive: Callable[[Any], None]) -> Callable[..., None]:
        """Return ``receive`` as the callback of a subscription that also counts the numbers."""

        def take(message: Any, info: Any) -> None:
            number = info.get("publication_sequence_number") if info else None
            if number is not None:  # not every middleware numbers messages
                self.heard(number)
            receive(message)

        return told(take)
