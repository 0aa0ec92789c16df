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
"""What a camera of tests looks from and on: its poses, elevation models, lines of a map."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.frames.rotations import Q_BODY_OPTICAL, quat_from_euler, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import GridOf
from tirgeo_ros.core.map.vector_map import GeoFeature, MapLayer, VectorMap
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

PLANE = TangentPlane(0.6955, 2.0368, 11.5)


def camera_pose(position_n, roll_deg=0.0, pitch_deg=-90.0, yaw_deg=0.0, covariance=None, stamp=0):
    """Return a pose; its covariance is zero unless given: (6, 6), or one variance for all."""
    q_ng = quat_from_euler(*np.radians([roll_deg, pitch_deg, yaw_deg]))
    covariance = 0.0 if covariance is None else covariance
    covariance = covariance * np.eye(6) if np.ndim(covariance) == 0 else covariance
    q_nc = quat_multiply(q_ng, Q_BODY_OPTICAL)
    return CameraPose(stamp, np.array(position_n, float), q_nc, covariance)


def map_of(*lines_n):
    """A map of lines whose points (n, 3) are NED in ``PLANE``."""
    places = [PLANE.geodetic_from_ned(np.array(line, float)) for line in lines_n]
    features = [GeoFeature("", False, np.column_stack(place)) for place in places]
    return VectorMap.from_layers([MapLayer("", features)], PLANE)


def graticule(
    south_west_deg: tuple[float, float], step_deg: tuple[float, float], rows: int
) -> GridOf:
    """Return ``grid_of`` for a grid along meridians and parallels, its first row in the north.

    The first two arguments are (latitude, longitude): the grid's south-western node and its step.
    ``rows`` is its number of rows.
    """
    south, west = south_west_deg
    step_lat, step_lon = step_deg

    def grid_of(latitude_rad: Array, longitude_rad: Array) -> tuple[Array, Array]:
        turned = np.degrees(longitude_rad) - west
        # Wrap to [-90, 270) deg east of the grid's west edge.
        turned = (turned + 90.0) % 360.0 - 90.0
        return turned / step_lon, rows - 1 - (np.degrees(latitude_rad) - south) / step_lat

    return grid_of
