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
"""Describe a picture with its predicted pose, and what it shows of the ground."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, locate
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.poses import CameraPose

_ACROSS = 7  # sample pixels across a picture, and down


class View(NamedTuple):
    """Hold a picture's camera and predicted pose, without its pixels."""

    stamp_ns: int  # of the picture's header
    camera: Camera
    pose: CameraPose  # at the exposure

    def pixels_of(self, points_n: Array) -> Array:
        """Return the pixels (N, 2) of points (N, 3), NED, m; nan outside the lens model."""
        offset_n = points_n - self.pose.position_n
        return self.camera.project(offset_n @ matrix_from_quat(self.pose.q_nc))[0]

    def shows(self, points_n: Array) -> BoolArray:
        """Return whether points (N, 3), NED, m, are in the picture; not if they are nan."""
        size = np.array([self.camera.width, self.camera.height])
        with np.errstate(invalid="ignore"):
            return np.asarray(
                (np.abs(self.pixels_of(points_n) - size / 2 + 0.5) < size / 2).all(1)
            )

    def samples(self, plane: TangentPlane, ground: Ground) -> Array:
        """Return the ground points (49, 3), NED, m, of pixels all over; nan where none is."""
        shares = (np.arange(_ACROSS) + 0.5) / _ACROSS
        u, v = np.meshgrid(shares * self.camera.width, shares * self.camera.height)
        uv = np.stack([u.ravel(), v.ravel()], axis=1) - 0.5
        return locate(self.camera, self.pose, uv, plane, ground)[0]
