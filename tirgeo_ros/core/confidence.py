"""How far from its drawn place a point of the map may truly appear: covariances in the picture.

What is drawn is off by the errors of the camera's pose, of the time of exposure, of the lens and
of the map. Each error is carried to pixels by the derivative of the projection at the point. The
model is that of MacIntyre, Coelho and Julier (Estimating and adapting to registration errors in
augmented reality systems, IEEE VR 2002), with the pose's covariance kept whole.

A time error moves the pose along the camera's own motion, and an error of a map point acts as the
camera's in the opposite direction, so that both join the pose's 6x6 covariance once a frame.

To first order only. Where the second is not small beside it (a point so near that its depth is
uncertain, an attitude that is hardly known) the answer says so: ``linear`` is False.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from tirgeo_ros.core.attitude import (
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.camera import NEAR_M, Camera
from tirgeo_ros.core.config.pictures import ConfidenceConfig
from tirgeo_ros.core.polylines import BoolArray
from tirgeo_ros.core.samples import Array, CameraPose

#: Squared radius, in standard deviations, that holds 95 % of a plane's normal distribution:
#: 5.991, chi-square with two degrees of freedom.
CHI2_95 = -2 * math.log(0.05)
#: The same of a line's: 95 % lie within so many standard deviations of the middle.
SIGMAS_95 = 1.959963984540054
#: Standard deviation of a point's depth over its depth, from which on first order is too little:
MOST_DEPTH_SIGMA = 0.1


Variances: TypeAlias = tuple[Array, Array, Array]  # (N,): column, between them, row


class CameraRates(NamedTuple):
    """The camera's motion at an exposure."""

    velocity_n: Array  # (3,) m/s
    rate_n: Array  # (3,) rad/s, resolved in n: phi_n a second

    @classmethod
    def between(cls, first: CameraPose, last: CameraPose) -> CameraRates:
        """The mean motion between two poses of different stamps."""
        step_s = (last.stamp_ns - first.stamp_ns) * 1e-9
        turn = quat_multiply(last.q_nc, quat_conjugate(first.q_nc))
        return cls((last.position_n - first.position_n) / step_s, rotvec_from_quat(turn) / step_s)


class ScreenCovariance(NamedTuple):
    """Covariances of points in the picture."""

    covariance: Array  # (N, 2, 2) px2, column and row; nan where the camera does not see the point
    linear: BoolArray  # (N,) whether an ellipse tells the whole; False where there is none


def pixel_jacobian(camera: Camera, pose: CameraPose, points_n: Array) -> tuple[Array, Array]:
    """Derivatives of pixels by the pose (N, 2, 6) and by the point (N, 2, 3), for points (N, 3).

    The pose's columns are position (px/m) and phi_n (px/rad), the order of its covariance; the
    point's are px/m. nan where the point is not in front of the camera or outside the lens model.
    """
    rays = rays_to(camera, pose, points_n)
    by_camera = np.stack(_by_camera(rays))  # (2, 6, N): of x and y, by errors resolved in c
    slopes = np.array(camera.slopes(*rays[:2])).reshape(2, 2, -1)
    rotation_cn = matrix_from_quat(pose.q_nc).T
    by_pose = np.empty((rays.shape[1], 2, 6))
    for part in (slice(0, 3), slice(3, 6)):
        by_pose[:, :, part] = np.einsum("ijn,jkn->nik", slopes, by_camera[:, part]) @ rotation_cn
    return by_pose, -by_pose[:, :, :3]


def rays_to(camera: Camera, pose: CameraPose, points_n: Array) -> Array:
    """Points (N, 3) as the camera sees them, (3, N): x, y on the plane z = 1, and 1/z (1/m).

    nan where a point is nearer than NEAR_M along the optical axis, or outside the lens model.
    """
    offset_n = np.asarray(points_n, float).reshape(-1, 3) - pose.position_n
    points_c = matrix_from_quat(pose.q_nc).T @ offset_n.T
    with np.errstate(invalid="ignore", over="ignore"):
        points_c[:, ~(points_c[2] > NEAR_M)] = np.nan
        x, y = points_c[:2] / points_c[2]
        rays = np.stack([x, y, 1 / points_c[2]])
        rays[:, ~(x * x + y * y <= camera.max_radius**2)] = np.nan
    return rays


def _by_camera(rays: Array) -> tuple[Array, Array]:
    """(6, N) derivatives of x, and of y, by position and phi of the camera, resolved in c.

    A point at d from the camera moves in it by -position + d x phi.
    """
    x, y, nearness = rays
    zero = np.zeros_like(x)
    return (
        np.stack([-nearness, zero, x * nearness, x * y, -1 - x * x, y]),
        np.stack([zero, -nearness, y * nearness, 1 + y * y, -x * y, -x]),
    )


