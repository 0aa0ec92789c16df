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
"""Define the states and poses that the core estimates: immutable, with frames and units.

All stamps are integer nanoseconds, the time of the measurement. The frames are defined in
``tirgeo_ros/__init__.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tirgeo_ros.core.types.arrays import Array


class NavSolution(NamedTuple):
    """Hold the aircraft's navigation state: position of the IMU, axes ``n`` at the aircraft."""

    stamp_ns: int
    latitude_rad: float
    longitude_rad: float
    height_m: float
    velocity_n: Array  # (3,) m/s
    q_nb: Array  # (4,) wxyz
    angular_rate_b: Array  # (3,) rad/s, bias removed
    rate_variance_b: tuple[float, float, float]  # of the angular rate, (rad/s)^2
    covariance: Array  # (9, 9) position NED m2, attitude phi_n rad2, velocity NED m2/s2

    @property
    def pose_covariance(self) -> Array:
        """Return the covariance (6, 6) of position (NED, m2) and attitude phi_n (rad2)."""
        return self.covariance[:6, :6]


@dataclass(frozen=True, slots=True)
class BodyPose:
    """Hold the pose of the body in the ``map`` tangent plane, NED axes."""

    stamp_ns: int
    position_n: Array  # (3,) m from the map's origin
    q_nb: Array  # (4,) wxyz
    covariance: Array  # (6, 6) position m2, attitude phi_n rad2


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Hold the pose of the camera's optical frame in the ``map`` tangent plane, NED axes."""

    stamp_ns: int
    position_n: Array  # (3,) m from the map's origin
    q_nc: Array  # (4,) wxyz, optical frame to NED
    covariance: Array  # (6, 6) position m2, attitude phi_n rad2
