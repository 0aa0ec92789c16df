"""Locate the ground point at a pixel, with its covariance and coordinates, or refuse it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import (
    CameraRates,
    ellipse_95,
    timed_covariance,
)
from tirgeo_ros.core.config.overlay import ConfidenceConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, Reason, locate
from tirgeo_ros.core.ground.ground_point_covariance import point_covariance
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

#: A point is refused if the major semi-axis of its 95 % ellipse exceeds this share of its
#: distance: then the first-order ellipse is too small, as the true errors have a long tail away
#: from the camera.
MOST_SHARE = 0.5


class Ellipse(NamedTuple):
    """Hold the horizontal ellipse that contains the true position with a probability of 95 %."""

    major_m: float  # semi-axes
    minor_m: float
    azimuth_rad: float  # of the major axis, from north clockwise, 0 to pi


@dataclass(frozen=True, slots=True)
class Located:
    """Hold a ground point that was located at a pixel of a picture."""

    stamp_ns: int  # of the picture
    uv: tuple[float, float]  # column, row
    point_n: Array  # (3,) NED in the map's plane, m
    #: (3, 3) m2, in the axes of the map's plane. The local NED axes at the point differ by 1e-3
    #: rad at 6 km from the plane's origin, which is negligible in a covariance.
    covariance_n: Array
    latitude_rad: float
    longitude_rad: float
    height_m: float  # ellipsoidal

    @property
    def ellipse(self) -> Ellipse:
        """Return the horizontal 95 % ellipse."""
        return ellipse_of(self.covariance_n)

    @property
    def label(self) -> str:
        """Return the label for the picture: latitude, longitude (deg, 0.1 m), major semi-axis."""
        latitude, longitude = math.degrees(self.latitude_rad), math.degrees(self.longitude_rad)
        return f"{latitude:.6f} {longitude:.6f} \N{PLUS-MINUS SIGN}{self.ellipse.major_m:.1f} m"


@dataclass(frozen=True, slots=True)
class Refusal:
    """Hold the reason why a pixel has no ground point."""

    stamp_ns: int  # of the requested picture
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
    """Return the ground point at a pixel of the picture that ``camera`` took at ``pose``.

    A pixel without a ground point, or with one that is too uncertain, gives a Refusal.
    ``pose`` is in ``plane``, with its covariance. Its stamp becomes the result's stamp; a caller
    that corrects the latency sets it before. ``rates`` is the camera's motion at the exposure;
    without it the time of exposure counts as exact. ``config`` gives the other sigmas.
    """
    if not _is_inside(camera, uv):
        return Refusal(pose.stamp_ns, uv, Reason.OUTSIDE_PICTURE)
    points_n, reasons = locate(camera, pose, np.array([uv]), plane, ground)
    if reasons[0] is not None:
        return Refusal(pose.stamp_ns, uv, reasons[0])
    timed = _timed(pose, rates, config)
    if timed is None:
        return Refusal(pose.stamp_ns, uv, Reason.UNCERTAIN_POSE)
    point_n = points_n[0]
    covariance_n = point_covariance(camera, pose, timed, point_n, plane, ground, config)
    distance_m = math.dist(point_n.tolist(), pose.position_n.tolist())
    if not ellipse_of(covariance_n).major_m <= MOST_SHARE * distance_m:
        return Refusal(pose.stamp_ns, uv, Reason.GRAZING)
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(point_n))
    return Located(pose.stamp_ns, uv, point_n, covariance_n, latitude, longitude, height_m)


def _is_inside(camera: Camera, uv: tuple[float, float]) -> bool:
    """Return whether a pixel is in the picture; (0, 0) is the centre of the first pixel."""
    return -0.5 <= uv[0] <= camera.width - 0.5 and -0.5 <= uv[1] <= camera.height - 0.5


def _timed(pose: CameraPose, rates: CameraRates | None, config: ConfidenceConfig) -> Array | None:
    """Return the pose's covariance (6, 6) plus that of the time; None if it is not usable."""
    if not math.isfinite(pose.covariance.sum()):
        return None
    covariance = timed_covariance(pose, rates, config.latency_sigma_s)
    return covariance if math.isfinite(covariance.sum()) else None


def ellipse_of(covariance_n: Array) -> Ellipse:
    """Return the horizontal 95 % ellipse of a covariance (3, 3), NED, m2."""
    semi_axes, azimuth = ellipse_95(covariance_n[:2, :2])
    major, minor = semi_axes[0].tolist()
    return Ellipse(major, minor, float(azimuth[0]) % math.pi)
