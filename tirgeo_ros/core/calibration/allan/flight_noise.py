"""Estimate an IMU's white noise in flight, from densities between the vibration lines.

Motion of the aircraft is below 8 Hz, vibration above. The power there, by Welch's method (1967:
Hann windows, overlapping by half), consists of lines on a floor. The median over frequency gives
the floor and is not changed by lines, also not by those of a walker's steps. A one-sided power
``S`` belongs to white noise of the density ``sqrt(S / 2)``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.allan.record import ImuRecord, filled
from tirgeo_ros.core.calibration.allan.spectral_lines import SpectralLine, excess_lines
from tirgeo_ros.core.types.arrays import Array, BoolArray

#: Frequency that separates motion, below, from vibration, above.
MOTION_HZ = 8.0
#: Length of a piece: the averaging time of the filter's own vibration meter.
PIECE_S = 3
_PRESENT = 0.98  # share of a piece's samples that must be present
_WINDOWS = 2 * PIECE_S - 1  # of a second each, overlapping by half
#: Degrees of freedom of the power at one frequency (Welch, for Hann windows).
DEGREES = 36 * _WINDOWS**2 / (19 * _WINDOWS - 1)
#: Median over mean of a chi-square variable of so many (Wilson and Hilferty 1931).
_MEDIAN_OF_MEAN = (1 - 2 / (9 * DEGREES)) ** 3
_STANDS_OUT = 4.0  # times the median power: does not happen by chance in 20 s of pieces
_MEAN_S = 1 / MOTION_HZ  # a moving mean over this time is motion, the rest is vibration
# Limits at rest with motors off, for any sensor on sale: change of the means of seconds, scatter
# within a second, and mean rate, which is then only bias (gyroscope rad/s, accelerometer m/s2).
_STILL_CHANGE = np.repeat([0.01, 0.1], 3)
_STILL_SCATTER = np.repeat([0.02, 0.5], 3)
_STILL_RATE = 0.1


class Pieces(NamedTuple):
    """Hold the measurements of a record's pieces; gyroscope x, y, z, accelerometer x, y, z."""

    starts_s: Array  # (n,) from the first sample
    at_rest: BoolArray  # (n,)
    floors: Array  # (n, 6) density between the lines, unit/sqrt(Hz)
    differences: Array  # (n, 6) density by second differences
    rms: Array  # (n, 6) rms of vibration, unit
    peaks: Array  # (n, 6)
    spectra: Array  # (n, f, 6) density at each frequency
    frequencies_hz: Array  # (f,)

    def where(self, these: BoolArray) -> Pieces:
        """Return the pieces selected by a mask (n,)."""
        columns: dict[str, Any] = {name: getattr(self, name)[these] for name in self._fields[:-1]}
        return Pieces(**columns, frequencies_hz=self.frequencies_hz)

    def above_motion(self) -> BoolArray:
        """Return (f,) which frequencies are used; the last one's band is only half as wide."""
        hz = self.frequencies_hz
        return np.asarray((hz > MOTION_HZ) & (hz < hz[-1]))

    def lines(self, channel: int) -> list[SpectralLine]:
        """Return what exceeds the mean spectrum's floor above motion, strongest first."""
        inside = self.above_motion()
        hz, power = self.frequencies_hz[inside], (self.spectra[:, inside, channel] ** 2).mean(0)
        floor = np.median(power)
        return excess_lines(channel, hz, 2 * (power - floor), power > _STANDS_OUT * floor)


def pieces_of(record: ImuRecord) -> Pieces:
    """Return the pieces that have enough of their samples."""
    from scipy import signal  # noqa: PLC0415  slow to import

    second = 2 * round(0.5 / record.step_s)
    blocks = [(s, filled(block)) for s, block in record.blocks(PIECE_S * second, _PRESENT)]
    if not blocks:
        empty, none = np.zeros((0, 6)), np.zeros(0)
        spectra = np.zeros((0, 0, 6))
        return Pieces(none, none.astype(bool), empty, empty, empty, empty, spectra, none)
    values = np.stack([block for _, block in blocks])  # (n, samples, 6)
    hz, power = signal.welch(values, 1 / record.step_s, nperseg=second, axis=1)
    used = (hz > MOTION_HZ) & (hz < hz[-1])
    floors = np.median(power[:, used], axis=1) / _MEDIAN_OF_MEAN
    differences = (np.diff(values, 2, axis=1) ** 2).mean(axis=1) * record.step_s / 6
    shaken = np.stack([_without_motion(v, round(_MEAN_S / record.step_s)) for v in values])
    return Pieces(
        np.array([start_s for start_s, _ in blocks]),
        np.array([_at_rest(v.reshape(PIECE_S, second, 6)) for v in values]),
        np.sqrt(floors / 2),
        np.sqrt(differences),
        np.sqrt((shaken**2).mean(axis=1)),
        np.abs(shaken).max(axis=1),
        np.sqrt(power / 2),
        hz,
    )


def _at_rest(seconds: Array) -> bool:
    """Return whether a piece (seconds, n, 6) is at rest with motors off."""
    means, scatters = seconds.mean(axis=1), seconds.std(axis=1)
    return bool(
        (np.ptp(means, axis=0) < _STILL_CHANGE).all()
        and (scatters < _STILL_SCATTER).all()
        and (np.abs(means[:, :3]) < _STILL_RATE).all()
    )


def _without_motion(values: Array, size: int) -> Array:
    """Subtract the moving mean over ``size`` samples; omit the ends, which have no mean."""
    size |= 1
    totals = np.cumsum(np.concatenate([np.zeros((1, values.shape[1])), values]), axis=0)
    means = (totals[size:] - totals[:-size]) / size
    return np.asarray(values[size // 2 : len(values) - size // 2] - means)
