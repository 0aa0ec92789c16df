"""The one video frame that waits to be drawn: the newest wins, and what is lost is counted."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.text import Pixels

#: A stamp that goes back by more than this is a clock that was set, not a late frame.
_JUMP_NS = 1_000_000_000
_RATE_FRAMES = 10


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture of the video."""

    stamp_ns: int
    pixels: Pixels  # (h, w) or (h, w, 3) BGR
    arrival_ns: int  # by the caller's clock


class FrameQueue:
    """Holds the newest frame until it is taken.

    ``counts``: ``replaced`` frames gave way to a newer one, ``out_of_order`` ones were not newer
    than the one before, ``time_jumps`` are stamps that went back by more than a second (after
    which the video goes on), ``invalid`` ones are no 8-bit picture.
    """

    def __init__(self) -> None:
        self.waiting: Frame | None = None
        self.counts = {"replaced": 0, "out_of_order": 0, "time_jumps": 0, "invalid": 0}
        self._stamps: deque[int] = deque(maxlen=_RATE_FRAMES)

    def put(self, frame: Frame) -> None:
        """Take a frame in the place of the one that waits."""
        if not _is_picture(frame.pixels):
            self.counts["invalid"] += 1
        elif not self._in_order(frame.stamp_ns):
            self.counts["out_of_order"] += 1
        else:
            self.counts["replaced"] += self.waiting is not None
            self._stamps.append(frame.stamp_ns)
            self.waiting = frame

    def _in_order(self, stamp_ns: int) -> bool:
        if not self._stamps or stamp_ns > self._stamps[-1]:
            return True
        if self._stamps[-1] - stamp_ns <= _JUMP_NS:
            return False
        self.counts["time_jumps"] += 1
        self._stamps.clear()
        return True

    def clear(self) -> None:
        """Let go of the waiting frame."""
        self.waiting = None

    @property
    def rate_hz(self) -> float:
        """Frames a second over the last ten, by their stamps; nan with less than two."""
        if len(self._stamps) < 2:
            return float("nan")
        return (len(self._stamps) - 1) * 1e9 / (self._stamps[-1] - self._stamps[0])


def _is_picture(pixels: Pixels) -> bool:
    right = pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 3)
    return right and pixels.dtype == np.uint8 and pixels.size > 0
