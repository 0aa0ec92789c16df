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
"""Estimate the covariance, in pixels, of the place where a map point is drawn.

The drawn place has errors from the camera's pose, the time of exposure, the lens and the map.
Each is propagated to pixels with the derivative of the projection at the point (Coelho, MacIntyre
and Julier, OSGAR, ISMAR 2004). The full 6x6 covariance of the pose is used.

A time error moves the pose along the camera's own motion. An error of the map or of the ground's
height acts like one of the camera in the opposite direction. All are added to the pose's 6x6
covariance once for each frame.

The propagation is of first order. Where the second order is not small against it (the relative
error of a point's depth is large, or the attitude is poorly known), ``linear`` is False.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import NEAR_M, Camera
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
    rotvec_from_quat,
    skew,
)
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.poses import CameraPose

#: (4, 3, 6): a camera that moves by dc and turns by phi sees a point displaced by ray x phi - dc/z
#: in units of its depth z. These are the derivatives by dc and phi, as factors of x, y, 1 and 1/z.
_MOVES = np.zeros((4, 3, 6))
_MOVES[:3, :, 3:] = [skew(axis) for axis in np.eye(3)]
_MOVES[3, :, :3] = -np.eye(3)
_ROWS, _COLUMNS = np.triu_indices(3)  # the upper triangle of the displacement's covariance
_FIRST, _SECOND = np.triu_indices(4)  # which two factors make each product
_TIMES = np.where(_FIRST == _SECOND, 0.5, 1.0)  # squares are counted twice

#: 95 % quantile of chi-square with two degrees of freedom, 5.991: the squared radius, in standard
#: deviations, that holds 95 % of a two-dimensional normal distribution.
CHI2_95 = -2 * math.log(0.05)
#: First order is enough up to this relative standard deviation of a point's depth, and up to this
#: relative change of the lens's derivatives within the ellipse. With both, the ellipse of 95 %
#: holds 93 to 97 % of simulated errors.
MOST_DEPTH_SIGMA, MOST_BEND = 0.1, 0.2
_ROUNDING = 1e-4  # rounding error of correlations in float32 messages and sums
_LEAST_VARIANCE = 1e-18
_BLOCK = 2500  # points at a time: NumPy runs larger matrix products in threads, which is slower
_LEAST_RADIUS2 = 1e-12  # squared radius on the plane z = 1: about a thousandth of a pixel


class CameraRates(NamedTuple):
    """Hold the camera's velocity and turn rate at an exposure."""

    velocity_n: Array  # (3,) m/s
    rate_n: Array  # (3,) rad/s, resolved in n: phi_n per second

    @classmethod
    def between(cls, first: CameraPose, last: CameraPose) -> CameraRates:
        """Return the mean motion between two poses with different stamps."""
        step_s = (last.stamp_ns - first.stamp_ns) * 1e-9
        turn = quat_multiply(last.q_nc, quat_conjugate(first.q_nc))
        return cls((last.position_n - first.position_n) / step_s, rotvec_from_quat(turn) / step_s)


def pixel_jacobian(camera: Camera, pose: CameraPose, points_n: Array) -> tuple[Array, Array]:
    """Return the derivatives of pixels by the pose (N, 2, 6) and by the point (N, 2, 3).

    ``points_n`` is (N, 3). The pose's columns are position (px/m) and phi_n (px/rad), in the order
    of its covariance; the point's are px/m. The result is nan where the point is nearer than
    NEAR_M along the optical axis, or outside the lens model.
    """
    rays = rays_to(camera, pose, points_n)
    slopes = np.stack(camera.slopes(rays[0], rays[1]), axis=-1).reshape(-1, 2, 2)
    turn = _turn_both(matrix_from_quat(pose.q_nc).T)
    moved = np.einsum("kie,kn->nie", _MOVES, _factors(rays))
    on_plane = moved[:, :2] - rays[:2].T[:, :, None] * moved[:, 2:]
    by_pose = slopes @ on_plane @ turn
    return by_pose, -by_pose[:, :, :3]


def _turn_both(rotation: Array) -> Array:
    """Return the block-diagonal (6, 6) matrix that rotates position and phi alike."""
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = rotation
    return turn


def _factors(rays: Array) -> Array:
    """Return x, y, 1 and 1/z (4, N) of rays (3, N)."""
    factors = np.ones((4, rays.shape[1]))
    factors[:2], factors[3] = rays[:2], rays[2]
    return factors


