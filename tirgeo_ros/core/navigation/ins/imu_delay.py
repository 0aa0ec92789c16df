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

from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.frames.wgs84 import gravity_down
from tirgeo_ros.core.navigation.ins.error_states import DELAY, feedback
from tirgeo_ros.core.navigation.ins.propagation import Epoch
from tirgeo_ros.core.navigation.ins.strapdown import NavState, rotate
from tirgeo_ros.core.types.arrays import Array, Vector


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
    """Return the rates of change (12,) of attitude, velocity, position in ``n`` and rate in ``b``.

    ``force_b`` (m/s2) and ``rate_b`` (rad/s) are as read, ``turning_b`` is the angular
    acceleration (rad/s2), which is a change of the gyroscopes' bias, negated: the last three.
    The turn of the ``n`` axes is left out.
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


def later_covariance(covariance: Array, motion: Array) -> Array:
    """Return the covariance (n, n) of a state that was moved on by the delay."""
    delay, rates = covariance[DELAY], np.zeros(len(covariance))
    rates[: len(motion)] = motion
    half = np.outer(rates, delay + (0.5 * delay[DELAY]) * rates)
    return np.asarray(covariance + (half + half.T))
