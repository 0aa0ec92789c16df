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
"""Propagate the strapdown mechanisation: a nominal state and its step between two IMU samples.

Local-navigation-frame equations of Groves, 2nd ed., section 5.4, on the ellipsoid with earth and
transport rate. Scalar arithmetic costs a fraction of array calls at 3 x 3.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.frames.wgs84 import EARTH_RATE_RAD_S, earth_at
from tirgeo_ros.core.types.arrays import Array, Quaternion, Rotation, Vector

__all__ = ["NavState", "Quaternion", "Rates", "Rotation", "Vector"]
__all__ += ["cross", "matrix", "normalised", "propagate", "quaternion_of", "rotate"]


class NavState(NamedTuple):
    """Hold the nominal state: attitude, velocity, position of the IMU, and its biases."""

    q_nb: Quaternion
    velocity_n: Vector  # m/s
    latitude_rad: float
    longitude_rad: float
    height_m: float
    gyro_bias_b: Vector  # rad/s, subtracted from the reading
    accel_bias_b: Vector  # m/s2, subtracted from the reading
    correction_n: Vector = (0.0, 0.0, 0.0)  # m, sum of all position corrections so far
    push_n: Vector = (0.0, 0.0, 0.0)  # m/s, sum of all velocity corrections so far


class Rates(NamedTuple):
    """Hold what the error model needs of a state and of the step that starts from it."""

    rotation_nb: Rotation
    specific_force_n: Vector  # m/s2
    earth_rate_n: Vector  # rad/s, earth against inertial frame
    transport_rate_n: Vector  # rad/s, n against earth
    meridian_m: float  # radius of curvature plus height
    transverse_m: float
    gravity_m_s2: float  # down


def rotate(m: Rotation, v: Vector) -> Vector:
    """Return matrix times vector."""
    x, y, z = v
    return (
        m[0] * x + m[1] * y + m[2] * z,
        m[3] * x + m[4] * y + m[5] * z,
        m[6] * x + m[7] * y + m[8] * z,
    )


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product ``a x b``."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def quaternion_of(x: float, y: float, z: float) -> Quaternion:
    """Return the quaternion of a rotation vector (rad)."""
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 * angle
    # The series is exact to 1e-17 below 1e-3 rad: (1 - half^2/6 + ...) / 2.
    scale = math.sin(half) / angle if angle > 1e-3 else 0.5 - half * half / 12
    return (math.cos(half), scale * x, scale * y, scale * z)


def normalised(q: Quaternion) -> Quaternion:
    """Return the same rotation with unit norm."""
    w, x, y, z = q
    factor = 1 / math.sqrt(w * w + x * x + y * y + z * z)
    return (w * factor, x * factor, y * factor, z * factor)


def propagate(
    state: NavState, specific_force_b: Vector, angular_rate_b: Vector, step_s: float
) -> tuple[NavState, Rates]:
    """Return the state after a step with the mean readings over it, and the rates of the step.

    ``specific_force_b`` (m/s2) and ``angular_rate_b`` (rad/s) are as read, biases not yet
    subtracted.

    The arithmetic is written in scalars, in one piece: it runs at every IMU sample, and again for
    each when a measurement comes late; function calls would cost as much as the arithmetic.
    """
    (w, x, y, z), (north, east, down), latitude, longitude, height, *rest = state
    gyro, accel, moved, pushed = rest
    # Subtract the biases. The body turns during the step: take the force as seen at its middle.
    tx = (angular_rate_b[0] - gyro[0]) * step_s
    ty = (angular_rate_b[1] - gyro[1]) * step_s
    tz = (angular_rate_b[2] - gyro[2]) * step_s
    ax = specific_force_b[0] - accel[0]
    ay = specific_force_b[1] - accel[1]
    az = specific_force_b[2] - accel[2]
    fx = ax + 0.5 * (ty * az - tz * ay)
    fy = ay + 0.5 * (tz * ax - tx * az)
    fz = az + 0.5 * (tx * ay - ty * ax)
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    wx, wy, wz = w * x, w * y, w * z
    r0, r1, r2 = 1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)
    r3, r4, r5 = 2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)
    r6, r7, r8 = 2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)
    fn = r0 * fx + r1 * fy + r2 * fz
    fe = r3 * fx + r4 * fy + r5 * fz
    fd = r6 * fx + r7 * fy + r8 * fz
    # At this position: radii, gravity, earth rate and transport rate (Groves 2.105, 2.106, 2.123,
    # 2.134, 2.139, 5.44).
    sine, cosine, meridian, transverse, gravity = earth_at(latitude, height)
    earth_n, earth_d = EARTH_RATE_RAD_S * cosine, -EARTH_RATE_RAD_S * sine
    over_n = east / transverse
    over_e = -north / meridian
    over_d = -over_n * sine / cosine
    wn, wd = earth_n + over_n, earth_d + over_d
    # Velocity. The n axes turn during the step: take the force as seen at its middle.
    half = 0.5 * step_s
    mn, me, md = north + half * fn, east + half * fe, down + half * fd
    north_1 = north + (fn + earth_d * east - (over_e * md - wd * me)) * step_s
    east_1 = east + (fe - (earth_d * north - earth_n * down) - (wd * mn - wn * md)) * step_s
    down_1 = down + (fd - earth_n * east - (wn * me - over_e * mn) + gravity) * step_s
    # Position, with the mean velocity.
    latitude_1 = latitude + half * (north + north_1) / meridian
    cosine_1 = math.cos(0.5 * (latitude + latitude_1))
    longitude_1 = longitude + half * (east + east_1) / (transverse * cosine_1)
    if abs(longitude_1) > math.pi:
        longitude_1 = math.remainder(longitude_1, 2 * math.pi)
    # Attitude: the body's turn on the right, that of the n axes on the left. The latter is below
    # 1e-6 rad a step: half its rotation vector is its quaternion's vector part, to 1e-12.
    angle2 = tx * tx + ty * ty + tz * tz
    if angle2 < 1e-6:  # as quaternion_of
        qw, scale = 1 - angle2 / 8 + angle2 * angle2 / 384, 0.5 - angle2 / 48
    else:
        angle = math.sqrt(angle2)
        qw, scale = math.cos(0.5 * angle), math.sin(0.5 * angle) / angle
    qx, qy, qz = scale * tx, scale * ty, scale * tz
    n, e, d = -half * wn, -half * over_e, -half * wd
    w, x, y, z = (
        w - n * x - e * y - d * z,
        x + n * w + e * z - d * y,
        y - n * z + e * w + d * x,
        z + n * y - e * x + d * w,
    )
    aw = w * qw - x * qx - y * qy - z * qz
    bx = w * qx + x * qw + y * qz - z * qy
    cy = w * qy - x * qz + y * qw + z * qx
    dz = w * qz + x * qy - y * qx + z * qw
    unit = 1 / math.sqrt(aw * aw + bx * bx + cy * cy + dz * dz)
    # tuple.__new__ takes half the time of a named tuple's constructor.
    return (
        tuple.__new__(
            NavState,
            (
                (aw * unit, bx * unit, cy * unit, dz * unit),
                (north_1, east_1, down_1),
                latitude_1,
                longitude_1,
                height - half * (down + down_1),
                gyro,
                accel,
                moved,
                pushed,
            ),
        ),
        tuple.__new__(
            Rates,
            (
                (r0, r1, r2, r3, r4, r5, r6, r7, r8),
                (fn, fe, fd),
                (earth_n, 0.0, earth_d),
                (over_n, over_e, over_d),
                meridian,
                transverse,
                gravity,
            ),
        ),
    )


def matrix(rotation: Rotation) -> Array:
    """Return a rotation given row by row as (3, 3)."""
    return np.array(rotation).reshape(3, 3)
