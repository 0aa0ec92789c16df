"""A located ground point with all that a person or a program asks of it, or the refusal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.model import Camera
from tirgeo_ros.core.camera.projection_covariance import CHI2_95, CameraRates, timed_covariance
from tirgeo_ros.core.config.pictures import ConfidenceConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, Reason, locate
from tirgeo_ros.core.ground.ground_point_covariance import point_covariance
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

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
    """Whether a pixel is in the picture; the first one's centre is (0, 0)."""
    return -0.5 <= uv[0] <= camera.width - 0.5 and -0.5 <= uv[1] <= camera.height - 0.5


def _timed(pose: CameraPose, rates: CameraRates | None, config: ConfidenceConfig) -> Array | None:
    """The pose's covariance (6, 6) with that of the time in it; None where it is none."""
    if not math.isfinite(pose.covariance.sum()):
        return None
    covariance = timed_covariance(pose, rates, config.latency_sigma_s)
    return covariance if math.isfinite(covariance.sum()) else None


def ellipse_of(covariance_n: Array) -> Ellipse:
    """The horizontal ellipse of 95 % of a covariance (3, 3), NED, m2."""
    (north, across), (_, east) = covariance_n[:2, :2].tolist()
    middle, reach = (north + east) / 2, math.hypot((north - east) / 2, across)
    major, minor = (math.sqrt(CHI2_95 * max(x, 0.0)) for x in (middle + reach, middle - reach))
    return Ellipse(major, minor, math.atan2(2 * across, north - east) / 2 % math.pi)
