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
"""Correct for stamps of the IMU that are late by a delay which the filter estimates.

With the delay ``d``, the state that the readings give at a stamp ``t`` is that of ``t - d``. What
is measured or published at ``t`` is the state moved on by ``d``, to first order. So a measurement
with the matrix ``H`` of the state has ``H m`` in the column of the delay, ``m`` being the state's
rates of change: headings show it in turns, velocities and positions where the velocity changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.frames.wgs84 import gravity_down
from tirgeo_ros.core.navigation.ins.error_states import DELAY, feedback
from tirgeo_ros.core.navigation.ins.propagation import Epoch
from tirgeo_ros.core.navigation.ins.strapdown import NavState, rotate
from tirgeo_ros.core.types.arrays import Array, Vector

#: Probability, before a flight tells, that the stamps are on time. With 0.5 an aircraft on time
#: loses 0.3 deg of tilt by an unknown delay; with 0.7 one that is 5 ms late is corrected later.
_ON_TIME = 0.6
#: A variance that is this share of the prior's is rounding: the delay is known.
_KNOWN = 1e-8
#: A delay beyond so many of its prior sigmas is not the IMU's: receivers have delays, too.
LONGEST_SIGMAS = 3.0


def mean_readings(epochs: Sequence[Epoch]) -> tuple[Vector, Vector]:
    """Return the mean force (m/s2) and the angular acceleration (rad/s2) in ``b``.

    Over one interval vibration would pass for motion, and so for knowledge of the delay.
    """
    first, last, number = epochs[0], epochs[-1], len(epochs)
    step_s = (last.stamp_ns - first.stamp_ns) * 1e-9
    (p, q, r), (u, v, w) = first.rate_b, last.rate_b
    x, y, z = (sum(axis) / number for axis in zip(*[e.force_b for e in epochs], strict=True))
    return (x, y, z), ((u - p) / step_s, (v - q) / step_s, (w - r) / step_s)


def motion_of(
    state: NavState, force_b: Vector, rate_b: Vector, turning_b: Vector = (0.0, 0.0, 0.0)
) -> Array:
    """Return how fast the first twelve error states (12,) change as the aircraft moves.

    They are attitude, velocity and position in ``n``, and the gyroscopes' bias in ``b``, since an
    angular acceleration ``turning_b`` (rad/s2) shifts the rate as a bias of the other sign does.
    ``force_b`` (m/s2) and ``rate_b`` (rad/s) are as read. The turn of the ``n`` axes is left out.
    """
    rotation, (gx, gy, gz) = rotation_of(state.q_nb), state.gyro_bias_b
    ax, ay, az = state.accel_bias_b
    turn = rotate(rotation, (rate_b[0] - gx, rate_b[1] - gy, rate_b[2] - gz))
    north, east, down = rotate(rotation, (force_b[0] - ax, force_b[1] - ay, force_b[2] - az))
    down += gravity_down(state.latitude_rad, state.height_m)
    x, y, z = turning_b
    return np.array((*turn, north, east, down, *state.velocity_n, -x, -y, -z))


def later(state: NavState, motion: Array, delay_s: float) -> NavState:
    """Return a state moved on by a delay; its sums of corrections stay."""
    change = np.zeros(15)
    np.multiply(motion, delay_s, out=change[: len(motion)])
    moved = feedback(state, change)
    return moved._replace(correction_n=state.correction_n, push_n=state.push_n)


def at_stamp(
    covariance: Array, motion: Array, delay_s: float, prior_s: float
) -> tuple[Array, Array]:
    """Return the error (n,) of the state at a stamp, and its covariance (n, n) once corrected.

    The filter takes the delay as unknown by ``prior_s``. But most aircraft have none, and their
    poses would suffer from the noise of its estimate. So there are two hypotheses: the filter's
    estimate, and the same under the condition that the delay is zero. A flight changes their odds
    by the delay's probability density at zero, after the flight over before it (Dickey, J. M.,
    1971, The weighted likelihood ratio). Returned is their mean, moved on by the delay.
    """
    of_delay, variance = covariance[DELAY], covariance.item(DELAY, DELAY)
    weight = known = gain = 0.0
    if variance > _KNOWN * prior_s**2:
        square = delay_s**2 / variance
        odds = _ON_TIME / (1 - _ON_TIME) * prior_s / math.sqrt(variance) * math.exp(-0.5 * square)
        weight = odds / (1 + odds)
        gain = -weight * delay_s / variance
        # The mean has the covariance P - known c c^T, with the column c of the delay.
        known = weight / variance * (1 - (1 - weight) * square)
    rows = np.zeros((2, len(covariance)))  # motion, and the delay's column
    rows[0, : len(motion)], rows[1] = motion, of_delay
    error = rows.T.dot((delay_s * (1 - weight), gain))
    # Moving on by the motion m adds m u^T + u m^T, with u = left (c + variance m / 2).
    left = 1 - known * variance
    half = rows.T.dot(np.array(((0.5 * left * variance, left), (0.0, -0.5 * known))).dot(rows))
    return error, np.asarray(covariance + (half + half.T))