def rays_to(camera: Camera, pose: CameraPose, points_n: Array) -> Array:
    """Convert points (N, 3), NED, m, to rays (3, N): x, y on the plane z = 1, and 1/z (1/m).

    nan where a point is nearer than NEAR_M along the optical axis, or outside the lens model.
    """
    offset_n = np.asarray(points_n, float).reshape(-1, 3) - pose.position_n
    points_c = offset_n @ matrix_from_quat(pose.q_nc)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        nearness = 1 / points_c[:, 2]
        x, y = points_c[:, 0] * nearness, points_c[:, 1] * nearness
        valid = (points_c[:, 2] > NEAR_M) & (x * x + y * y <= camera.max_radius**2)
    rays = np.stack([x, y, nearness])
    rays[:, ~valid] = np.nan
    return rays


def timed_covariance(pose: CameraPose, rates: CameraRates | None, sigma_s: float) -> Array:
    """Return the pose's covariance (6, 6) plus that of a time error along the camera's motion.

    ``sigma_s`` is the standard deviation of the time; without ``rates`` the time counts as exact.
    All nan if the pose's covariance is not positive semidefinite within rounding.
    """
    covariance = np.array(pose.covariance, float)
    if rates is not None:
        along = sigma_s * np.concatenate(rates)
        covariance += along[:, None] * along
    sigma = np.sqrt(np.maximum(np.diag(pose.covariance), _LEAST_VARIANCE))
    least = np.linalg.eigvalsh(pose.covariance / (sigma[:, None] * sigma))[0]
    return covariance if least > -_ROUNDING else np.full((6, 6), np.nan)


class FrameConfidence:
    """Compute the pixel covariances of any number of points in one frame.

    ``pose`` is the camera's at the exposure, with its covariance. ``rates`` is the camera's motion
    then; if it is None, the time of exposure counts as exact. Points are given as rays (3, N) from
    ``rays_to`` or ``View``. ``sigma_m`` is the standard deviation of their horizontal positions on
    the map, one for all or (N,); where it is None or nan the configured ``map_sigma_m`` applies.
    """

    def __init__(
        self,
        config: ConfidenceConfig,
        camera: Camera,
        pose: CameraPose,
        rates: CameraRates | None = None,
    ) -> None:
        self.camera = camera
        self._map_variance = config.map_sigma_m**2
        self._lens_variance, self._focal_sigma = config.lens_sigma_px**2, config.focal_sigma
        rotation_cn = matrix_from_quat(pose.q_nc).T
        covariance_n = timed_covariance(pose, rates, config.latency_sigma_s)
        covariance_n[[0, 1], [0, 1]] += self._map_variance
        covariance_n[2, 2] += config.ground_sigma_m**2
        turn = _turn_both(rotation_cn)
        covariance_c = turn @ covariance_n @ turn.T
        self._axis_variance = covariance_c[5, 5]
        flat = _MOVES.reshape(12, 6)
        by_factors = (flat @ covariance_c @ flat.T).reshape(4, 3, 4, 3).transpose(1, 3, 0, 2)
        triangle = by_factors[_ROWS, _COLUMNS]
        #: (6, 10): the displacement's covariance by the products of two factors.
        self._weights = (triangle + triangle.transpose(0, 2, 1))[:, _FIRST, _SECOND] * _TIMES
        self._level = (rotation_cn[:, :2] @ rotation_cn[:, :2].T)[_ROWS, _COLUMNS]

    def spread(
        self, rays: Array, sigma_m: Array | float | None = None, checked: int = 0
    ) -> tuple[Array, BoolArray]:
        """Return the pixel covariances of rays (3, N), and whether first order is enough.

        The covariances are (3, N): variance of the column, covariance, variance of the row, px2.
        The second result, (checked,), is computed only for the first ``checked`` points.
        """
        more = np.zeros(rays.shape[1])
        if sigma_m is not None:
            variance = np.asarray(sigma_m, float) ** 2
            more[:] = np.where(np.isnan(variance), 0.0, variance - self._map_variance)
        starts = range(0, max(len(more), 1), _BLOCK)
        blocks = [slice(start, start + _BLOCK) for start in starts]
        parts = [self._spread(rays[:, b], more[b], max(checked - b.start, 0)) for b in blocks]
        spreads, linear = zip(*parts, strict=True)
        return np.concatenate(spreads, axis=1), np.concatenate(linear)

    def _spread(self, rays: Array, more: Array, checked: int) -> tuple[Array, BoolArray]:
        """Return ``spread`` of one block; ``more`` (N,), m2, adds to ``map_sigma_m`` squared."""
        factors = _factors(rays)
        products = factors.take(_FIRST, axis=0) * factors.take(_SECOND, axis=0)
        moves = self._weights @ products
        if more.any():
            moves += self._level[:, None] * (more * products[-1])
        # x changes by the displacement along x minus x times that along z, y likewise.
        (x, y), (dxx, dxy, dxz, dyy, dyz, depth) = rays[:2], moves
        xz, yz = dxz - x * depth, dyz - y * depth
        xx, xy, yy = dxx - x * (dxz + xz), dxy - x * dyz - y * xz, dyy - y * (dyz + yz)
        ux, uy, vx, vy = slopes = self.camera.slopes(rays[0], rays[1])
        u_x, u_y = ux * xx + uy * xy, ux * xy + uy * yy  # covariances of the column with x and y
        v_x, v_y = vx * xx + vy * xy, vx * xy + vy * yy
        spread = np.array([u_x * ux + u_y * uy, u_x * vx + u_y * vy, v_x * vx + v_y * vy])
        spread[::2] += self._lens_variance
        if self._focal_sigma:  # radial: proportional to the distance from the principal point
            u, v = self.camera.pixels(rays[0], rays[1])
            u, v = u - self.camera.cx, v - self.camera.cy
            spread += self._focal_sigma**2 * np.array([u * u, u * v, v * v])
        if not checked:
            return spread, np.empty(0, bool)
        plane, first_slopes = (
            np.array([each[:checked] for each in rows]) for rows in ((xx, xy, yy), slopes)
        )
        return spread, self._linear(rays[:, :checked], depth[:checked], plane, first_slopes)

    def _linear(self, rays: Array, depth: Array, plane: Array, slopes: Array) -> BoolArray:
        """Return (N,) whether first order is enough; ``depth`` is var(depth) / depth^2, (N,).

        ``plane`` (3, N) are the covariances of x and y on the plane z = 1.
        """
        # The ratio of the second order to the first is the relative error of the depth. This also
        # holds for rotations across the optical axis, where the tangent is not linear. For a
        # rotation about the optical axis the ratio is half its angle.
        with np.errstate(invalid="ignore"):
            linear = depth + self._axis_variance / 4 <= MOST_DEPTH_SIGMA**2
        inside, scale = _outermost(rays, plane, self.camera.max_radius)
        change = np.array(self.camera.slopes(rays[0] * scale, rays[1] * scale)) - slopes
        bent = (change * change).sum(axis=0) > MOST_BEND**2 * (slopes * slopes).sum(axis=0)
        return np.asarray(linear & inside & ~bent)


