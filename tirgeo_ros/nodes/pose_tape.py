"""Keep poses of the last seconds as the bytes they came in, and decode those that are wanted."""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections import deque
from collections.abc import Callable
from typing import Generic

from tirgeo_ros.core.gimbal.pose_buffer import P, PoseBuffer
from tirgeo_ros.io.bags.cdr import header_stamp_ns

_KEPT = 400  # a second of the fastest stream


class PoseTape(Generic[P]):
    """Hold messages by their stamps; ``decode`` makes a pose of one. Any thread may call it."""

    def __init__(self, decode: Callable[[bytes], P]) -> None:
        self._decode = decode
        self._lock = threading.Lock()
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=_KEPT)

    def add(self, data: bytes) -> None:
        """Add a message; one whose stamp goes back begins anew. Raises MessageError."""
        stamp_ns = header_stamp_ns(data)
        with self._lock:
            if self._kept and stamp_ns < self._kept[-1][0]:
                self._kept.clear()
            self._kept.append((stamp_ns, data))

    def around(self, stamp_ns: int, before_s: float = 0.0) -> PoseBuffer[P]:
        """Return the poses on both sides of an instant, and those of ``before_s`` before it."""
        with self._lock:
            kept = list(self._kept)
        stamps = [stamp for stamp, _ in kept]
        first = max(bisect_left(stamps, stamp_ns - round(before_s * 1e9)) - 1, 0)
        found: PoseBuffer[P] = PoseBuffer()
        for _, data in kept[first : bisect_left(stamps, stamp_ns) + 1]:
            found.add(self._decode(data))
        return found