class FrameConfidence:
    """One frame's errors, ready for any number of its points.

    ``pose`` at the exposure with its covariance; ``rates`` of the camera then, None where they are
    not known: the time of exposure then counts as exact. Points are given as ``rays_to`` or
    ``View`` give them; ``sigma_m`` is the standard deviation of their horizontal places on the
    map, one or (N,), and where it is None or nan the configured one holds.
    """

    def __init__(
        self,
        config: ConfidenceConfig,
        camera: Camera,
        pose: CameraPose,
        rates: CameraRates | None = None,
    ) -> None:
        self._camera = camera
        self._map_sigma_m = config.map_sigma_m
        self._lens_variance = config.lens_sigma_px**2
        covariance = np.array(pose.covariance, float)
        covariance[2, 2] += config.ground_sigma_m**2
        if rates is not None:
            along = config.latency_sigma_s * np.concatenate(rates)
            covariance += along[:, None] * along
        rotation_cn = matrix_from_quat(pose.q_nc).T
        turn = np.kron(np.eye(2), rotation_cn)
        self._covariance_c = turn @ covariance @ turn.T
        down_c = rotation_cn[:, 2]
        self._level_c = np.eye(3) - np.outer(down_c, down_c)

    def covariance(self, rays: Array, sigma_m: Array | float | None = None) -> ScreenCovariance:
        """Covariances of the points' pixels; rays (3, N)."""
        uu, uv, vv = self.variances(rays, sigma_m)
        covariance = np.stack([uu, uv, uv, vv], axis=-1).reshape(-1, 2, 2)
        with np.errstate(invalid="ignore"):
            linear = self._depth_variance(rays) <= MOST_DEPTH_SIGMA**2
        return ScreenCovariance(covariance, linear)

    def radius_95(self, rays: Array, sigma_m: Array | float | None = None) -> Array:
        """(N,) major semi-axis of the ellipse of 95 %, px."""
        uu, uv, vv = self.variances(rays, sigma_m)
        longest = (uu + vv) / 2 + np.hypot((uu - vv) / 2, uv)
        return np.asarray(np.sqrt(CHI2_95 * longest))

    def variances(self, rays: Array, sigma_m: Array | float | None = None) -> Variances:
        """Variance of the column, covariance of column and row, variance of the row, px2."""
        by_x, by_y = _by_camera(rays)
        covariance, extra = self._with_map(sigma_m)
        spread_x, spread_y = covariance @ by_x, covariance @ by_y
        if extra is not None:
            spread_x[:3] += extra * (self._level_c @ by_x[:3])
            spread_y[:3] += extra * (self._level_c @ by_y[:3])
        xx = np.einsum("in,in->n", by_x, spread_x)
        xy = np.einsum("in,in->n", by_y, spread_x)
        yy = np.einsum("in,in->n", by_y, spread_y)
        return self._in_pixels(rays, xx, xy, yy)

    def _with_map(self, sigma_m: Array | float | None) -> tuple[Array, Array | None]:
        """The covariance with the map's error in it, and (N,) m2 that points have beyond it."""
        sigma = np.asarray(np.nan if sigma_m is None else sigma_m, float)
        variance = np.where(np.isnan(sigma), self._map_sigma_m, sigma) ** 2
        least = variance.min() if variance.size else 0.0
        covariance = self._covariance_c.copy()
        covariance[:3, :3] += least * self._level_c
        return covariance, variance - least if (variance > least).any() else None

    def _in_pixels(self, rays: Array, xx: Array, xy: Array, yy: Array) -> Variances:
        """What the lens makes of variances on the plane z = 1."""
        ux, uy, vx, vy = self._camera.slopes(rays[0], rays[1])
        u_x, u_y = ux * xx + uy * xy, ux * xy + uy * yy  # the pixel's covariance with x and y
        v_x, v_y = vx * xx + vy * xy, vx * xy + vy * yy
        lens = self._lens_variance
        return u_x * ux + u_y * uy + lens, u_x * vx + u_y * vy, v_x * vx + v_y * vy + lens

    def _depth_variance(self, rays: Array) -> Array:
        """Variance of the depth over the depth, to which the second order is proportional.

        It has x and y times the turns about y and x too, by which a tangent bends; a turn about
        the axis bends by half its angle.
        """
        x, y, nearness = rays
        by_depth = np.stack([-nearness, -y, x])
        depth = np.einsum("in,ij,jn->n", by_depth, self._covariance_c[2:5, 2:5], by_depth)
        return np.asarray(depth + self._covariance_c[5, 5] / 4)


def screen_covariance(
    camera: Camera,
    pose: CameraPose,
    points_n: Array,
    config: ConfidenceConfig,
    rates: CameraRates | None = None,
    sigma_m: Array | float | None = None,
) -> ScreenCovariance:
    """Covariances in the picture of points (N, 3) of the map, as ``FrameConfidence`` has them."""
    frame = FrameConfidence(config, camera, pose, rates)
    return frame.covariance(rays_to(camera, pose, points_n), sigma_m)


def ellipse_95(covariance: Array) -> tuple[Array, Array]:
    """The ellipses that hold 95 % of normal distributions (N, 2, 2).

    Semi-axes (N, 2), the larger first, in the unit of the covariance's root, and the angle (N,)
    of the larger from the first axis towards the second, rad: in pixels, clockwise as seen.
    """
    covariance = np.asarray(covariance, float).reshape(-1, 2, 2)
    uu, uv, vv = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    middle, reach = (uu + vv) / 2, np.hypot((uu - vv) / 2, uv)
    squared = CHI2_95 * np.maximum(np.stack([middle + reach, middle - reach], axis=1), 0.0)
    return np.sqrt(squared), np.arctan2(2 * uv, uu - vv) / 2
