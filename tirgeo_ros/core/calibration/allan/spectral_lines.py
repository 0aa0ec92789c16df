"""Find lines in the spectrum of an IMU at rest: motors, fans, mains, or other vibration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.allan.sample_blocks import SampleBlocks
from tirgeo_ros.core.calibration.allan.sample_grid import Piece
from tirgeo_ros.core.types.arrays import Array

_SIZE = 2048  # samples of a window
_PRESENT = 0.99  # share of a block's samples that must be present
_AROUND = 32  # bins on either side from which the floor below a line is taken
_FIRST_BIN = 8  # below it flicker noise rises too steeply for a floor
_WIDTH = 2  # bins over which the Hann window spreads a line
_OVER_FLOOR = 2.0
_SIGMAS = 8.0  # noise alone reaches 5 in 12000 bins
_MOST = 5


class SpectralLine(NamedTuple):
    """Hold a vibration of one channel."""

    channel: int
    frequency_hz: float
    amplitude: float  # in the unit of the channel


class SpectrumStream:
    """Accumulate a record's power spectrum by Welch's method: Hann windows, without overlap."""

    def __init__(self, step_ns: float) -> None:
        self._blocks = SampleBlocks(_SIZE, step_ns)
        self._step_s = step_ns * 1e-9
        self._window = np.hanning(_SIZE + 1)[:-1, None]
        self._power: Array = np.zeros((_SIZE // 2 + 1, 0))
        self._number = 0

    def add(self, piece: Piece) -> None:
        """Add consecutive slots; skip a block with more than a hundredth of samples missing."""
        for _, sums, counts in self._blocks.add(piece):
            there = counts > 0
            if there.mean() < _PRESENT:
                continue
            values = sums / np.maximum(counts, 1)[:, None]
            values = np.where(there[:, None], values - values[there].mean(axis=0), 0.0)
            spectrum = np.fft.rfft(values * self._window, axis=0)
            power = spectrum.real**2 + spectrum.imag**2
            self._power = self._power + power if self._number else power
            self._number += 1

    def lines(self) -> list[SpectralLine]:
        """Return the strongest lines of each channel, at most five, by frequency."""
        found: list[SpectralLine] = []
        for channel in range(self._power.shape[1]):
            found += sorted(self._of(channel)[:_MOST], key=lambda line: line.frequency_hz)
        return found

    def _of(self, channel: int) -> list[SpectralLine]:
        """Return the lines of a channel, the strongest first."""
        power = self._power[:, channel] / self._number
        padded = np.pad(power, _AROUND, mode="reflect")
        around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)
        floor = np.median(around, axis=1)
        limit = floor * max(_OVER_FLOOR, 1 + _SIGMAS / np.sqrt(self._number))
        inside = slice(_FIRST_BIN, len(power) - _WIDTH)
        excess = power - floor
        peaks = [
            k
            for k in (np.flatnonzero(power[inside] > limit[inside]) + _FIRST_BIN).tolist()
            if power[k] == power[k - _WIDTH : k + _WIDTH + 1].max()
        ]
        found = [self._line(channel, k, excess) for k in peaks]
        return sorted(found, key=lambda line: -line.amplitude)

    def _line(self, channel: int, k: int, excess: Array) -> SpectralLine:
        """Return a line with the amplitude of the sine of a peak's power (Parseval, windowed)."""
        power = excess[k - _WIDTH : k + _WIDTH + 1].clip(0).sum()
        scale = _SIZE * float((self._window**2).sum())
        frequency = k / (_SIZE * self._step_s)
        return SpectralLine(channel, frequency, float(2 * np.sqrt(power / scale)))
