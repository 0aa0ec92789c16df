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
"""Locate the ground point at a pixel, with its covariance and coordinates, or refuse it.

The point has errors from the pose, the time, the lens and the ground. Let dc be the error of the
camera's position and phi that of its attitude. The end of the ray, at d from the camera, then has
the error w = dc - d x phi. Let e be its error across the ray from the lens, and dh the error of
the ground's height, along up. The true point lies both on the displaced ray, of direction r, and
on the displaced ground, of normal m:

    d_point = P (w + e) + r (m . up) / (m . r) dh,    P = I - r m^T / (m . r).

This is of first order. The ground's normal is measured over the length of the error itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates, ellipse_95, timed_covariance
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import ENU_NED, matrix_from_quat, skew
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, Reason, Slopes, Terrain, locate
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.core.types.poses import CameraPose

#: A point is refused if the major semi-axis of its 95 % ellipse exceeds this share of its
#: distance: the first-order ellipse is then too small, because the true errors have a long tail
#: away from the camera.
MOST_SHARE = 0.5
_NO_COVARIANCE = np.full((3, 3), np.nan)
#: 90 % of a normal distribution lie within this many standard deviations.
_LINEAR_90 = 1.6448536269514722
#: 90 % of a circular normal distribution lie within this many standard deviations of an axis.
_CIRCULAR_90 = math.sqrt(-2 * math.log(0.1))
_CE_ANGLES = (np.arange(32) + 0.5) * (math.pi / 64)
_CE_STEPS = 6
#: Corners of the polygon of an ellipse: it is within 0.15 % of the curve.
CORNERS = 60
#: Largest height and variance of a point on the ground, and the end of the range of stamps, ns.
_MOST_M, MOST_M2 = 1e5, 1e8
_NS = 1 << 63


class Ellipse(NamedTuple):
    """Hold the horizontal ellipse that contains the true position with a probability of 95 %."""

    major_m: float  # semi-axes
    minor_m: float
    azimuth_rad: float  # of the major axis, from north clockwise, 0 to pi


@dataclass(frozen=True, slots=True)
class Located:
    """Hold a ground point located at a pixel of a picture, or the average of several points.

    Points are equal if their stamps, coordinates and covariances are.
    """

    stamp_ns: int  # of the picture; for an average, of the newest picture
    latitude_deg: float
    longitude_deg: float
    height_m: float  # ellipsoidal
    covariance_enu: tuple[float, ...]  # 9 numbers, m2, row by row: east, north, up
    uv: tuple[float, float] = field(default=(math.nan, math.nan), compare=False)  # column, row
    #: (3,) NED in the map's plane in which it was located, m; nan for any other point. The
    #: covariance is in the axes of that plane: the axes at the point differ by 1e-3 rad at 6 km
    #: from the plane's origin, which is negligible in a covariance.
    point_n: Array = field(default_factory=lambda: np.full(3, math.nan), compare=False)
    temperature_c: float = field(default=math.nan, compare=False)  # at the pixel; nan: unknown

    @property
    def latitude_rad(self) -> float:
        """Return the latitude, rad."""
        return math.radians(self.latitude_deg)

    @property
    def longitude_rad(self) -> float:
        """Return the longitude, rad."""
        return math.radians(self.longitude_deg)

    @property
    def covariance_n(self) -> Array:
        """Return the covariance (3, 3), m2, in north, east, down."""
        return np.asarray(ENU_NED @ np.reshape(self.covariance_enu, (3, 3)) @ ENU_NED)

    @property
    def plane(self) -> TangentPlane:
        """Return the tangent plane at the point."""
        return TangentPlane(self.latitude_rad, self.longitude_rad, self.height_m)

    @property
    def ellipse(self) -> Ellipse:
        """Return the horizontal 95 % ellipse."""
        return ellipse_of(self.covariance_n)

    @property
    def label(self) -> str:
        """Return the label: latitude, longitude (deg, to 0.1 m) and the major semi-axis."""
        major_m = self.ellipse.major_m
        return (
            f"{self.latitude_deg:.6f} {self.longitude_deg:.6f} \N{PLUS-MINUS SIGN}{major_m:.1f} m"
        )

    @property
    def fault(self) -> str:
        """Return which numbers cannot be those of a ground point, or "" if all can."""
        covariance = self.covariance_enu
        right = (
            abs(self.stamp_ns) < _NS
            and abs(self.latitude_deg) <= 90
            and abs(self.longitude_deg) <= 180
            and abs(self.height_m) <= _MOST_M
            and len(covariance) == 9
            and all(abs(number) <= MOST_M2 for number in covariance)
            and min(covariance[::4]) >= 0
        )
        numbers = self.stamp_ns, self.latitude_deg, self.longitude_deg, self.height_m, covariance
        return "" if right else f"not a located point: {shown(numbers, 300)}"

    def outline(self, corners: int = CORNERS) -> list[tuple[float, float]]:
        """Return the 95 % ellipse as ``corners`` + 1 places (latitude, longitude), deg.

        Anticlockwise seen from above, closed, rounded to a tenth of a millimetre.
        """
        ellipse = self.ellipse
        turn = np.linspace(0, -2 * math.pi, corners + 1)
        along, across = ellipse.major_m * np.cos(turn), ellipse.minor_m * np.sin(turn)
        cos, sin = math.cos(ellipse.azimuth_rad), math.sin(ellipse.azimuth_rad)
        offsets_n = np.stack([along * cos - across * sin, along * sin + across * cos, 0 * turn], 1)
        offsets_n[-1] = offsets_n[0]
        latitude, longitude, _ = self.plane.geodetic_from_ned(offsets_n)
        places = np.round(np.degrees(np.stack([latitude, longitude], axis=1)), 9)
        return [(north, east) for north, east in places.tolist()]


@dataclass(frozen=True, slots=True)
class Refusal:
    """Hold the reason why a pixel has no ground point."""

    stamp_ns: int  # of the requested picture
    uv: tuple[float, float]
    reason: Reason


#: The result for a click, or for one pixel of a list.
Answer: TypeAlias = Located | Refusal


def place(
    camera: Camera,
    pose: CameraPose,
    uv: tuple[float, float],
    plane: TangentPlane,
    ground: Ground,
    config: ConfidenceConfig,
    rates: CameraRates | None = None,
) -> Answer:
    """Return the ground point at a pixel of the picture that ``camera`` took at ``pose``.

    A pixel without a ground point, or with one that is too uncertain, gives a Refusal.
    ``pose`` is in ``plane``, with its covariance. Its stamp becomes the result's stamp; a caller
    that corrects the latency sets it before. ``rates`` is the camera's motion at the exposure;
    without it the time of exposure counts as exact. ``config`` gives the other sigmas.
    """
    if not (-0.5 <= uv[0] <= camera.width - 0.5 and -0.5 <= uv[1] <= camera.height - 0.5):
        return Refusal(pose.stamp_ns, uv, Reason.OUTSIDE_PICTURE)
    points_n, reasons = locate(camera, pose, np.array([uv]), plane, ground)
    if reasons[0] is not None:
        return Refusal(pose.stamp_ns, uv, reasons[0])
    timed = pose.covariance
    if math.isfinite(timed.sum()):
        timed = timed_covariance(pose, rates, config.latency_sigma_s)
    if not math.isfinite(timed.sum()):
        return Refusal(pose.stamp_ns, uv, Reason.UNCERTAIN_POSE)
    point_n = points_n[0]
    covariance_n = point_covariance(camera, pose, timed, point_n, plane, ground, config)
    distance_m = math.dist(point_n.tolist(), pose.position_n.tolist())
    if not ellipse_of(covariance_n).major_m <= MOST_SHARE * distance_m:
        return Refusal(pose.stamp_ns, uv, Reason.GRAZING)
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(point_n))
    degrees = math.degrees(latitude), math.degrees(longitude)
    return Located(pose.stamp_ns, *degrees, height_m, enu_of(covariance_n), uv, point_n)


def enu_of(covariance_n: Array) -> tuple[float, ...]:
    """Return a covariance (3, 3), NED, as 9 numbers row by row: east, north, up."""
    return tuple((ENU_NED @ covariance_n @ ENU_NED).ravel().tolist())


def ellipse_of(covariance_n: Array) -> Ellipse:
    """Return the horizontal 95 % ellipse of a covariance (3, 3), NED, m2."""
    semi_axes, azimuth = ellipse_95(covariance_n[:2, :2])
    major_m, minor_m = semi_axes[0].tolist()
    return Ellipse(major_m, minor_m, float(azimuth[0]) % math.pi)


def point_covariance(
    camera: Camera,
    pose: CameraPose,
    timed: Array,
    point_n: Array,
    plane: TangentPlane,
    ground: Ground,
    config: ConfidenceConfig,
) -> Array:
    """Return the covariance (3, 3), m2, of a located point (3,), both NED in the map's plane.

    ``timed`` (6, 6) is the pose's covariance plus that of the time error, finite. On an elevation
    model the slope is measured over two cells, or over the length of the error itself if that is
    longer. The result is nan if the ray is parallel to the ground.
    """
    offset_n = point_n - pose.position_n
    off_ray = _off_ray(camera, pose, timed, offset_n, config)
    latitude, longitude, _ = (float(x) for x in plane.geodetic_from_ned(point_n))
    axes_n = plane.rotation_from_local(latitude, longitude)
    up_n, sigma_m = -axes_n[:, 2], config.ground_sigma_m
    if not isinstance(ground, Terrain):
        return _on_ground(off_ray, offset_n, up_n, up_n, sigma_m)
    slopes = Slopes(ground, latitude, longitude, axes_n)
    covariance_n = _on_ground(off_ray, offset_n, slopes.normal_n(slopes.cell_m), up_n, sigma_m)
    spread = float(covariance_n[0, 0] + covariance_n[1, 1])
    if not spread > (2 * slopes.cell_m) ** 2:  # "not >" also catches nan
        return covariance_n
    # Over the length of the error, but at most a tenth of the distance: one slope cannot describe
    # the terrain over more.
    step_m = min(math.sqrt(spread), 0.1 * math.hypot(*offset_n.tolist()))
    return _on_ground(off_ray, offset_n, slopes.normal_n(step_m), up_n, sigma_m)


def _off_ray(
    camera: Camera, pose: CameraPose, timed: Array, offset_n: Array, config: ConfidenceConfig
) -> Array:
    """Return the covariance (3, 3) of the ray's end, without the error of the ground.

    The end is at ``offset_n`` (3,) from the camera. The errors of the lens and of the focal
    length, in pixels, are converted to the plane through the point, perpendicular to the optical
    axis. Their component along the ray has no effect.
    """
    rotation_nc = matrix_from_quat(pose.q_nc)
    x, y, depth_m = (offset_n @ rotation_nc).tolist()
    ux, uy, vx, vy = camera.slopes(x / depth_m, y / depth_m)
    share = depth_m / (ux * vy - uy * vx)
    across_n = rotation_nc[:, :2] @ (share * np.array([[vy, -uy], [-vx, ux]]))
    moved = np.hstack([np.eye(3), -skew(offset_n)])
    of_lens = config.lens_sigma_px**2 * (across_n @ across_n.T)
    if config.focal_sigma:
        u, v = camera.pixels(np.array(x / depth_m), np.array(y / depth_m)).tolist()
        radial_n = across_n @ (config.focal_sigma * np.array([u - camera.cx, v - camera.cy]))
        of_lens += radial_n[:, None] * radial_n
    return np.asarray(moved @ timed @ moved.T + of_lens)


def _on_ground(
    off_ray: Array, offset_n: Array, normal_n: Array, up_n: Array, ground_sigma_m: float
) -> Array:
    """Return the covariance (3, 3) of the point where the ray meets the ground."""
    fall = float(normal_n @ offset_n)
    if not abs(fall) > 0:
        return _NO_COVARIANCE
    along_n = offset_n / fall
    on_ground = np.eye(3) - along_n[:, None] * normal_n
    raised_n = (ground_sigma_m * float(normal_n @ up_n)) * along_n
    covariance = on_ground @ off_ray @ on_ground.T + raised_n[:, None] * raised_n
    return np.asarray(0.5 * (covariance + covariance.T))


def linear_error_90(covariance_n: Array) -> float:
    """Return LE90, m: with 90 %, a height is within plus or minus this of the true height.

    ``covariance_n`` (3, 3) is that of a point, NED, m2.
    """
    return _LINEAR_90 * math.sqrt(covariance_n[2, 2])


def circular_error_90(covariance_n: Array) -> float:
    """Return CE90, m: the radius about a point that contains the true position with 90 %.

    ``covariance_n`` (3, 3) is that of the point, NED, m2. For semi-axes 1 and c of the ellipse of
    one sigma, the radius k solves 1 - mean(exp(-k^2 / 2 s^2)) = 0.9, with the mean over all
    directions t and s^2 = cos^2 t + c^2 sin^2 t. Newton's method, from c = 1.
    """
    minor, major = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance_n[:2, :2]), 0.0)).tolist()
    if not major > 0:
        return float(major)
    squares = np.cos(_CE_ANGLES) ** 2 + (minor / major * np.sin(_CE_ANGLES)) ** 2
    k = _CIRCULAR_90
    for _ in range(_CE_STEPS):
        outside = np.exp(-(k**2) / (2 * squares))
        k += (float(outside.mean()) - 0.1) / (k * float((outside / squares).mean()))
    return float(major) * k
