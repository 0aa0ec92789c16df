"""Tone-map the thermal picture for display: 16 bits stretched to 8, local contrast, a palette.

A stretch computed anew for each frame flickers: a warm roof that comes into view darkens all else
at once. Here the stretch stays constant while it fits, and otherwise moves slowly.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.config.overlay_parameters import PALETTES, PictureConfig
from tirgeo_ros.core.types.arrays import Pixels, RawPixels
from tirgeo_ros.core.types.errors import ConfigError

#: Number of time constants in stretch_time_s: 95 % of a change is followed within it.
_CONSTANTS = 3.0
#: A stretch starts to move when an end is off by more than the first share of its span, and stops
#: when both ends are within the second.
_LEAVES, _ARRIVES = 0.05, 0.01
#: A smaller change of a span's logarithm is treated as none.
_PLAIN_GROWTH = 1e-3
#: A smaller span would show only the sensor's noise.
_LEAST_SPAN = 16.0
#: Frames further apart than this, s, do not belong to one continuous video.
_LONGEST_GAP_S = 1.0
_LARGEST = 0xFFFF
_SAMPLE = 2  # the stretch is computed from every second row and column, in a quarter of the time
_FEW = 1 << 14  # pictures of up to this many pixels are used whole
_TILES = (8, 8)
#: OpenCV's colour map of each palette; all but the rainbow's are never darker for hotter points.
_MAPS = {
    "iron": cv2.COLORMAP_INFERNO,
    "rainbow": cv2.COLORMAP_TURBO,
    "arctic": cv2.COLORMAP_CIVIDIS,
    "lava": cv2.COLORMAP_HOT,
}


class ToneMapper:
    """Convert raw thermal frames to BGR. Raises ConfigError for an unknown palette."""

    def __init__(self, config: PictureConfig, palette: str) -> None:
        self._stretch = Stretch(config.stretch_percent, config.stretch_time_s)
        self.configure(config, palette)

    def configure(self, config: PictureConfig, palette: str) -> None:
        """Take the parameters, also others in flight; raises ConfigError as above."""
        if palette not in PALETTES:
            raise ConfigError(f"palette: {palette!r} is not one of {', '.join(PALETTES)}")
        self._map = _MAPS.get(palette)
        self._inverted = palette == "black_hot"
        self._stretch.configure(config.stretch_percent, config.stretch_time_s)
        self._local = None
        if config.local_contrast > 0:
            self._local = cv2.createCLAHE(config.local_contrast, _TILES)

    def tone(self, raw: RawPixels, stamp_ns: int) -> Pixels:
        """Return a new picture (h, w, 3) BGR uint8.

        The input is (h, w) uint8 or uint16, or (h, w, 3) BGR uint8. A colour picture is copied
        unchanged: palette and local contrast are for temperatures.
        """
        if raw.ndim == 3:
            return np.array(raw, np.uint8)
        grey = self._stretch.to_bytes(raw, stamp_ns) if raw.dtype == np.uint16 else raw
        if self._local is not None and grey.min() < grey.max():  # CLAHE turns uniform white black
            grey = np.asarray(self._local.apply(grey), np.uint8)
        if self._map is not None:
            return np.asarray(cv2.applyColorMap(grey, self._map), np.uint8)
        grey = np.invert(grey) if self._inverted else grey
        return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)


class Stretch:
    """Track the range of values over which a 16-bit video is shown, without flicker.

    The wanted ends are the ``percent`` percentiles of a frame's pixels. The range stays while both
    are within 5 % of its span of the shown ends. Otherwise it approaches them with a time constant
    of ``time_s`` / 3, and in a frame after dt its span changes by no more than the factor
    exp(3 dt / ``time_s``). So a constant pixel of grey level g becomes darker by no more than
    3 g dt / ``time_s`` when something hot comes into view. Still, a span that grows or shrinks
    tenfold is followed within ``time_s``. A frame whose median is outside the shown range is
    another scene; so is a frame after a gap or with a stamp that went back. Then the range is set
    anew.
    """

    def __init__(self, percent: tuple[float, ...], time_s: float) -> None:
        self._ends: tuple[float, float] | None = None
        self._stamp_ns = 0
        self._moves = False
        self.configure(percent, time_s)

    def configure(self, percent: tuple[float, ...], time_s: float) -> None:
        """Take the parameters, also others in flight; the range goes on from where it is."""
        self._shares = np.array([min(percent), 50.0, max(percent)]) / 100
        self._time_s = time_s

    def to_bytes(self, raw: npt.NDArray[np.uint16], stamp_ns: int) -> Pixels:
        """Convert (h, w) values to 8 bits; a picture of one value becomes black."""
        low, middle, high = self._wanted(raw)
        self._ends = self._followed(low, middle, high, stamp_ns)
        self._stamp_ns = stamp_ns
        low, high = self._ends
        scale = 255.0 / (high - low)
        # The only OpenCV call that scales 16 bits to 8 and also clips below zero in one pass.
        return np.asarray(cv2.addWeighted(raw, scale, raw, 0.0, -low * scale, dtype=cv2.CV_8U))

    def _wanted(self, raw: npt.NDArray[np.uint16]) -> tuple[float, float, float]:
        """Return the percentiles; ignore dead and saturated pixels unless there are no others."""
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
        span = shown_high - shown_low
        off = max(abs(low - shown_low), abs(high - shown_high)) / span
        self._moves = off > (_ARRIVES if self._moves else _LEAVES)
        if not self._moves:
            return self._ends
        # Of the way to the wanted ends; growth is the logarithm of new over old span.
        growth, most = math.log((high - low) / span), _CONSTANTS * elapsed_s / self._time_s
        share = -math.expm1(-most)
        if abs(growth) >= _PLAIN_GROWTH:
            share = math.expm1(max(-most, min(most, share * growth))) / math.expm1(growth)
        return shown_low + share * (low - shown_low), shown_high + share * (high - shown_high)
