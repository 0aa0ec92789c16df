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
"""States and readings of motions whose closed form is known."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.frames import rotations as att
from tirgeo_ros.core.frames.wgs84 import EARTH_RATE_RAD_S, gravity_down, radii_of_curvature
from tirgeo_ros.core.navigation.ins.strapdown import NavState

ZERO = (0.0, 0.0, 0.0)


def state_at(lat, lon, height, velocity_n=ZERO, euler=(0.0, 0.0, 0.0), **others):
    q = tuple(att.quat_from_euler(*euler).tolist())
    biases = {"gyro_bias_b": ZERO, "accel_bias_b": ZERO, "correction_n": ZERO, **others}
    return NavState(q, velocity_n, lat, lon, height, **biases)


def steady_readings(state):
    """Force and rate of a body that keeps its velocity and its attitude in ``n``.

    Groves 2.123 and 5.44 for the frame's rates, 5.54 solved for the force.
    """
    meridian, transverse = radii_of_curvature(state.latitude_rad)
    sine, cosine = math.sin(state.latitude_rad), math.cos(state.latitude_rad)
    v = np.array(state.velocity_n)
    earth = EARTH_RATE_RAD_S * np.array([cosine, 0, -sine])
    transport = np.array(
        [
            v[1] / (transverse + state.height_m),
            -v[0] / (meridian + state.height_m),
            -v[1] * sine / cosine / (transverse + state.height_m),
        ]
    )
    gravity = np.array([0, 0, gravity_down(state.latitude_rad, state.height_m)])
    r_bn = att.matrix_from_quat(np.array(state.q_nb)).T
    force = r_bn @ (np.cross(2 * earth + transport, v) - gravity)
    return tuple(force.tolist()), tuple((r_bn @ (earth + transport)).tolist())


def angle_between(p, q):
    difference = att.quat_multiply(att.quat_conjugate(np.array(p)), np.array(q))
    return float(np.linalg.norm(att.rotvec_from_quat(difference)))


def difference(truth: NavState, estimate: NavState) -> np.ndarray:
    """The 15 error states between two nominal states."""
    meridian, transverse = radii_of_curvature(estimate.latitude_rad)
    return np.concatenate(
        [
            att.rotvec_from_quat(att.quat_multiply(truth.q_nb, att.quat_conjugate(estimate.q_nb))),
            np.subtract(truth.velocity_n, estimate.velocity_n),
            [
                (truth.latitude_rad - estimate.latitude_rad) * (meridian + estimate.height_m),
                (truth.longitude_rad - estimate.longitude_rad)
                * (transverse + estimate.height_m)
                * math.cos(estimate.latitude_rad),
                estimate.height_m - truth.height_m,
            ],
            np.subtract(truth.gyro_bias_b, estimate.gyro_bias_b),
            np.subtract(truth.accel_bias_b, estimate.accel_bias_b),
        ]
    )
