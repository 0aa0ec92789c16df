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
"""Check a sample by itself: refuse values that cannot be a measurement."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    ImuSample,
    NavigationInput,
    PositionSample,
    VelocitySample,
)

#: Far above any height at which an aircraft can fly.
LARGEST_HEIGHT_M = 50_000.0
#: Upper bound of the distance between two places up to that height, on opposite sides of earth.
_LARGEST_DISTANCE_M = 2 * (SEMI_MAJOR_AXIS_M + LARGEST_HEIGHT_M)
# Beyond the full scale of any IMU on an aircraft (40 g, 4000 deg/s), and beyond any flight speed.
_LARGEST_FORCE_M_S2 = 400.0
_LARGEST_RATE_RAD_S = 70.0
_LARGEST_SPEED_M_S = 1e3
_LARGEST_ANGLE_RAD = 1e6  # a joint that turns once a second for two days
_LARGEST_VARIANCE = 1e30  # m2, (m/s)2, rad2: some sources send such values for "unknown"
_ROUNDING = 1e-6  # rounding error of a covariance that was sent in single precision
#: Fault, for a filter, of an ``ImuSample`` that has only an attitude.
ATTITUDE_ALONE = "imu/data has an attitude but neither rates nor forces: use method raw or rtk"


def fault_of(sample: NavigationInput) -> str:
    """Return why a sample cannot be used, or an empty string if it can.

    ATTITUDE_ALONE is a fault for a filter only.
    """
    if isinstance(sample, ImuSample):
        return _imu_fault(sample)
    if isinstance(sample, HeadingSample):
        usable = (
            math.isfinite(sample.heading_rad) and abs(sample.variance_rad2) < _LARGEST_VARIANCE
        )
        return "" if usable else "heading is not finite"
    if isinstance(sample, PositionSample):
        return _position_fault(sample) or _covariance_fault(sample.covariance_n)
    if not isinstance(sample, VelocitySample):
        return sample.fault
    velocity_n = sample.velocity_n.tolist()
    if not _within(velocity_n, _LARGEST_SPEED_M_S):
        finite = all(map(math.isfinite, velocity_n))
        return f"velocity is {'out of range' if finite else 'not finite'}"
    return _covariance_fault(sample.covariance_n)


def pose_fault(position_n: Array, q: Array, covariance: Array) -> str:
    """Return why a pose in a tangent plane cannot be used, or an empty string if it can.

    ``position_n`` is (3,) in m, ``q`` (4,) wxyz, ``covariance`` (6, 6). The quaternion's squared
    norm must be 1 within 1e-3, which allows for the rounding in messages and sums.
    """
    if not _within(position_n.tolist(), _LARGEST_DISTANCE_M):
        return "position is not finite, or not on the Earth"
    w, x, y, z = q.tolist()
    if not abs(w * w + x * x + y * y + z * z - 1) < 1e-3:  # "not <" also catches NaN and infinity
        return "attitude is not a unit quaternion"
    # No entry of a covariance exceeds its largest variance: this bounds the sum of the squares.
    if not np.vdot(covariance, covariance) < covariance.size * _LARGEST_VARIANCE**2:
        return "covariance is not finite"
    return "" if covariance.diagonal().min() > -_ROUNDING else "covariance is not positive"


def joints_fault(angles_rad: tuple[float, float, float]) -> str:
    """Return why joint angles (rad) cannot be used, or an empty string if they can."""
    return "" if _within(angles_rad, _LARGEST_ANGLE_RAD) else "angle is not finite or out of range"


def usable_attitude(q: Array | None) -> bool:
    """Return whether a quaternion (4,) is given, finite and of unit norm within 1 %."""
    return q is not None and abs(math.hypot(*q) - 1.0) < 0.01


def place_fault(latitude_rad: float, longitude_rad: float, height_m: float) -> str:
    """Return why a geodetic position is impossible, or an empty string if it is possible."""
    if not all(map(math.isfinite, (latitude_rad, longitude_rad, height_m))):
        return "position is not finite"
    if abs(latitude_rad) > math.pi / 2 or abs(longitude_rad) > 2 * math.pi:
        return "latitude or longitude is out of range"
    return "" if abs(height_m) < LARGEST_HEIGHT_M else "height is out of range"


def _imu_fault(sample: ImuSample) -> str:
    force_b, rate_b = sample.specific_force_b.tolist(), sample.angular_rate_b.tolist()
    if _within(force_b, _LARGEST_FORCE_M_S2) and _within(rate_b, _LARGEST_RATE_RAD_S):
        return ""
    if sample.is_attitude_alone and usable_attitude(sample.autopilot_q_nb):
        return ATTITUDE_ALONE
    finite = all(map(math.isfinite, force_b + rate_b))
    return f"force or rate is {'out of range' if finite else 'not finite'}"


def _within(vector: Sequence[float], limit: float) -> bool:
    """Return whether every entry of a vector (3,) is within -limit to limit; False for NaN."""
    x, y, z = vector
    return -limit <= x <= limit and -limit <= y <= limit and -limit <= z <= limit


def _position_fault(sample: PositionSample) -> str:
    if sample.latitude_rad == 0 and sample.longitude_rad == 0:
        return "position is 0, 0, which receivers send when they have none"
    return place_fault(sample.latitude_rad, sample.longitude_rad, sample.height_m)


def _covariance_fault(covariance: Array) -> str:
    (a, b, c), (b2, d, e), (c2, e2, f) = covariance.tolist()
    total = abs(a) + abs(b) + abs(c) + abs(d) + abs(e) + abs(f) + abs(b2) + abs(c2) + abs(e2)
    if not total < _LARGEST_VARIANCE:  # "not <" also catches NaN
        return "covariance is not finite"
    if a <= 0 or d <= 0 or f <= 0:  # the source marks it as unknown: no fault
        return ""
    largest = max(a, d, f)
    b, c, e = 0.5 * (b + b2) / largest, 0.5 * (c + c2) / largest, 0.5 * (e + e2) / largest
    a, d, f = a / largest + _ROUNDING, d / largest + _ROUNDING, f / largest + _ROUNDING
    # Sylvester's criterion: all leading principal minors of a positive definite matrix are > 0.
    second = a * d - b * b
    third = second * f - a * e * e + 2 * b * c * e - d * c * c
    return "" if second > 0 and third > 0 else "covariance is not positive"
