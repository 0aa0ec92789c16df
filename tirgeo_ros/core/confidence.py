"""How far from its drawn place a point of the map may truly appear: covariances in the picture.

What is drawn is off by the errors of the camera's pose, of the time of exposure, of the lens and
of the map. Each is carried to pixels by the derivative of the projection at the point (Coelho,
MacIntyre and Julier, OSGAR, ISMAR 2004), with the pose's covariance kept whole.

A time error moves the pose along the camera's own motion, and an error of a map point acts as the
camera's in the opposite direction, so that both join the pose's 6x6 covariance once a frame.

To first order only. Where the second is not small beside it (a point so near that its depth is
uncertain, an attitude that is hardly known) the answer says so: ``linear`` is False.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from tirgeo_ros.core.attitude import (
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
    rotvec_from_quat,
    skew,
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
#: First order is enough up to this standard deviation of a point's depth over its depth, and this
#: change of the lens's slopes within the ellipse: of drawn errors 93 to 97 % are then inside.
MOST_DEPTH_SIGMA, MOST_BEND = 0.1, 0.2
_ROUNDING = 1e-4  # of correlations in float32 messages and sums
_LEAST_VARIANCE = 1e-18
_BLOCK = 2500  # points: larger products of matrices are handed to threads, at a loss
_LEAST_RADIUS2 = 1e-12  # of the plane z = 1: a thousandth of a pixel
# A point at d from the camera moves in c by -position + d x phi. Over its depth that is the sum
# of these (3, 6), times x, y, 1 and 1/z.
_MOVES = np.zeros((4, 3, 6))
_MOVES[:3, :, 3:] = [skew(axis) for axis in np.eye(3)]
_MOVES[3, :, :3] = -np.eye(3)
_MOVES_ROWS = _MOVES.reshape(12, 6)
_FIRST, _SECOND = np.triu_indices(4)  # of the products of x, y, 1 and 1/z
_ROWS, _COLUMNS = np.triu_indices(3)
# Of those products and of the upper triangle of x, y and z: (6, 10) places among 12 x 12.
_PART = 12 * (3 * _FIRST + _ROWS[:, None]) + 3 * _SECOND + _COLUMNS[:, None]
_MIRRORED = 12 * (3 * _SECOND + _ROWS[:, None]) + 3 * _FIRST + _COLUMNS[:, None]
_TIMES = np.where(_FIRST == _SECOND, 0.5, 1.0)

Slopes: TypeAlias = tuple[Array, Array, Array, Array]  # as Camera.slopes gives them
Spread: TypeAlias = tuple[Array, Array, Array]  # (N,) variance, covariance, variance


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
    x, y, nearness = rays
    moved = np.einsum("kie,kn->nie", _MOVES, np.stack([x, y, np.ones_like(x), nearness]))
    on_plane = moved[:, :2] - rays[:2].T[:, :, None] * moved[:, 2:]
    slopes = np.stack(camera.slopes(x, y), axis=-1).reshape(-1, 2, 2)
    by_pose = slopes @ on_plane @ _both(matrix_from_quat(pose.q_nc).T)
    return by_pose, -by_pose[:, :, :3]


def rays_to(camera: Camera, pose: CameraPose, points_n: Array) -> Array:
    """Points (N, 3) as the camera sees them, (3, N): x, y on the plane z = 1, and 1/z (1/m).

    nan where a point is nearer than NEAR_M along the optical axis, or outside the lens model.
    """
    offset_n = np.asarray(points_n, float).reshape(-1, 3) - pose.position_n
    points_c = offset_n @ matrix_from_quat(pose.q_nc)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        nearness = 1 / points_c[:, 2]
        x, y = points_c[:, 0] * nearness, points_c[:, 1] * nearness
        seen = (points_c[:, 2] > NEAR_M) & (x * x + y * y <= camera.max_radius**2)
    rays = np.stack([x, y, nearness])
    rays[:, ~seen] = np.nan
    return rays


def timed_covariance(pose: CameraPose, rates: CameraRates | None, sigma_s: float) -> Array:
    """The pose's covariance (6, 6) with an error of the time in it, along the camera's motion.

    All nan where the pose's is none, with a negative variance: nothing follows from it.
    """
    covariance = np.array(pose.covariance, float)
    if rates is not None:
        along = sigma_s * np.concatenate(rates)
        covariance += along[:, None] * along
    sigma = np.sqrt(np.maximum(np.diag(pose.covariance), _LEAST_VARIANCE))
    least = np.linalg.eigvalsh(pose.covariance / (sigma[:, None] * sigma))[0]
    return covariance if least > -_ROUNDING else np.full((6, 6), np.nan)


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
        self.camera = camera
        self._map_sigma_m = config.map_sigma_m
        self._lens_variance = config.lens_sigma_px**2
        rotation_cn = matrix_from_quat(pose.q_nc).T
        covariance_n = timed_covariance(pose, rates, config.latency_sigma_s)
        covariance_n[2, 2] += config.ground_sigma_m**2
        turn = _both(rotation_cn)
        covariance_c = turn @ covariance_n @ turn.T
        self._axis_variance = covariance_c[5, 5]
        self._weights = _weights(covariance_c)
        # a point's level error: as much along all axes less that along the vertical
        down_c = rotation_cn[:, 2]
        self._level_c = (np.eye(3) - np.outer(down_c, down_c))[_ROWS, _COLUMNS]

    def covariance(self, rays: Array, sigma_m: Array | float | None = None) -> ScreenCovariance:
        """Covariances of the points' pixels; rays (3, N)."""
        uu, uv, vv, linear = self._by_block(self._spread, rays, sigma_m)
        covariance = np.empty((len(uu), 2, 2))
        covariance[:, 0, 0], covariance[:, 1, 1] = uu, vv
        covariance[:, 0, 1] = covariance[:, 1, 0] = uv
        return ScreenCovariance(covariance, linear > 0)

    def _spread(self, rays: Array, sigma_m: Array | None) -> Array:
        """(4, N): ``_in_pixels``, and 1 where it tells the whole, else 0."""
        moves = self._moves(rays, sigma_m)
        # The second order is to the first as the depth's error to the depth: this is the turns'
        # too, by which a tangent bends. A turn about the axis bends by half its angle.
        with np.errstate(invalid="ignore"):
            linear = moves[5] + self._axis_variance / 4 <= MOST_DEPTH_SIGMA**2
        spread = _on_plane(rays, moves)
        inside, scale = self._outermost(rays, spread)
        near_and_far = np.array([rays[:2], rays[:2] * scale])
        slopes = np.array(self.camera.slopes(near_and_far[:, 0], near_and_far[:, 1]))
        here, change = slopes[:, 0], slopes[:, 1] - slopes[:, 0]
        bent = (change * change).sum(axis=0) > MOST_BEND**2 * (here * here).sum(axis=0)
        linear &= inside & ~bent
        return np.array([*self._in_pixels(spread, tuple(here)), linear])

    def radius_95(self, rays: Array, sigma_m: Array | float | None = None) -> Array:
        """(N,) major semi-axis of the ellipse of 95 %, px."""
        uu, uv, vv = self._by_block(self._variances, rays, sigma_m)
        longest = (uu + vv) / 2 + np.hypot((uu - vv) / 2, uv)
        return np.asarray(np.sqrt(CHI2_95 * np.maximum(longest, 0.0)))

    def _variances(self, rays: Array, sigma_m: Array | None) -> Array:
        slopes = self.camera.slopes(rays[0], rays[1])
        return np.array(self._in_pixels(_on_plane(rays, self._moves(rays, sigma_m)), slopes))

    @staticmethod
    def _by_block(
        work: Callable[[Array, Array | None], Array], rays: Array, sigma_m: Array | float | None
    ) -> Array:
        """What ``work`` makes of the points, in pieces that stay in the processor's cache."""
        count = rays.shape[1]
        if count <= _BLOCK and sigma_m is None:
            return work(rays, None)
        sigma = None if sigma_m is None else np.broadcast_to(np.asarray(sigma_m, float), count)
        parts = [slice(start, start + _BLOCK) for start in range(0, max(count, 1), _BLOCK)]
        done = [work(rays[:, part], None if sigma is None else sigma[part]) for part in parts]
        return np.concatenate(done, axis=-1)

    def half_width_95(
        self, rays: Array, normals: Array, sigma_m: Array | float | None = None
    ) -> Array:
        """(N,) px to both sides of a line that hold 95 %; its unit normals (2, N) in pixels."""
        uu, uv, vv = self._by_block(self._variances, rays, sigma_m)
        u, v = normals
        across = u * u * uu + 2 * u * v * uv + v * v * vv
        return np.asarray(SIGMAS_95 * np.sqrt(np.maximum(across, 0.0)))

    def _moves(self, rays: Array, sigma_m: Array | None) -> Array:
        """(6, N) covariance of how points move in c, over their depth: its upper triangle."""
        factors = np.ones((4, rays.shape[1]))
        factors[:2], factors[3] = rays[:2], rays[2]
        products = factors[_FIRST] * factors[_SECOND]
        least, beyond = self._map_variance(sigma_m)
        weights = self._weights.copy()
        weights[:, -1] += least * self._level_c
        moves = weights @ products
        if beyond is not None:
            moves += self._level_c[:, None] * (beyond * products[-1])
        return np.asarray(moves, float)

    def _map_variance(self, sigma_m: Array | None) -> tuple[float, Array | None]:
        """The least variance of the points' level places, m2, and (N,) what some have beyond."""
        if sigma_m is None or not len(sigma_m):
            return self._map_sigma_m**2, None
        variance = np.where(np.isnan(sigma_m), self._map_sigma_m, sigma_m) ** 2
        least = float(variance.min())
        return least, variance - least if (variance > least).any() else None

    def _in_pixels(self, spread: Spread, slopes: Slopes) -> Spread:
        """(N,) each: variance of the column, covariance, variance of the row, px2."""
        xx, xy, yy = spread
        ux, uy, vx, vy = slopes
        u_x, u_y = ux * xx + uy * xy, ux * xy + uy * yy  # the column's covariance with x and y
        v_x, v_y = vx * xx + vy * xy, vx * xy + vy * yy
        lens = self._lens_variance
        return u_x * ux + u_y * uy + lens, u_x * vx + u_y * vy, v_x * vx + v_y * vy + lens

    def _outermost(self, rays: Array, spread: Spread) -> tuple[BoolArray, Array]:
        """(N,) whether the ellipse lies where the lens model holds, and where its outermost point.

        That is so many times as far from the axis; a lens bends more the farther from its axis.
        """
        x, y = rays[:2]
        xx, xy, yy = spread
        squared = np.maximum(x * x + y * y, _LEAST_RADIUS2)
        radial = np.maximum(x * x * xx + 2 * x * y * xy + y * y * yy, 0.0)
        outwards = np.sqrt(CHI2_95 * radial) / squared
        farthest = squared * (1 + 2 * outwards) + CHI2_95 * (xx + yy)
        with np.errstate(invalid="ignore"):
            inside = farthest <= self.camera.max_radius**2
        return np.asarray(inside), np.where(inside, 1 + outwards, 1.0)


def _both(rotation: Array) -> Array:
    """(6, 6) that turns position and phi alike."""
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = rotation
    return turn


def _weights(covariance_c: Array) -> Array:
    """(6, 10): of the products of x, y, 1 and 1/z, in the covariance of points' moves."""
    parts = (_MOVES_ROWS @ covariance_c @ _MOVES_ROWS.T).ravel()
    return np.asarray(_TIMES * (parts[_PART] + parts[_MIRRORED]), float)


def _on_plane(rays: Array, moves: Array) -> Spread:
    """Variance of x, covariance of x and y, variance of y on the plane z = 1.

    x moves by the point's move along x less x times that along z, both over the depth.
    """
    x, y = rays[:2]
    xx, xy, xz, yy, yz, zz = moves
    x_z, y_z = xz - x * zz, yz - y * zz
    return xx - x * (xz + x_z), xy - x * yz - y * x_z, yy - y * (yz + y_z)


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
