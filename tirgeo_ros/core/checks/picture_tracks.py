"""Track points of the scene from one picture to the next, a few times a second.

Pictures are reduced first: a shift of a quarter of a reduced pixel can still be measured. Points
that are fixed in the picture (a crosshair, dead pixels) are excluded when the scene moves.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels

_EVERY_NS = 400_000_000
#: Time between the two pictures of a pair: long enough to move, short enough to be tracked.
_SHORTEST_NS, _LONGEST_NS = 80_000_000, 350_000_000
_WIDTH = 360  # largest width of the reduced picture, px
_SMALLEST = 32  # least height and width of the reduced picture, px
_POINTS, _FEWEST = 14, 6
_QUALITY = 0.05
_WINDOW = (15, 15)
_LEVELS = 3
_COMES_BACK = 0.3  # largest error, reduced px, of a point tracked forth and back
_STANDS, _MOVES = 0.25, 1.5  # motion of a fixed point, and of a moving scene, reduced px
_LEAST_SPAN = 16.0  # of values in a 16-bit picture, as in tone mapping
_LEAST_CONTRAST = 2.0  # grey levels


class Tracks(NamedTuple):
    """Hold points in two pictures."""

    first_ns: int
    second_ns: int
    first: Array  # (N, 2) column, row in the whole picture
    second: Array  # (N, 2)


class PictureTracker:
    """Take frames, return tracks when a pair is complete; ``pairs`` counts them."""

    def __init__(self) -> None:
        self.pairs = 0
        self._first: tuple[int, RawPixels] | None = None  # stamp and reduced picture
        self._begun_ns: int | None = None

    def take(self, stamp_ns: int, pixels: RawPixels) -> Tracks | None:
        """Take a frame (h, w) uint8 or uint16, or (h, w, 3) uint8."""
        if not self.wants(stamp_ns):
            return None
        scale = -(-pixels.shape[1] // _WIDTH)
        small = _reduced(pixels, scale)
        first, self._first = self._first, None
        if first is not None and 0 < stamp_ns - first[0] <= _LONGEST_NS:
            return self._tracks(*first, stamp_ns, small, scale)
        self._first, self._begun_ns = (stamp_ns, small), stamp_ns
        return None

    def wants(self, stamp_ns: int) -> bool:
        """Return whether a frame with this stamp would be used."""
        if self._first is not None:
            apart_ns = stamp_ns - self._first[0]
            if 0 < apart_ns <= _LONGEST_NS:
                return apart_ns >= _SHORTEST_NS
        return self._begun_ns is None or not 0 <= stamp_ns - self._begun_ns < _EVERY_NS

    def _tracks(
        self, first_ns: int, first: RawPixels, second_ns: int, second: RawPixels, scale: int
    ) -> Tracks | None:
        alike = (first.shape, first.dtype) == (second.shape, second.dtype)
        if not alike or min(first.shape) < _SMALLEST:
            return None
        before, after = _grey(first, second)
        if before.std() < _LEAST_CONTRAST:
            return None
        self.pairs += 1
        found = _followed(before, after)
        if found is None:
            return None
        middle = 0.5 * (scale - 1)  # offset of a reduced pixel's centre in the whole picture
        start, end = (points * scale + middle for points in found)
        return Tracks(first_ns, second_ns, start, end)


def _reduced(pixels: RawPixels, scale: int) -> RawPixels:
    """Reduce a frame to a small one; each of its pixels averages ``scale`` squared."""
    if pixels.ndim == 3:
        pixels = pixels[..., 1]
    size = (max(pixels.shape[1] // scale, 1), max(pixels.shape[0] // scale, 1))
    part = pixels[: size[1] * scale, : size[0] * scale]
    return np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA))


def _grey(first: RawPixels, second: RawPixels) -> tuple[Pixels, Pixels]:
    """Return a pair of pictures in 8 bits; the range of the first, of 16, serves both."""
    if first.dtype != np.uint16:
        return first, second
    low, high = np.percentile(first, (1.0, 99.0))
    factor = 255.0 / max(high - low, _LEAST_SPAN)
    eight = (np.stack((first, second)) - low) * factor
    before, after = np.clip(eight, 0, 255).astype(np.uint8)
    return before, after


def _followed(first: Pixels, second: Pixels) -> tuple[Array, Array] | None:
    """Return points (N, 2) in both reduced pictures; None if too few can be tracked."""

    def moved(start: Pixels, end: Pixels, points: Any) -> tuple[Any, Any]:
        there, found, _ = cv2.calcOpticalFlowPyrLK(
            start, end, points, np.empty(0), winSize=_WINDOW, maxLevel=_LEVELS
        )
        return there, found

    points = cv2.goodFeaturesToTrack(first, _POINTS, _QUALITY, max(first.shape) / 9)
    if points is None or len(points) < _FEWEST:
        return None
    there, found = moved(first, second, points)
    back, again = moved(second, first, there)
    good = (found & again)[:, 0] > 0
    good &= np.abs(back - points).max(axis=(1, 2)) < _COMES_BACK
    way = np.linalg.norm(there - points, axis=(1, 2))
    if good.any() and np.median(way[good]) > _MOVES:
        good &= way > _STANDS
    if good.sum() < _FEWEST:
        return None
    return points[good, 0].astype(float), there[good, 0].astype(float)
