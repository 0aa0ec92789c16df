"""Find lines in the spectrum of an IMU: rotors, motors, fans, mains, or other vibration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.allan.record import ImuRecord, filled
from tirgeo_ros.core.types.arrays import Array, BoolArray

_SIZE = 2048  # samples of a window at rest
_PRESENT = 0.99  # share of a window's samples that must be present
_AROUND = 65  # bins whose median is the floor of the middle one
_FIRST_BIN = 8  # below it flicker noise rises too steeply for a floor
_OVER_FLOOR = 2.0
_SIGMAS = 8.0  # noise alone reaches 5 in 12000 bins
_MOST = 5


class SpectralLine(NamedTuple):
    """Hold a vibration of one channel: the sine with the power of all the excess in one place."""

    channel: int
    frequency_hz: float
    amplitude: float  # in the unit of the channel


def excess_lines(channel: int, hz: Array, excess: Array, out: BoolArray) -> list[SpectralLine]:
    """Return a line for each range of frequencies ``out`` (f,), the strongest first.

    ``excess`` (f,) is the one-sided power density above the floor, unit^2/Hz.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], out, [False]]).astype(int)))
    power = np.maximum(excess, 0.0) * (hz[1] - hz[0])
    found = [
        SpectralLine(
            channel,
            float(hz[begin:end] @ power[begin:end] / power[begin:end].sum()),
            float(np.sqrt(2 * power[begin:end].sum())),
        )
        for begin, end in edges.reshape(-1, 2).tolist()
        if begin or power[begin] < power[begin:end].max()  # else it is a remainder of motion
    ]
    return sorted(found, key=lambda line: -line.amplitude)


def lines_at_rest(record: ImuRecord) -> list[SpectralLine]:
    """Return the strongest lines of each channel of a record at rest, at most five, by frequency.

    The spectrum is that of Welch's method, with Hann windows that do not overlap.
    """
    from scipy import ndimage, signal  # noqa: PLC0415  slow to import

    power, number = np.zeros((_SIZE // 2 + 1, 6)), 0
    for _, block in record.blocks(_SIZE, _PRESENT):
        hz, own = signal.periodogram(filled(block), 1 / record.step_s, "hann", axis=0)
        power, number = power + own, number + 1
    if not number:
        return []
    floor = ndimage.median_filter(power, (_AROUND, 1), mode="mirror")
    out = power > floor * max(_OVER_FLOOR, 1 + _SIGMAS / np.sqrt(number))
    inside = slice(_FIRST_BIN, -1)
    found: list[SpectralLine] = []
    for channel in range(power.shape[1]):
        excess = (power - floor)[inside, channel] / number
        lines = excess_lines(channel, hz[inside], excess, out[inside, channel])[:_MOST]
        found += sorted(lines, key=lambda line: line.frequency_hz)
    return found
