"""Estimate an IMU's white noise in flight, from densities between the vibration lines.

Motion of the aircraft is below 8 Hz, vibration above. The power there, by Welch's method (1967:
Hann windows, overlapping by half), consists of lines on a floor. The median over frequency gives
the floor and is not changed by lines, also not by those of a walker's steps. A one-sided power
``S`` belongs to white noise of the density ``sqrt(S / 2)``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.allan.sample_blocks import SampleBlocks
from tirgeo_ros.core.calibration.allan.sample_grid import Piece
from tirgeo_ros.core.calibration.allan.spectral_lines import SpectralLine
from tirgeo_ros.core.types.arrays import Array, BoolArray

#: Frequency that separates motion, below, from vibration, above.
MOTION_HZ = 8.0
#: Length of a piece: the averaging time of the filter's own vibration meter.
PIECE_S = 3
_PRESENT = 0.98  # share of a piece's samples that must be present
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
        """Return what exceeds the mean spectrum's floor above motion, strongest first.

        The amplitude is that of the sine with the power of all the excess in one place.
        """
        inside = self.above_motion()
        hz, power = self.frequencies_hz[inside], (self.spectra[:, inside, channel] ** 2).mean(0)
        excess = 2 * (power - np.median(power)) * (hz[1] - hz[0])
        out = power > _STANDS_OUT * np.median(power)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], out, [False]]).astype(int)))
        found = [
            SpectralLine(
                channel,
                float(hz[begin:end] @ excess[begin:end] / excess[begin:end].sum()),
                float(np.sqrt(2 * excess[begin:end].sum())),
            )
            for begin, end in edges.reshape(-1, 2).tolist()
            if begin or power[begin] < power[begin:end].max()  # else it is a remainder of motion
        ]
        return sorted(found, key=lambda line: -line.amplitude)


class PieceStream:
    """Collect the pieces of a record."""

    def __init__(self, step_ns: float) -> None:
        self._step_s = step_ns * 1e-9
        self._second = 2 * round(0.5 / self._step_s)
        self._blocks = SampleBlocks(PIECE_S * self._second, step_ns)
        self._found: list[Pieces] = []
        self.skipped = 0  # pieces with too few samples

    def add(self, piece: Piece) -> None:
        """Add consecutive slots."""
        for start_s, sums, counts in self._blocks.add(piece):
            there = counts > 0
            if there.mean() < _PRESENT:
                self.skipped += 1
                continue
            self._found.append(self._piece(start_s, _filled(sums, counts, there)))

    def pieces(self) -> Pieces:
        """Return all complete pieces, or empty arrays."""
        if not self._found:
            empty = np.zeros((0, 6))
            none = np.zeros(0)
            spectra = np.zeros((0, 0, 6))
            return Pieces(none, none.astype(bool), empty, empty, empty, empty, spectra, none)
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(found, name) for found in self._found])
            for name in Pieces._fields[:-1]
        }
        return Pieces(**columns, frequencies_hz=self._found[0].frequencies_hz)

    def _piece(self, start_s: float, values: Array) -> Pieces:
        at_rest = _at_rest(values.reshape(PIECE_S, self._second, 6))
        hz, power, degrees = welch(values, self._second, self._step_s)
        floor = np.median(power[(hz > MOTION_HZ) & (hz < hz[-1])], axis=0) / median_of_mean(
            degrees
        )
        differences = np.diff(values, 2, axis=0)
        shaken = _without_motion(values, round(_MEAN_S / self._step_s))
        row = (
            np.array([start_s]),
            np.array([at_rest]),
            np.sqrt(floor / 2)[None],
            np.sqrt((differences**2).mean(axis=0) * self._step_s / 6)[None],
            np.sqrt((shaken**2).mean(axis=0))[None],
            np.abs(shaken).max(axis=0)[None],
            np.sqrt(power / 2)[None],
        )
        return Pieces(*row, hz)


def welch(values: Array, size: int, step_s: float) -> tuple[Array, Array, float]:
    """Return frequencies (f,), one-sided power (f, channels) per Hz, and degrees of freedom.

    Windows have ``size`` samples, with their means subtracted. The degrees of freedom are Welch's
    for Hann windows.
    """
    window = np.hanning(size + 1)[:-1, None]
    starts = range(0, len(values) - size + 1, size // 2)
    scale = 2 * step_s / float((window**2).sum())
    power = np.zeros((size // 2 + 1, values.shape[1]))
    for start in starts:
        part = values[start : start + size]
        spectrum = np.fft.rfft((part - part.mean(axis=0)) * window, axis=0)
        power += scale / len(starts) * (spectrum.real**2 + spectrum.imag**2)
    degrees = 36 * len(starts) ** 2 / (19 * len(starts) - 1)
    return np.arange(size // 2 + 1) / (size * step_s), power, degrees


def median_of_mean(degrees: float) -> float:
    """Return the median over the mean of a chi-square variable (Wilson and Hilferty 1931)."""
    return (1 - 2 / (9 * degrees)) ** 3


def _filled(sums: Array, counts: Array, there: BoolArray) -> Array:
    """Return samples (n, channels); missing ones are interpolated linearly."""
    values: Array = sums / np.maximum(counts, 1)[:, None]
    if there.all():
        return values
    places = np.arange(len(values))
    columns = [np.interp(places, places[there], column[there]) for column in values.T]
    return np.stack(columns, axis=1)


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
