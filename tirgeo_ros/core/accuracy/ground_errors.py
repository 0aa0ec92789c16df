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
"""Predict the errors of a pixel's ground point, and summarise measured ones.

A prediction uses errors of the camera's pose, time and lens. It has two forms. The paper's (Ren
et al. 2022, section 3.5) is for a level pinhole camera over a plane: scalars, Equations 15 to 21
as printed. Ours is the derivative of the ground point by position and attitude, from rotation
matrices, for any lens and any covariance of the pose; the paper's is its special case.

The paper defines its angle ``alpha`` differently in two places. In Equation 15 it is the angle
from the nadir, and ``y_im`` is positive up. In Equation 21 it is the depression below the horizon,
and ``y_im`` is positive down. The second row of Equation 15 has the wrong sign of ``x_im``: as
printed, its two rows are not a rotation unless ``beta`` is a multiple of 90 degrees. The sign is
corrected here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import pixel_jacobian
from tirgeo_ros.core.frames.rotations import BODY_OPTICAL, matrix_from_euler, quat_from_matrix
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

_DOWN = 2

#: The share of errors within the circular error CE90, the usual figure for maps.
CIRCULAR_SHARE = 0.9


def paper_ground_offset(
    x_im: Array, y_im: Array, f: float, alpha_rad: float, beta_rad: float, h_m: float
) -> tuple[Array, Array]:
    """Return Equation 15 minus the camera's position: (X_D - x_cam, Y_D - y_cam), m.

    ``x_im`` and ``y_im`` (px) are from the picture's centre, right and up; ``f`` is in px;
    ``alpha_rad`` is from the nadir. X points west and Y north; ``beta_rad`` is from north to east.
    """
    sin_a, cos_a = np.sin(alpha_rad), np.cos(alpha_rad)
    sin_b, cos_b = np.sin(beta_rad), np.cos(beta_rad)
    below = f * cos_a - y_im * sin_a
    ahead = f * h_m * sin_a + h_m * y_im * cos_a
    x = -(h_m * x_im * cos_b + ahead * sin_b) / below
    y = (-h_m * x_im * sin_b + ahead * cos_b) / below
    return x, y


def paper_position_error_m(east_m: float, north_m: float) -> float:
    """Return the horizontal position error (m) by Equation 17."""
    return float(np.hypot(east_m, north_m))


def paper_height_error_m(
    x_im: Array, y_im: Array, f: float, depression_rad: float, height_error_m: float
) -> Array:
    """Return the ground error (m) of a height error by Equation 19.

    It is the derivative of Equation 15 by the camera's height, times the height's error.
    ``x_im`` and ``y_im`` (px) are from the picture's centre, right and down, as in Equation 21.
    """
    x, y = paper_ground_offset(x_im, -y_im, f, np.pi / 2 - depression_rad, 0.0, 1.0)
    return np.asarray(height_error_m * np.hypot(x, y))


def paper_heading_error_m(
    x_im: Array, y_im: Array, f: float, depression_rad: float, h_m: float, heading_error_rad: float
) -> Array:
    """Return the ground error (m) of a heading error by Equation 21, as printed."""
    sin_a, cos_a = np.sin(depression_rad), np.cos(depression_rad)
    below = (f * sin_a + y_im * cos_a) ** 2
    first = (f**2 * cos_a**2 - 2 * f * y_im * sin_a * cos_a) / below
    second = (x_im**2 + y_im**2 * sin_a**2) / below
    return np.asarray(heading_error_rad * h_m * np.sqrt(first + second))


@dataclass(frozen=True)
class GroundView:
    """Hold pixels of a camera over level ground, their ground points and the derivatives of these.

    ``uv`` (N, 2) in px; ``points_n`` (N, 3) NED from the camera, m, nan above the horizon and
    outside the lens model; ``by_pose`` (N, 2, 6) derivatives of north and east by the camera's
    position (NED, m) and attitude phi_n (rad); ``by_pixel`` (N, 2, 2) by column and row (m/px);
    ``from_centre`` (N, 2) are the pixels from the principal point, px.
    """

    uv: Array
    points_n: Array
    by_pose: Array
    by_pixel: Array
    from_centre: Array

    @classmethod
    def of(cls, camera: Camera, rotation_nc: Array, height_m: float, uv: Array) -> GroundView:
        """Back-project pixels (N, 2) to level ground, from a height (m) and an attitude (3, 3).

        A pixel does not move if the motion of its ground point cancels the pose error:
        0 = J_pose dp + J_point dg, where J are derivatives of the pixel.
        """
        rays_n = camera.rays(uv) @ rotation_nc.T
        with np.errstate(invalid="ignore"):
            rays_n[~(rays_n[:, _DOWN] > 0)] = np.nan
        points_n = rays_n * (height_m / rays_n[:, _DOWN:])
        pose = CameraPose(0, np.zeros(3), quat_from_matrix(rotation_nc), np.zeros((6, 6)))
        of_pose, of_point = pixel_jacobian(camera, pose, points_n)
        by_pixel = np.asarray(np.linalg.inv(of_point[:, :, :2]), float)
        from_centre = np.asarray(uv, float) - (camera.cx, camera.cy)
        return cls(uv, points_n, np.asarray(-by_pixel @ of_pose), by_pixel, from_centre)

    def covariance(
        self,
        pose_covariance: Array,
        *,
        lens_sigma_px: float = 0.0,
        focal_sigma: float = 0.0,
        ground_sigma_m: float = 0.0,
        latency_sigma_s: float = 0.0,
        rates: Array | None = None,
    ) -> Array:
        """Return the covariances (N, 2, 2) of the ground points' north and east, m2.

        ``pose_covariance`` (6, 6) is of position (NED, m2) and phi_n (rad2). ``rates`` (6,) has
        the camera's velocity (m/s) and turn rate (rad/s), NED, which a time error multiplies;
        without it the time counts as exact.
        """
        covariance = np.array(pose_covariance, float)
        covariance[_DOWN, _DOWN] += ground_sigma_m**2
        if rates is not None:
            covariance += latency_sigma_s**2 * np.outer(rates, rates)
        by_pose = self.by_pose @ covariance @ self.by_pose.transpose(0, 2, 1)
        by_lens = self.by_pixel @ self.by_pixel.transpose(0, 2, 1)
        by_focal = np.einsum("nij,nj->ni", self.by_pixel, focal_sigma * self.from_centre)
        by_lens = lens_sigma_px**2 * by_lens + by_focal[:, :, None] * by_focal[:, None, :]
        return np.asarray(by_pose + by_lens)


def looking(depression_rad: float, heading_rad: float = 0.0) -> Array:
    """Return ``R_nc`` (3, 3) of a camera without roll, at a depression angle and a heading."""
    return np.asarray(matrix_from_euler(0.0, -depression_rad, heading_rad) @ BODY_OPTICAL)


def pixel_grid(camera: Camera, step_px: int) -> tuple[Array, tuple[int, int]]:
    """Return the centres (N, 2) of blocks of pixels over the whole picture, and (rows, columns).

    The centres are in row order. The blocks are equal, with sides of at most ``step_px``.
    """
    rows, columns = -(-camera.height // step_px), -(-camera.width // step_px)
    u = (np.arange(columns) + 0.5) * (camera.width / columns) - 0.5
    v = (np.arange(rows) + 0.5) * (camera.height / rows) - 0.5
    return np.stack(np.meshgrid(u, v), -1).reshape(-1, 2), (rows, columns)


def rms_m(covariance: Array) -> Array:
    """Return the rms horizontal errors (N,), m, of covariances (N, 2, 2), m2."""
    return np.asarray(np.sqrt(np.trace(covariance, axis1=1, axis2=2)))


@dataclass(frozen=True)
class GroundErrors:
    """Hold the horizontal errors of N measurements of ground points: located minus surveyed."""

    ids: Sequence[str]  # N; a point that was measured several times occurs several times
    error_en: Array  # (N, 2) east, north in a plane, m

    @cached_property
    def distance_m(self) -> Array:
        """Return the length (N,) of each error, m."""
        return np.asarray(np.hypot(self.error_en[:, 0], self.error_en[:, 1]))

    @property
    def rmse_m(self) -> float | None:
        """Return the rms of all errors, m; None without any."""
        return float(rms(self.distance_m)) if len(self.ids) else None

    @cached_property
    def point_rmse_m(self) -> dict[str, float]:
        """Return each point's rms error (m) over its measurements: Ren et al. 2022, Eq. 24."""
        distances: dict[str, list[float]] = {name: [] for name in self.ids}
        for name, distance_m in zip(self.ids, self.distance_m.tolist(), strict=True):
            distances[name].append(distance_m)
        return {name: float(rms(d)) for name, d in distances.items()}

    @property
    def mean_point_rmse_m(self) -> float | None:
        """Return the mean of Equation 24 over the points, m; None without any.

        It is the last row of Table 6.
        """
        each = list(self.point_rmse_m.values())
        return float(np.mean(each)) if each else None

    @property
    def ce90_m(self) -> float | None:
        """Return the circular error CE90, m: the radius that holds 90 % of the errors.

        It is the 90th percentile of the lengths, with linear interpolation; None without errors.
        """
        if not len(self.distance_m):
            return None
        return float(np.quantile(self.distance_m, CIRCULAR_SHARE))

    @property
    def mean_error_en(self) -> Array | None:
        """Return the mean error (2,), east, north, m: the common offset; None without any."""
        return np.asarray(self.error_en.mean(axis=0)) if len(self.error_en) else None


def rms(values: npt.ArrayLike) -> Array:
    """Return the root mean square over the first axis: (N, ...) to (...)."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))
