"""The thermal picture as a person sees it: 16 bits stretched to 8, local contrast, a palette.

A stretch that is found anew for each frame flickers: a warm roof that comes into view darkens all
else at once. Here it stays as long as it fits, and when it no longer does it moves slowly.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.config.pictures import PictureConfig
from tirgeo_ros.core.overlay.palettes import palette_table
from tirgeo_ros.core.types.arrays import Pixels, RawPixels

#: Time constants that go into stretch_time_s: 95 % of a change are followed within it.
_CONSTANTS = 3.0
#: A stretch begins to move when an end is off by this share of its span, and then comes this near.
_LEAVES, _ARRIVES = 0.05, 0.01
#: Logarithm of a span's change up to which it is as good as none.
_PLAIN_GROWTH = 1e-3
#: A span of fewer values would show the sensor's noise alone.
_LEAST_SPAN = 16.0
#: Frames that are further apart, s, are not one video.
_LONGEST_GAP_S = 1.0
_LARGEST = 0xFFFF
_SAMPLE = 2  # every second row and column tells the stretch, in a quarter of the time
_FEW = 1 << 14  # of smaller pictures every pixel
_TILES = (8, 8)


class Toner:
    """RawPixels thermal frames to BGR. Raises ConfigError for a palette that is not known."""

    def __init__(self, config: PictureConfig, palette: str) -> None:
        self._table = None if palette == "white_hot" else palette_table(palette)
        self._stretch = Stretch(config.stretch_percent, config.stretch_time_s)
        self._local = None
        if config.local_contrast > 0:
            self._local = cv2.createCLAHE(config.local_contrast, _TILES)

    def tone(self, raw: RawPixels, stamp_ns: int) -> Pixels:
        """A new picture (h, w, 3) BGR uint8 of one (h, w) uint8 or uint16, or (h, w, 3) BGR uint8.

        What comes in colour stays as it is: palette and local contrast are for temperatures.
        """
        if raw.ndim == 3:
            return np.array(raw, np.uint8)
        grey = self._stretch.to_bytes(raw, stamp_ns) if raw.dtype == np.uint16 else raw
        if self._local is not None and grey.min() < grey.max():  # else it makes black of it white
            grey = np.asarray(self._local.apply(grey), np.uint8)
        if self._table is None:
            return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)
        return np.asarray(cv2.applyColorMap(grey, self._table), np.uint8)


class Stretch:
    """Between which values a 16-bit video is shown, following the scene without flicker.

    The wanted ends are ``percent`` of a frame's pixels in order. The stretch stays while both
    are within 5 % of its span of the shown ones. Else it approaches them with a time constant of
    ``time_s`` / 3, and its span, in a frame after dt, changes by no more than the factor
    exp(3 dt / ``time_s``). So a pixel of grey level g that does not change becomes darker by no
    more than 3 g dt / ``time_s`` when something hot comes in, and yet a span that grows or
    shrinks tenfold is followed within ``time_s``. A frame of which one half lies beyond one end
    is another scene, as one is after a gap or with a stamp that went back: there the stretch
    begins anew.
    """

    def __init__(self, percent: tuple[float, ...], time_s: float) -> None:
        self._shares = np.array([min(percent), 50.0, max(percent)]) / 100
        self._time_s = time_s
        self._ends: tuple[float, float] | None = None
        self._stamp_ns = 0
        self._moves = False

    def to_bytes(self, raw: npt.NDArray[np.uint16], stamp_ns: int) -> Pixels:
        """(h, w) values to 8 bits; a picture of one value becomes black."""
        low, middle, high = self._wanted(raw)
        self._ends = self._followed(low, middle, high, stamp_ns)
        self._stamp_ns = stamp_ns
        return _scaled(raw, *self._ends)

    def _wanted(self, raw: npt.NDArray[np.uint16]) -> tuple[float, float, float]:
        """The values at the shares; dead and saturated pixels tell nothing where others do."""
        part = raw if raw.size <= _FEW else raw[::_SAMPLE, ::_SAMPLE]
        count = np.bincount(part.ravel(), minlength=_LARGEST + 1)
        if count[0] + count[_LARGEST] < part.size:
            count[0] = count[_LARGEST] = 0
        below = np.cumsum(count)
        low, middle, high = np.searchsorted(below, self._shares * below[-1]).tolist()
        return low, middle, max(high, low + _LEAST_SPAN)

    def _followed(
        self, low: float, middle: float, high: float, stamp_ns: int
    ) -> tuple[float, float]:
        elapsed_s = (stamp_ns - self._stamp_ns) * 1e-9
        if self._ends is None or not 0 <= elapsed_s <= max(_LONGEST_GAP_S, self._time_s):
            return low, high
        shown_low, shown_high = self._ends
        if not shown_low <= middle <= shown_high or not self._time_s:
            return low, high
        return self._moved(low, high, elapsed_s)

    def _moved(self, low: float, high: float, elapsed_s: float) -> tuple[float, float]:
        assert self._ends is not None
        shown_low, shown_high = self._ends
        span = shown_high - shown_low
        off = max(abs(low - shown_low), abs(high - shown_high)) / span
        self._moves = off > (_ARRIVES if self._moves else _LEAVES)
        if not self._moves:
            return self._ends
        share = self._share(math.log((high - low) / span), elapsed_s)
        return shown_low + share * (low - shown_low), shown_high + share * (high - shown_high)

    def _share(self, growth: float, elapsed_s: float) -> float:
        """Of the way to the wanted ends; ``growth`` is the logarithm of how the span changes."""
        most = _CONSTANTS * elapsed_s / self._time_s
        plain = -math.expm1(-most)
        if abs(growth) < _PLAIN_GROWTH:
            return plain
        return math.expm1(max(-most, min(most, plain * growth))) / math.expm1(growth)


def _scaled(raw: npt.NDArray[np.uint16], low: float, high: float) -> Pixels:
    scale = 255.0 / (high - low)
    # The only call that scales 16 bits to 8 and cuts off below zero too, in one go.
    return np.asarray(cv2.addWeighted(raw, scale, raw, 0.0, -low * scale, dtype=cv2.CV_8U))
