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
"""Convert between geodetic coordinates and a tangent plane of the WGS84 ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.rotations import quat_multiply
from tirgeo_ros.core.frames.wgs84 import (
    FLOAT_FUNCTIONS,
    ecef,
    ecef_from_geodetic,
    geodetic_from_ecef,
    quat_ecef_from_ned,
    rotation_ecef_from_ned,
)
from tirgeo_ros.core.types.arrays import Array, Quaternion
from tirgeo_ros.core.types.poses import BodyPose, NavSolution


@dataclass(frozen=True)
class TangentPlane:
    """Hold the tangent plane of the ROS frame ``map``: NED axes at its origin, metres."""

    latitude_rad: float
    longitude_rad: float
    height_m: float
    _origin_e: Array = field(init=False, repr=False, compare=False)
    _rotation_en: Array = field(init=False, repr=False, compare=False)
    _q_ne: Quaternion = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Compute the plane's origin and axes in the earth-fixed frame once."""
        origin = ecef_from_geodetic(self.latitude_rad, self.longitude_rad, self.height_m)
        object.__setattr__(self, "_origin_e", origin)
        rotation = rotation_ecef_from_ned(self.latitude_rad, self.longitude_rad)
        object.__setattr__(self, "_rotation_en", rotation)
        w, x, y, z = quat_ecef_from_ned(self.latitude_rad, self.longitude_rad)
        object.__setattr__(self, "_q_ne", (w, -x, -y, -z))

    def ned_from_geodetic(
        self, latitude_rad: npt.ArrayLike, longitude_rad: npt.ArrayLike, height_m: npt.ArrayLike
    ) -> Array:
        """Convert geodetic positions (...) to positions (..., 3) in the plane, NED, m."""
        position_e = ecef_from_geodetic(latitude_rad, longitude_rad, height_m)
        return np.asarray((position_e - self._origin_e) @ self._rotation_en)

    def geodetic_from_ned(self, position_n: Array) -> tuple[Array, Array, Array]:
        """Convert positions (..., 3), NED, m, to latitude, longitude (rad) and height (m)."""
        return geodetic_from_ecef(self._origin_e + np.asarray(position_n) @ self._rotation_en.T)

    def up_n(self, latitude_rad: Array, longitude_rad: Array) -> Array:
        """Return the ellipsoid's upward normals (..., 3) at places (...), in the plane's axes."""
        cosine = np.cos(latitude_rad)
        parts = (cosine * np.cos(longitude_rad), cosine * np.sin(longitude_rad))
        return np.asarray(np.stack([*parts, np.sin(latitude_rad)], axis=-1) @ self._rotation_en)

    def rotation_from_local(self, latitude_rad: float, longitude_rad: float) -> Array:
        """Return the rotation (3, 3) from north, east, down at a place to the plane's axes."""
        local_en = rotation_ecef_from_ned(latitude_rad, longitude_rad)
        return np.asarray(np.dot(self._rotation_en.T, local_en))

    def body_pose(self, solution: NavSolution) -> BodyPose:
        """Convert a solution, whose axes are those at the aircraft, to a pose in the plane."""
        latitude, longitude = solution.latitude_rad, solution.longitude_rad
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = self.rotation_from_local(latitude, longitude)
        q_ln = quat_multiply(self._q_ne, quat_ecef_from_ned(latitude, longitude))
        place_e = ecef(latitude, longitude, solution.height_m, FLOAT_FUNCTIONS)
        from_origin_e = [a - b for a, b in zip(place_e, self._origin_e.tolist(), strict=True)]
        return BodyPose(
            solution.stamp_ns,
            np.dot(np.array(from_origin_e), self._rotation_en),
            np.array(quat_multiply(q_ln, tuple(solution.q_nb.tolist()))),
            np.dot(np.dot(turn, solution.pose_covariance), turn.T),
        )
