"""Measure how long pictures take, and count the frames that never came.

A frame that never came shows only in the publication sequence numbers: a newer one replaced it in
a shallow queue, or it was lost in transport.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from tirgeo_ros.nodes.graph_node import told

_FRAMES = 100


class FrameStatistics:
    """Hold the latencies of the newest hundred pictures, and count frames sent and missed.

    ``sent`` counts frames since the first that came, ``missed`` those of them that did not come.
    A number that goes back means a new publisher. With two publishers at once on one topic both
    counts are wrong.
    """

    def __init__(self) -> None:
        self.sent = self.missed = 0
        self._last: dict[str, int] = {}  # number of each topic's newest frame
        self._arrived_s: deque[tuple[int, float]] = deque(maxlen=_FRAMES)  # stamp (ns), time
        self._took_s: deque[float] = deque(maxlen=_FRAMES)

    def heard(self, topic: str, number: int) -> None:
        """Count the frame with this sequence number, and those missed before it."""
        last = self._last.get(topic, 0)
        skipped = number - last - 1 if 0 < last < number else 0
        self.missed += skipped
        self.sent += skipped + 1
        self._last[topic] = number

    def listening(self, topic: str, receive: Callable[[Any], None]) -> Callable[..., None]:
        """Return ``receive`` as the callback of a subscription that also counts the numbers."""

        def take(message: Any, info: Any) -> None:
            number = info.get("publication_sequence_number") if info else None
            if number is not None:  # not every middleware numbers messages
                self.heard(topic, number)
            receive(message)

        return told(take)

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
        """Return the counts, median and 95th percentile (ms), and the newest frame's stamp (s)."""
        found = {"frames_sent": str(self.sent), "frames_missed": str(self.missed)}
        if self._arrived_s:
            seconds = divmod(self._arrived_s[-1][0], 1_000_000_000)
            found["newest_frame"] = "{}.{:09d}".format(*seconds)
        for share in (50, 95) if self._took_s else ():
            found[f"latency p{share} [ms]"] = f"{1e3 * np.percentile(self._took_s, share):.1f}"
        return found
