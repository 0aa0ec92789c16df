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
"""Noise of known N, B and K, for tests of what tells them from a record."""

from __future__ import annotations

import numpy as np

from dev.static_imu import write_imu
from tirgeo_ros.core.calibration.imu_record import ImuRecord
from tirgeo_ros.io.bags.bag import BagWriter


def white(rng, size, n, step_s):
    """Of random walk ``n``: each sample is an average over its step."""
    return n / np.sqrt(step_s) * rng.standard_normal(size)


def flicker(rng, size, b, step_s):
    """Of bias instability ``b``: white noise filtered to the one-sided density b^2 / (pi f).

    Made twice as long as needed, so that it does not close in a circle.
    """
    length = 1 << int(np.ceil(np.log2(2 * size)))
    frequencies = np.fft.rfftfreq(length, step_s)
    gains = np.zeros(len(frequencies))
    gains[1:] = b / np.sqrt(2 * np.pi * frequencies[1:] * step_s)
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(length)) * gains, length)[:size]


def walk(rng, size, k, step_s):
    """Of rate random walk ``k``."""
    return k * np.sqrt(step_s) * np.cumsum(rng.standard_normal(size))


def gauss_markov(rng, size, sigma, time_s, step_s):
    """A first-order Gauss-Markov process, stationary from its beginning."""
    decay = np.exp(-step_s / time_s)
    values = sigma * np.sqrt(1 - decay**2) * rng.standard_normal(size)
    values[0] = sigma * rng.standard_normal()
    for k in range(1, size):
        values[k] += decay * values[k - 1]
    return values


def noise(rng, size, n, b, k, step_s):
    """The three together."""
    return white(rng, size, n, step_s) + flicker(rng, size, b, step_s) + walk(rng, size, k, step_s)


def record(values, step_s, lost=None):
    """A record (n, channels) on its grid, without the samples in ``lost`` (n, bool)."""
    values = values.copy()
    if lost is not None:
        values[lost] = np.nan
    return ImuRecord([values], [0.0], step_s, 0.0, len(values), {})


FLIGHT_HZ = 200
START_NS = 1_700_000_000_000_000_000
#: Of a flight: rad/sqrt(s), m/s/sqrt(s).
FLIGHT_DENSITY = np.array([3e-3, 5e-3, 1.5e-3, 0.11, 0.07, 0.4])


def flown(seed=1, duration_s=90, density=FLIGHT_DENSITY):
    """(n, 6) rates and forces FLU of a flight: turns and jolts of some hertz, known noise."""
    t_s = np.arange(duration_s * FLIGHT_HZ) / FLIGHT_HZ
    turns = np.sin(2 * np.pi * np.outer(t_s, [0.3, 0.4, 0.2, 0.7, 1.1, 2.3]))
    values = white(np.random.default_rng(seed), (len(t_s), 6), density, 1 / FLIGHT_HZ)
    return values + turns * [0.8, 0.6, 0.3, 3.0, 2.0, 4.0] + [0, 0, 0, 0, 0, 9.8]


def imu_bag(path, values, rate_hz=FLIGHT_HZ, stamps_ns=None):
    """A bag of rates and forces (n, 6) FLU, at even stamps if none are given."""
    steps = np.arange(len(values), dtype=np.int64) * (1_000_000_000 // rate_hz)
    with BagWriter(path) as bag:
        write_imu(bag, START_NS + steps if stamps_ns is None else stamps_ns, values)
    return path
