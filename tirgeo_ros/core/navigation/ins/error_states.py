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
"""Define the error states of the filter, and their feedback into the state.

All states are truth minus estimate, vectors in ``n`` (biases in ``b``):

=====  =========================  =====
0-2    attitude ``phi_n``         rad
3-5    velocity                   m/s
6-8    position north, east, down m
9-11   gyroscope bias             rad/s
12-14  accelerometer bias         m/s2
15-17  error of the ordinary GPS  m
18     offset of the barometer    m
19-21  error of GPS velocities    m/s
22     delay of the IMU's stamps  s
23-25  RTK antenna position in b  m, only if it is not measured
=====  =========================  =====

Their dynamics are in ``propagation``.
"""

from __future__ import annotations

import math
from typing import cast

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import quat_multiply
from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.navigation.ins.strapdown import NavState, normalised, quaternion_of
from tirgeo_ros.core.types.arrays import Array

STATES = 15  # states of the INS itself, without the receivers'
ATTITUDE = slice(0, 3)
VELOCITY = slice(3, 6)
POSITION = slice(6, 9)
GYRO_BIAS = slice(9, 12)
ACCEL_BIAS = slice(12, 15)
GPS_ERROR = slice(15, 18)
BAROMETER_OFFSET = slice(18, 19)  # standard height less true height
GPS_VELOCITY_ERROR = slice(19, 22)
DELAY = 22
ANTENNA = slice(23, 26)


def states_of(config: EkfConfig) -> int:
    """Return the number of error states that the parameters ask for."""
    return ANTENNA.stop if config.aircraft.rtk_lever_sigma_b.any() else ANTENNA.start


def has_antenna(states: int) -> bool:
    """Return whether ``states`` error states include the RTK antenna's position."""
    return states >= ANTENNA.stop


def flat_memory(square: Array) -> memoryview[float]:
    """Return a matrix's memory, row by row: writing scalars there costs a tenth."""
    return cast("memoryview[float]", square.reshape(-1).data)


def feedback(state: NavState, error: Array) -> NavState:
    """Return the state corrected by an estimated error (n,), of which the first 15 are used.

    Position errors are converted from metres; the corrections of position and velocity are added
    to ``correction_n`` and ``push_n``.
    """
    e = error.tolist()
    meridian, transverse = radii_of_curvature(state.latitude_rad)
    north, east, down = e[6:9]
    latitude = state.latitude_rad + north / (meridian + state.height_m)
    cosine = math.cos(state.latitude_rad)
    longitude = state.longitude_rad + east / ((transverse + state.height_m) * cosine)
    if abs(longitude) > math.pi:
        longitude = math.remainder(longitude, 2 * math.pi)
    v, c, p = state.velocity_n, state.correction_n, state.push_n
    g, a = state.gyro_bias_b, state.accel_bias_b
    return NavState(
        q_nb=normalised(quat_multiply(quaternion_of(e[0], e[1], e[2]), state.q_nb)),
        velocity_n=(v[0] + e[3], v[1] + e[4], v[2] + e[5]),
        latitude_rad=latitude,
        longitude_rad=longitude,
        height_m=state.height_m - down,
        gyro_bias_b=(g[0] + e[9], g[1] + e[10], g[2] + e[11]),
        accel_bias_b=(a[0] + e[12], a[1] + e[13], a[2] + e[14]),
        correction_n=(c[0] + north, c[1] + east, c[2] + down),
        push_n=(p[0] + e[3], p[1] + e[4], p[2] + e[5]),
    )
