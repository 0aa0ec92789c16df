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
"""Define smooth and random functions of time for the simulated flight and its errors.

Every process draws from its own generator, seeded by its name, so that a change of one sensor does
not change the noise of the others.
"""

from __future__ import annotations

import math
import zlib

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline
from scipy.signal import lfilter

from tirgeo_ros.core.types.arrays import Array

DEGREE = 7  # six continuous derivatives, so that jerk and its derivative are smooth


def generator(seed: int, name: str) -> np.random.Generator:
    """Return the random generator of one named process of a flight."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


class Spline:
    """Evaluate a uniform B-spline of degree 7 that smooths its control points.

    Before its first and after its last control point it is constant.
    """

    def __init__(self, points: Array, spacing_s: float) -> None:
        """Take control points (N, k) at times 0, spacing_s, 2 spacing_s, ..."""
        self.points, self.spacing_s = np.asarray(points, float), spacing_s
        padded = np.pad(self.points, ((DEGREE, DEGREE), (0, 0)), "edge")
        # A basis function has its middle (DEGREE + 1) / 2 knots after its first one.
        knots = np.arange(len(padded) + DEGREE + 1.0) - DEGREE - (DEGREE + 1) / 2
        self._spline = BSpline(knots * spacing_s, padded, DEGREE)
        # Outside this range the function is constant, so clipping there changes nothing.
        self._range_s = knots[DEGREE] * spacing_s, knots[-DEGREE - 1] * spacing_s

    def __call__(self, t_s: npt.ArrayLike, derivative: int = 0) -> Array:
        """Return the values (..., k) of a derivative at the times ``t_s`` (...)."""
        times = np.clip(np.asarray(t_s, float), *self._range_s)
        return np.asarray(self._spline(times, derivative))


def gauss_markov(
    rng: np.random.Generator,
    count: int,
    step_s: float,
    time_s: npt.ArrayLike,
    std: npt.ArrayLike,
) -> Array:
    """Return (count, k) samples of k stationary first-order Gauss-Markov processes.

    ``time_s`` (k,) are correlation times and ``std`` (k,) standard deviations. The samples are the
    exact discrete form for a driving noise of ``std * sqrt(2 / time_s)``.
    """
    decay: Array = np.exp(-step_s / np.asarray(time_s, float))
    shocks: Array = rng.standard_normal((count, len(decay))) * np.asarray(std, float)
    shocks[1:] *= np.sqrt(1 - decay**2)
    columns = [lfilter([1.0], [1.0, -d], x) for d, x in zip(decay, shocks.T, strict=True)]
    return np.stack(columns, axis=-1)


def smooth_noise(
    rng: np.random.Generator, duration_s: float, time_s: float, std: npt.ArrayLike
) -> Spline:
    """Return k smoothed Gauss-Markov processes, ``std`` (k,), of one correlation time."""
    sigmas, spacing_s = np.asarray(std, float), time_s / 6
    count = math.ceil(duration_s / spacing_s) + 2
    points = gauss_markov(rng, count, spacing_s, np.full(len(sigmas), time_s), sigmas)
    return Spline(points, spacing_s)


def scaled_noise(
    rng: np.random.Generator, duration_s: float, time_s: float, rms: npt.ArrayLike
) -> Spline:
    """Return ``smooth_noise`` scaled to an rms of ``rms`` (k,) over 0 to ``duration_s``."""
    wanted = np.atleast_1d(np.asarray(rms, float))
    noise = smooth_noise(rng, duration_s, time_s, np.ones(len(wanted)))
    values = noise(np.arange(0.0, duration_s, min(0.05, duration_s / 100)))
    return Spline(noise.points * wanted / np.sqrt(np.mean(values**2, axis=0)), noise.spacing_s)
