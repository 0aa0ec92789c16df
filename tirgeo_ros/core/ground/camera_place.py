"""Describe where a camera was and how it was turned, in north, east, down at its own place.

Two conventions of angles are in use, both applied yaw, pitch, roll (z-y-x, intrinsic):

``rpy``
    Those of the camera's body (forward, right, down), as of an aircraft, and as DJI gives its
    gimbals': a level camera that looks north has 0, 0, 0; one that looks straight down has the
    pitch -90 deg, where yaw and roll are not defined apart.
``mapping_rpy``
    Those of a level aircraft in which the camera looks straight down with the picture's top to
    the nose, as Pix4D defines them: straight down with the top to the north is 0, 0, 0; a level
    camera has the pitch 90 deg, where yaw and roll are not defined apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.frames.axes import BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import euler_from_matrix, matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.poses import BodyPose, CameraPose

#: ``R_mc``: optical frame (right, down, forward) to the aircraft of ``mapping_rpy``.
_MAPPING_OPTICAL = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
#: Nearer to the pitch at which yaw and roll fall together (cosine), their sigmas mean nothing.
_LEAST_COSINE = 0.05
_STEEP = math.cos(math.radians(10))  # steeper than this, the optical axis' heading is ill-defined


@dataclass(frozen=True, slots=True)
class CameraPlace:
    """Hold a camera's place and attitude in the axes ``l``: north, east, down at the camera."""

    latitude_rad: float
    longitude_rad: float
    height_m: float  # ellipsoidal
    rotation_lc: Array  # (3, 3), from the optical frame
    covariance_l: Array  # (6, 6) position m2, attitude phi rad2; nan if it is not known

    @property
    def rpy(self) -> Vector:
        """Return roll, pitch and yaw of the camera's body, rad."""
        return rpy_of(self.rotation_lc @ BODY_OPTICAL.T)

    @property
    def mapping_rpy(self) -> Vector:
        """Return roll, pitch and yaw as photogrammetry has them, rad: 0 is straight down."""
        return rpy_of(self.rotation_lc @ _MAPPING_OPTICAL.T)

    def altitude_m(self, undulation_m: float) -> float:
        """Return the height above sea level; the ellipsoidal one if the undulation is nan.

        The undulation is that of the geoid: ellipsoidal height less height above sea level.
        """
        return self.height_m - undulation_m if math.isfinite(undulation_m) else self.height_m

    @property
    def position_sigmas_m(self) -> Vector:
        """Return the standard deviations north, east and down; nan if they are not known."""
        north, east, down = np.sqrt(self.covariance_l.diagonal()[:3]).tolist()
        return north, east, down

    @property
    def mapping_sigmas_rad(self) -> Vector:
        """Return the standard deviations of ``mapping_rpy``.

        They are nan where they are not known, and near the pitch 90 deg. An error phi of the
        attitude is the sum of turns about the axes of yaw (down), pitch (the nose's right, level)
        and roll (the nose).
        """
        _, pitch, yaw = self.mapping_rpy
        if abs(math.cos(pitch)) < _LEAST_COSINE:
            return math.nan, math.nan, math.nan
        nose_l = (self.rotation_lc @ _MAPPING_OPTICAL.T)[:, 0]
        axes_l = np.stack([nose_l, [-math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]], axis=1)
        by_phi = np.linalg.inv(axes_l)
        variances = (by_phi @ self.covariance_l[3:, 3:] @ by_phi.T).diagonal()
        roll, pitch_sigma, yaw_sigma = np.sqrt(variances).tolist()
        return roll, pitch_sigma, yaw_sigma


def camera_place(pose: CameraPose, plane: TangentPlane) -> CameraPlace:
    """Return the place and the attitude of a camera whose pose is in ``plane``."""
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(pose.position_n))
    to_local = plane.rotation_from_local(latitude, longitude).T
    both = np.kron(np.eye(2), to_local)
    rotation_lc = to_local @ matrix_from_quat(pose.q_nc)
    covariance_l = both @ pose.covariance @ both.T
    return CameraPlace(latitude, longitude, height_m, rotation_lc, covariance_l)


def body_rpy(body: BodyPose, plane: TangentPlane) -> Vector:
    """Return the aircraft's roll, pitch and heading, rad, against north, east, down at it."""
    latitude, longitude, _ = (float(x) for x in plane.geodetic_from_ned(body.position_n))
    to_local = plane.rotation_from_local(latitude, longitude).T
    return rpy_of(to_local @ matrix_from_quat(body.q_nb))


def height_above_m(pose: CameraPose, plane: TangentPlane, ground: Ground | None) -> float:
    """Return the camera's height, m, over the ground below.

    It is nan without a ground, and where the elevation model has no height.
    """
    if ground is None:
        return math.nan
    if isinstance(ground, Terrain):
        latitude, longitude, height = plane.geodetic_from_ned(pose.position_n)
        return float(height - ground.height_m(latitude, longitude))
    # The ellipsoid curves away from the plane. Its radius of curvature differs by less than 1 %
    # from place to place, which is 1 cm of height 4 km from the map's origin.
    north, east, down = pose.position_n.tolist()
    away2 = north * north + east * east
    return float(plane.height_m - down + away2 / (2 * SEMI_MAJOR_AXIS_M) - ground)


def rpy_of(rotation: Array) -> Vector:
    """Return roll, pitch and yaw of a rotation (3, 3), rad."""
    roll, pitch, yaw = euler_from_matrix(rotation).tolist()
    return roll, pitch, yaw


def camera_heading_rad(pose: CameraPose) -> float:
    """Return the camera's heading: 0 is north, clockwise, 0 to 2 pi.

    It is the azimuth of the optical axis. As the axis comes within 10 degrees of straight down,
    the azimuth of the picture's upper edge gains weight.
    """
    rotation_nc = matrix_from_quat(pose.q_nc)
    ahead, up = rotation_nc[:, 2], -rotation_nc[:, 1]
    steep = min(max((ahead[2] - _STEEP) / (1 - _STEEP), 0.0), 1.0)
    north, east = ahead[:2] + steep * up[:2]
    return math.atan2(east, north) % (2 * math.pi) % (2 * math.pi)  # -1e-20 becomes 2 pi, then 0
