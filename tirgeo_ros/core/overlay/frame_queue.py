"""Queue the video frames that wait to be drawn; newer frames replace older ones, with counts."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.types.arrays import RawPixels

#: A stamp that goes back by more than this means that a clock was set, not a late frame.
_JUMP_NS = 1_000_000_000
_RATE_FRAMES = 10
#: One second of video: longer than any sensible wait for a pose.
_MOST_WAITING = 30
_LARGEST_PX = 65_500  # libjpeg's JPEG_MAX_DIMENSION
_SHAPES = {np.dtype(np.uint8): (2, 3), np.dtype(np.uint16): (2,)}  # dimensions by pixel type


@dataclass(frozen=True, slots=True)
class Frame:
    """Hold a picture of the video."""

    stamp_ns: int
    pixels: RawPixels  # (h, w) of 8 or 16 bits, or (h, w, 3) BGR
    arrival_ns: int  # on the caller's clock


class FrameQueue:
    """Hold the newest frames, each until it or a newer one is taken.

    ``counts``: ``replaced`` frames were dropped for a newer one; ``out_of_order`` frames were not
    newer than the previous one; ``time_jumps`` are stamps that went back by more than a second
    (the video continues after them); ``invalid`` frames are not pictures of 8 or 16 bits;
    ``too_large`` frames have a side longer than JPEG allows.
    """

    def __init__(self) -> None:
        self.counts = {"replaced": 0, "out_of_order": 0, "time_jumps": 0}
        self.counts |= {"invalid": 0, "too_large": 0}
        self._frames: deque[Frame] = deque()
        self._stamps: deque[int] = deque(maxlen=_RATE_FRAMES)

    def __len__(self) -> int:
        """Return the number of waiting frames."""
        return len(self._frames)

    def __iter__(self) -> Iterator[Frame]:
        """Iterate over the waiting frames, the newest first."""
        return reversed(self._frames)

    def put(self, frame: Frame) -> None:
        """Add a frame, or count why it is refused."""
        pixels = frame.pixels
        known = pixels.ndim in _SHAPES.get(pixels.dtype, ()) and pixels.size > 0
        if not known or (pixels.ndim == 3 and pixels.shape[2] != 3):
            self.counts["invalid"] += 1
        elif max(pixels.shape) > _LARGEST_PX:
            self.counts["too_large"] += 1
        elif not self._in_order(frame.stamp_ns):
            self.counts["out_of_order"] += 1
        else:
            self._stamps.append(frame.stamp_ns)
            self._frames.append(frame)
            self._replace(len(self._frames) - _MOST_WAITING)

    def _in_order(self, stamp_ns: int) -> bool:
        if not self._stamps or stamp_ns > self._stamps[-1]:
            return True
        if self._stamps[-1] - stamp_ns <= _JUMP_NS:
            return False
        self.counts["time_jumps"] += 1
        self._stamps.clear()
        self._replace(len(self._frames))
        return True

    def take(self, frame: Frame) -> None:
        """Remove a frame, and all older ones, which count as replaced."""
        place = next(i for i, each in enumerate(self._frames) if each is frame)
        self._replace(place)
        self._frames.popleft()

    def _replace(self, number: int) -> None:
        """Remove the oldest frames and count them as replaced."""
        for _ in range(number):
            self._frames.popleft()
            self.counts["replaced"] += 1

    @property
    def rate_hz(self) -> float:
        """Return the frame rate, Hz, over the last ten stamps; nan with fewer than two."""
        if len(self._stamps) < 2:
            return float("nan")
        return (len(self._stamps) - 1) * 1e9 / (self._stamps[-1] - self._stamps[0])