def _outermost(rays: Array, plane: Array, max_radius: float) -> tuple[BoolArray, Array]:
    """Return whether each 95 % ellipse lies inside the lens model, and how far out it reaches.

    Both are (N,). The second is the distance from the axis of the ellipse's outermost point, in
    the direction of the ray, divided by the ray's own distance; 1 where the ellipse is not inside.
    A lens distorts more the farther from its axis, so this point shows the largest change.
    """
    x, y = rays[:2]
    xx, xy, yy = plane
    squared = np.maximum(x * x + y * y, _LEAST_RADIUS2)
    radial = np.maximum(x * x * xx + 2 * x * y * xy + y * y * yy, 0.0)
    outwards = np.sqrt(CHI2_95 * radial) / squared
    farthest = squared * (1 + 2 * outwards) + CHI2_95 * (xx + yy)
    with np.errstate(invalid="ignore"):
        inside = farthest <= max_radius**2
    return np.asarray(inside), np.where(inside, 1 + outwards, 1.0)


def matrices(spread: Array) -> Array:
    """Return the covariance matrices (N, 2, 2) of ``FrameConfidence.spread`` (3, N)."""
    return np.asarray(spread[[0, 1, 1, 2]].T.reshape(-1, 2, 2))


def radius_95(spread: Array) -> Array:
    """Return the major semi-axes (N,), px, of the 95 % ellipses of ``FrameConfidence.spread``."""
    uu, uv, vv = spread
    longest = (uu + vv) / 2 + np.hypot((uu - vv) / 2, uv)
    return np.asarray(np.sqrt(CHI2_95 * np.maximum(longest, 0.0)))


def ellipse_95(covariance: Array) -> tuple[Array, Array]:
    """Return the ellipses that hold 95 % of normal distributions with covariances (N, 2, 2).

    The semi-axes (N, 2), the larger first, have the unit of the standard deviation. The angle (N,)
    is that of the larger axis, from the first coordinate towards the second, rad: in pixels,
    clockwise on the screen.
    """
    covariance = np.asarray(covariance, float).reshape(-1, 2, 2)
    uu, uv, vv = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    middle, reach = (uu + vv) / 2, np.hypot((uu - vv) / 2, uv)
    squared = CHI2_95 * np.maximum(np.stack([middle + reach, middle - reach], axis=1), 0.0)
    return np.sqrt(squared), np.arctan2(2 * uv, uu - vv) / 2
