"""A located ground point with all that a person or a program asks of it, or the refusal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.confidence import (
    CHI2_95,
    CameraRates,
    pixel_jacobian,
    timed_covariance,
)
from tirgeo_ros.core.config.pictures import ConfidenceConfig
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.locating import Ground, Reason, locate
from tirgeo_ros.core.samples import Array, CameraPose
from tirgeo_ros.core.terrain import Terrain
from tirgeo_ros.core.terrain_slopes import Slopes

#: A point whose ellipse of 95 % is longer than this share of its distance is refused: beyond,
#: the ellipse of first order says less than the truth, which has a long tail away from the camera.
MOST_SHARE = 0.5


class Ellipse(NamedTuple):
    """The horizontal ellipse that holds 95 % of the true places."""

    major_m: float  # semi-axes
    minor_m: float
    azimuth_rad: float  # of the major one, from north clockwise, 0 to pi


@dataclass(frozen=True, slots=True)
class Located:
    """A ground point seen at a pixel of a picture."""

    stamp_ns: int  # of the picture
    uv: tuple[float, float]  # column, row
    point_n: Array  # (3,) NED in the map's plane, m
    #: (3, 3) m2 along the axes of the map's plane. Those at the point itself are turned from them
    #: by 1e-3 rad at 6 km from its origin: nothing in a covariance.
    covariance_n: Array
    latitude_rad: float
    longitude_rad: float
    height_m: float  # ellipsoidal

    @property
    def ellipse(self) -> Ellipse:
        """The horizontal ellipse of 95 %."""
        return ellipse_of(self.covariance_n)

    @property
    def label(self) -> str:
        """Latitude, longitude (deg, 0.1 m) and the ellipse's major semi-axis, for the picture."""
        latitude, longitude = math.degrees(self.latitude_rad), math.degrees(self.longitude_rad)
        return f"{latitude:.6f} {longitude:.6f} \N{PLUS-MINUS SIGN}{self.ellipse.major_m:.1f} m"


@dataclass(frozen=True, slots=True)
class Refusal:
    """A pixel that is located nowhere."""

    stamp_ns: int  # of the picture that was asked for
    uv: tuple[float, float]
    reason: Reason


def place(
    camera: Camera,
    pose: CameraPose,
    uv: tuple[float, float],
    plane: TangentPlane,
    ground: Ground,
    config: ConfidenceConfig,
    rates: CameraRates | None = None,
) -> Located | Refusal:
    """The ground point at a pixel of the picture that ``camera`` made at ``pose``.

    ``pose`` is in ``plane``, with its covariance; its stamp becomes the answer's, so that a caller
    with another latency sets it. ``rates`` are the camera's then: without them the time of
    exposure counts as exact. ``config`` gives the other sigmas.
    """
    if not _is_inside(camera, uv):
        return Refusal(pose.stamp_ns, uv, Reason.OUTSIDE_PICTURE)
    points_n, reasons = locate(camera, pose, np.array([uv]), plane, ground)
    if reasons[0] is not None:
        return Refusal(pose.stamp_ns, uv, reasons[0])
    if not _is_covariance(pose):
        return Refusal(pose.stamp_ns, uv, Reason.UNCERTAIN_POSE)
    covariance_n = point_covariance(camera, pose, points_n[0], plane, ground, config, rates)
    distance_m = float(np.linalg.norm(points_n[0] - pose.position_n))
    if not ellipse_of(covariance_n).major_m <= MOST_SHARE * distance_m:
        return Refusal(pose.stamp_ns, uv, Reason.GRAZING)
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(points_n[0]))
    return Located(pose.stamp_ns, uv, points_n[0], covariance_n, latitude, longitude, height_m)


def _is_inside(camera: Camera, uv: tuple[float, float]) -> bool:
    """Whether a pixel is in the picture; the first one's centre is (0, 0)."""
    return -0.5 <= uv[0] <= camera.width - 0.5 and -0.5 <= uv[1] <= camera.height - 0.5


def _is_covariance(pose: CameraPose) -> bool:
    finite = bool(np.isfinite(pose.covariance).all())
    return finite and bool(np.isfinite(timed_covariance(pose, None, 0.0)).all())


def point_covariance(
    camera: Camera,
    pose: CameraPose,
    point_n: Array,
    plane: TangentPlane,
    ground: Ground,
    config: ConfidenceConfig,
    rates: CameraRates | None = None,
) -> Array:
    """Covariance (3, 3) in m2 of a located point (3,), both NED in the map's plane.

    The pixel is where it is and the point on the ground, whatever pose, lens and ground truly are:
    with u the pixel and m the ground's normal, du = J_pose d_pose + J_point d_point and
    m . d_point = m . up dh are solved for d_point. To first order, with the terrain's slope over
    the length of the error itself where that is longer than two cells.
    """
    covariance = timed_covariance(pose, rates, config.latency_sigma_s)
    by_pose, by_point = (j[0] for j in pixel_jacobian(camera, pose, point_n[None]))
    in_pixels = by_pose @ covariance @ by_pose.T + config.lens_sigma_px**2 * np.eye(2)
    latitude, longitude, _ = plane.geodetic_from_ned(point_n)
    axes_n = plane.rotation_from_local(float(latitude), float(longitude))
    up_n, sigma_m = -axes_n[:, 2], config.ground_sigma_m
    if not isinstance(ground, Terrain):
        return _solved(by_point, in_pixels, up_n, up_n, sigma_m)
    slopes = Slopes(ground, plane, point_n, axes_n)
    found = _solved(by_point, in_pixels, slopes.normal_n(slopes.cell_m), up_n, sigma_m)
    spread = float(found[0, 0] + found[1, 1])
    if not spread > (2 * slopes.cell_m) ** 2:  # nor where it is nan
        return found
    # As far as the point may truly be away, and no further than could pass for one slope.
    step_m = min(math.sqrt(spread), 0.1 * float(np.linalg.norm(point_n - pose.position_n)))
    return _solved(by_point, in_pixels, slopes.normal_n(step_m), up_n, sigma_m)


def _solved(
    by_point: Array, in_pixels: Array, normal_n: Array, up_n: Array, ground_sigma_m: float
) -> Array:
    """(3, 3): the covariance of the point; nan where pixel and ground do not fix it."""
    system = np.vstack([by_point, normal_n])
    known = np.zeros((3, 3))
    known[:2, :2] = in_pixels
    known[2, 2] = (ground_sigma_m * float(normal_n @ up_n)) ** 2
    try:
        inverse = np.linalg.inv(system)
    except np.linalg.LinAlgError:
        return np.full((3, 3), np.nan)
    covariance: Array = inverse @ known @ inverse.T
    return 0.5 * (covariance + covariance.T)


def ellipse_of(covariance_n: Array) -> Ellipse:
    """The horizontal ellipse of 95 % of a covariance (3, 3), NED, m2."""
    variances, axes = np.linalg.eigh(covariance_n[:2, :2])
    minor, major = np.sqrt(CHI2_95 * np.maximum(variances, 0.0)).tolist()
    return Ellipse(major, minor, math.atan2(axes[1, 1], axes[0, 1]) % math.pi)
