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
"""Recognise an aircraft that stands still, and take the gyroscopes' biases there.

The readings of a rest scatter as the sensor's own noise: a hand, wind or a car moves slowly, a
running engine or a hover shakes. Velocities, the antennas' heading and the autopilot's attitude
must deny any motion. Rest counts from six seconds on: until then a turn of more than 0.5 deg/s,
which to gyroscopes looks like a bias, shows in attitude or heading.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tirgeo_ros.core.config import ImuNoiseConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat, wrapped
from tirgeo_ros.core.frames.wgs84 import EARTH_RATE_RAD_S
from tirgeo_ros.core.navigation.aiding.aid import (
    Aid,
    Aiding,
    AidMeasurement,
    Modelled,
    StateEstimate,
)
from tirgeo_ros.core.navigation.ins.error_states import GYRO_BIAS
from tirgeo_ros.core.navigation.ins.kalman import Measurement, chi_square_limit
from tirgeo_ros.core.navigation.ins.propagation import mean_powers
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    ImuSample,
    Rest,
    Source,
    VelocitySample,
)

_WINDOW_S, _BLOCK_S = 2.0, 0.1
_LEAST, _MOST = 3, 15  # windows of a rest that counts
_LARGEST_STEP_S = 0.035  # beyond, samples are lost
#: Means over blocks show motion up to 5 Hz. Their variance, over that of the configured white
#: noise, is 1 +- 0.19 (57 degrees of freedom). Above 5 Hz an IMU may have twice its noise.
_LARGEST_SCATTER, _LARGEST_POWER = 2.0, 4.0
_GATE_SIGMA = 5.0  # between a window and the earlier ones, and between rest and filter
_MOVES_M_S = 0.2  # and three sigmas of a velocity
#: Four sigma of a heading of two antennas; an autopilot's attitude errs less in half a minute.
_TURNS_RAD = math.radians(3.0)
#: A bias changes by 0.01 deg/s with a degree, and an IMU warms by a degree a minute or less.
_WARMING_RAD_S2 = 3e-6


class RestTest:
    """Take the IMU's samples in the order of their stamps, and whatever shows motion."""

    def __init__(self, noise: ImuNoiseConfig) -> None:
        walks = np.array([noise.angle_random_walk, noise.velocity_random_walk])
        self._powers = np.maximum(walks, 1e-9) ** 2
        self._window: list[ImuSample] = []
        self._means: deque[Array] = deque(maxlen=_MOST)  # rate, force (2, 3) of each window
        self._heading_rad: tuple[float, ...] = ()  # of the antennas, at the start and now
        self._first_q_nb: Array | None = None
        self._moved = False
        self._newest: Rest | None = None

    def watch(self, sample: Aiding) -> None:
        """Take a measurement that may show a motion."""
        if isinstance(sample, VelocitySample):
            least = _MOVES_M_S**2 + 9 * float(np.trace(sample.covariance_n))
            self._moved |= bool(sample.velocity_n @ sample.velocity_n > least)
        elif isinstance(sample, HeadingSample):
            first = self._heading_rad[0] if self._heading_rad else sample.heading_rad
            self._heading_rad = first, sample.heading_rad
            self._moved |= abs(wrapped(sample.heading_rad - first)) > _TURNS_RAD

    def add(self, sample: ImuSample) -> Rest | None:
        """Take the next sample; return the part of a rest that ends here and is not used yet."""
        window = self._window
        window.append(sample)
        if (sample.stamp_ns - window[0].stamp_ns) * 1e-9 < _WINDOW_S:
            return None
        self._window = [sample]
        means = self._still(window)
        if means is None or self._moved or self._turned(window) or not self._same(means):
            self._means.clear()
            self._moved, self._heading_rad = False, self._heading_rad[-1:]
            return None
        self._means.append(means)
        number, variance_b = len(self._means), self._powers[0] / _WINDOW_S
        if number < _LEAST:
            return None
        all_b = np.mean(self._means, axis=0)[0]
        self._newest = Rest(sample.stamp_ns, all_b, variance_b / number)
        return self._newest if number == _LEAST else Rest(sample.stamp_ns, means[0], variance_b)

    def known(self, now_ns: int) -> Rest | None:
        """Return the newest rest, up to half a minute of it, with a variance for its age."""
        if self._newest is None:
            return None
        aged = (_WARMING_RAD_S2 * (now_ns - self._newest.stamp_ns) * 1e-9) ** 2
        return replace(self._newest, stamp_ns=now_ns, variance_b=self._newest.variance_b + aged)

    def _still(self, window: Sequence[ImuSample]) -> Array | None:
        """Return the mean rate and force (2, 3) of a window; None if more than noise is in it."""
        steps_s = np.diff([s.stamp_ns for s in window]) * 1e-9
        rates, forces = [s.angular_rate_b for s in window], [s.specific_force_b for s in window]
        readings, size = np.array([rates, forces]), max(1, round(_BLOCK_S / steps_s.mean()))
        count = len(window) // size
        blocks = readings[:, : count * size].reshape(2, count, size, 3).mean(axis=2)
        slow = blocks.var(axis=1, ddof=1).sum(axis=1) * size * steps_s.mean()
        allowed = self._powers.sum(axis=1)
        if steps_s.max() > _LARGEST_STEP_S or np.any(slow > _LARGEST_SCATTER * allowed):
            return None
        fast = np.reshape(mean_powers(window), (2, 3)).sum(axis=1)
        return None if np.any(fast > _LARGEST_POWER * allowed) else readings.mean(axis=1)

    def _turned(self, window: Sequence[ImuSample]) -> bool:
        """Return whether the autopilot's attitude has turned since the first window."""
        if not self._means:
            self._first_q_nb = window[0].autopilot_q_nb
        first, now = self._first_q_nb, window[-1].autopilot_q_nb
        if first is None or now is None or not usable_attitude(first) or not usable_attitude(now):
            return False
        return 2 * math.acos(min(1.0, abs(float(first @ now)))) > _TURNS_RAD

    def _same(self, means: Array) -> bool:
        """Return whether a window's means (2, 3) are those of the earlier windows."""
        if not self._means:
            return True
        off = means - np.mean(self._means, axis=0)
        variances = self._powers / _WINDOW_S * (1 + 1 / len(self._means))
        return bool(np.all((off**2 / variances).sum(axis=1) < chi_square_limit(_GATE_SIGMA, 3)))


class RestAid(Aid):
    """Use the mean rate of a rest: the gyroscopes' biases and the earth's rate."""

    source = Source.REST
    look_at = "imu.angle_random_walk"
    unit = "rad/s"
    by_delay = False

    def measured(self, sample: Rest, estimate: StateEstimate, _rate_b: Vector) -> Modelled:
        """Return the measurement of the three biases; it never causes a reset."""
        state, design = estimate.state, np.zeros((3, self._states))
        earth_n = np.array([math.cos(state.latitude_rad), 0.0, -math.sin(state.latitude_rad)])
        earth_b = EARTH_RATE_RAD_S * earth_n @ matrix_from_quat(np.array(state.q_nb))
        innovation = sample.angular_rate_b - earth_b - state.gyro_bias_b
        design[:, GYRO_BIAS] = np.eye(3)
        measurement = Measurement(innovation, design, np.diag(sample.variance_b), _GATE_SIGMA)
        own = self.source, sample.stamp_ns, measurement, tuple(innovation.tolist())
        return AidMeasurement(*own, (0.0, 0.0, 0.0), 0.0), estimate
