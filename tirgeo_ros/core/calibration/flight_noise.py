# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Estimate an IMU's white noise under vibration, from densities between its spectral lines.

Motion of the aircraft is below 8 Hz, vibration above. The power there, by Welch's method (1967:
Hann windows, overlapping by half), consists of lines on a floor. The median over frequency gives
the floor; lines do not change it, not even those of a walker's steps. A one-sided power
``S`` belongs to white noise of the density ``sqrt(S / 2)``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.imu_record import ImuRecord
from tirgeo_ros.core.types.arrays import Array, BoolArray

#: Frequency that separates motion, below, from vibration, above.
MOTION_HZ = 8.0
#: Length of a piece: the averaging time of the filter's own vibration meter.
PIECE_S = 3
_PRESENT = 0.98  # share of a piece's samples that must be present
_WINDOWS = 2 * PIECE_S - 1  # of a second each, overlapping by half
#: Degrees of freedom of the power at one frequency (Welch, for Hann windows).
DEGREES = 36 * _WINDOWS**2 / (19 * _WINDOWS - 1)
#: Median over mean of a chi-square variable with DEGREES (Wilson and Hilferty 1931).
_MEDIAN_OF_MEAN = (1 - 2 / (9 * DEGREES)) ** 3
_STANDS_OUT = 4.0  # times the median power: does not happen by chance in 20 s of pieces
# Limits at rest with motors off, for any sensor on sale: change of the means of seconds, scatter
# within a second, and mean rate, which is then only bias (gyroscope rad/s, accelerometer m/s2).
_STILL_CHANGE = np.repeat([0.01, 0.1], 3)
_STILL_SCATTER = np.repeat([0.02, 0.5], 3)
_STILL_RATE = 0.1


class SpectralLine(NamedTuple):
    """Hold a vibration of one channel: a sine with the power of one peak above the floor."""

    frequency_hz: float
    amplitude: float  # in the unit of the channel


class Pieces(NamedTuple):
    """Hold the measurements of a record's pieces; gyroscope x, y, z, accelerometer x, y, z."""

    at_rest: BoolArray  # (n,)
    floors: Array  # (n, 6) density between the lines, unit/sqrt(Hz)
    differences: Array  # (n, 6) density by second differences
    spectra: Array  # (n, f, 6) density at each frequency
    frequencies_hz: Array  # (f,)

    def where(self, these: BoolArray) -> Pieces:
        """Return the pieces selected by a mask (n,)."""
        chosen: Any = [column[these] for column in self[:-1]]
        return Pieces._make([*chosen, self.frequencies_hz])

    def lines(self, channel: int) -> list[SpectralLine]:
        """Return the lines of the mean spectrum above motion, strongest first."""
        hz = self.frequencies_hz
        inside = (hz > MOTION_HZ) & (hz < hz[-1])  # the last one's band is half as wide
        hz, power = hz[inside], (self.spectra[:, inside, channel] ** 2).mean(0)
        floor = np.median(power)
        excess = 2 * np.maximum(power - floor, 0.0) * self.frequencies_hz[1]
        out = np.concatenate([[False], power > _STANDS_OUT * floor, [False]])
        edges = np.flatnonzero(np.diff(out.astype(int))).reshape(-1, 2).tolist()
        lines = [
            SpectralLine(
                float(hz[begin:end] @ excess[begin:end] / excess[begin:end].sum()),
                float(np.sqrt(2 * excess[begin:end].sum())),
            )
            for begin, end in edges
            if begin or excess[0] < excess[:end].max()  # else it is the upper end of motion
        ]
        return sorted(lines, key=lambda line: -line.amplitude)


def pieces_of(record: ImuRecord) -> Pieces:
    """Return the pieces with enough of their samples.

    There are none at less than 19 samples a second, which show nothing above motion.
    """
    from scipy import signal  # noqa: PLC0415  slow to import

    second = 2 * round(0.5 / record.step_s)
    blocks = [block for _, block in record.blocks(PIECE_S * second, _PRESENT)]
    if not blocks or second <= 2 * (MOTION_HZ + 1):  # no frequency above motion
        empty, spectra = np.zeros((0, 6)), np.zeros((0, 0, 6))
        return Pieces(np.zeros(0, bool), empty, empty, spectra, np.zeros(0))
    values = np.stack([_filled(block) for block in blocks])  # (n, samples, 6)
    hz, power = signal.welch(values, 1 / record.step_s, nperseg=second, axis=1)
    floors = np.median(power[:, (hz > MOTION_HZ) & (hz < hz[-1])], axis=1) / _MEDIAN_OF_MEAN
    differences = (np.diff(values, 2, axis=1) ** 2).mean(axis=1) * record.step_s / 6
    seconds = values.reshape(len(values), PIECE_S, second, 6)
    means, scatters = seconds.mean(axis=2), seconds.std(axis=2)  # (n, seconds, 6)
    at_rest = (
        (np.ptp(means, axis=1) < _STILL_CHANGE).all(axis=1)
        & (scatters < _STILL_SCATTER).all(axis=(1, 2))
        & (np.abs(means[:, :, :3]) < _STILL_RATE).all(axis=(1, 2))
    )
    return Pieces(at_rest, np.sqrt(floors / 2), np.sqrt(differences), np.sqrt(power / 2), hz)


def _filled(block: Array) -> Array:
    """Return samples (n, 6) with missing ones interpolated linearly."""
    present = np.isfinite(block[:, 0])
    if present.all():
        return block
    places = np.arange(len(block))
    return np.stack([np.interp(places, places[present], c[present]) for c in block.T], axis=1)
