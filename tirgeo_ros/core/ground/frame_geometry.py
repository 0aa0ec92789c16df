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
"""Describe where a camera was, how it was turned, and what its picture shows of the ground.

Two conventions of angles are in use, both applied yaw, pitch, roll (z-y-x, intrinsic):

``rpy``
    The angles of the camera's body axes (forward, right, down), as for an aircraft, and as DJI
    reports a gimbal's: a level camera that looks north has 0, 0, 0. A camera that looks straight
    down has the pitch -90 deg; only the sum of yaw and roll is then defined.
``mapping_rpy``
    The angles of an aircraft to which the camera is fixed, looking straight down with the
    picture's top towards the nose, as Pix4D defines them: straight down with the top to the north
    is 0, 0, 0. A level camera has the pitch 90 deg; only yaw minus roll is then defined.

A video system's line of sight is the ray of the picture's middle, not the optical axis, which can
be degrees away: viewers assume that field of view and angles are symmetrical about the middle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import (
    BODY_OPTICAL,
    euler_axes,
    euler_from_matrix,
    matrix_from_quat,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M
from tirgeo_ros.core.ground.backprojection import Ground, Terrain, locate
from tirgeo_ros.core.ground.ground_point import Located, circular_error_90, linear_error_90, place
from tirgeo_ros.core.types.arrays import Array, BoolArray, Vector
from tirgeo_ros.core.types.poses import BodyPose, CameraPose

#: ``R_mc``: optical frame (right, down, forward) to the aircraft of ``mapping_rpy``.
_MAPPING_OPTICAL = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
#: With a smaller cosine of the pitch, yaw and roll turn about almost the same axis: no sigmas.
_LEAST_COSINE = 0.05
_STEEP = math.cos(math.radians(10))  # steeper than this, the optical axis' heading is ill-defined
# A picture's place on the ground.
_UNKNOWN: Vector = (math.nan, math.nan, math.nan)
_NO_CORNERS = np.full((4, 2), np.nan)
#: Pixels along each edge: enough for the bend of a lens and the shape of the ground.
_PER_EDGE = 8
#: Bisections of the step between two of them, to find where an edge leaves the ground in view.
_HALVINGS = 8


@dataclass(frozen=True, slots=True)
class CameraPlace:
    """Hold a camera's position and attitude in the axes ``l``: north, east, down at the camera."""

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
        """Return roll, pitch and yaw as used in photogrammetry, rad: 0 is straight down."""
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

        They are nan if unknown, and near the pitch 90 deg. An error phi of the attitude is the
        sum of turns about the axes of yaw (down), pitch (level, to the right of the nose) and
        roll (the nose).
        """
        _, pitch, yaw = self.mapping_rpy
        if abs(math.cos(pitch)) < _LEAST_COSINE:
            return math.nan, math.nan, math.nan
        by_phi = np.linalg.inv(euler_axes(pitch, yaw))
        variances = (by_phi @ self.covariance_l[3:, 3:] @ by_phi.T).diagonal()
        roll, pitch_sigma, yaw_sigma = np.sqrt(variances).tolist()
        return roll, pitch_sigma, yaw_sigma


def camera_place(pose: CameraPose, plane: TangentPlane) -> CameraPlace:
    """Return the position and the attitude of a camera whose pose is in ``plane``."""
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(pose.position_n))
    to_local = plane.rotation_from_local(latitude, longitude).T
    both = np.kron(np.eye(2), to_local)
    rotation_lc = to_local @ matrix_from_quat(pose.q_nc)
    covariance_l = both @ pose.covariance @ both.T
    return CameraPlace(latitude, longitude, height_m, rotation_lc, covariance_l)


def body_rpy(body: BodyPose, plane: TangentPlane) -> Vector:
    """Return the aircraft's roll, pitch and heading, rad, to north, east, down at the aircraft."""
    latitude, longitude, _ = (float(x) for x in plane.geodetic_from_ned(body.position_n))
    to_local = plane.rotation_from_local(latitude, longitude).T
    return rpy_of(to_local @ matrix_from_quat(body.q_nb))


def height_above_m(pose: CameraPose, plane: TangentPlane, ground: Ground | None) -> float:
    """Return the camera's height, m, over the ground below.

    It is nan if the ground is None, or if the elevation model has no height there.
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

    It is the azimuth of the optical axis. Within 10 degrees of straight down it changes gradually
    to the azimuth of the picture's upward direction.
    """
    rotation_nc = matrix_from_quat(pose.q_nc)
    ahead, up = rotation_nc[:, 2], -rotation_nc[:, 1]
    steep = min(max((ahead[2] - _STEEP) / (1 - _STEEP), 0.0), 1.0)
    north, east = ahead[:2] + steep * up[:2]
    return math.atan2(east, north) % (2 * math.pi) % (2 * math.pi)  # -1e-20 becomes 2 pi, then 0


class Sight(NamedTuple):
    """Hold a picture's camera, poses and ground at its exposure; both poses are in ``plane``."""

    camera: Camera  # of the picture as shown
    pose: CameraPose
    plane: TangentPlane
    ground: Ground  # nan if it is not known
    body: BodyPose | None = None  # None if it is not known at the exposure
    rates: CameraRates | None = None  # the camera's; None if they are not known


@dataclass(frozen=True, slots=True)
class FrameGeometry:
    """Hold a picture's geometry; unknown values are nan.

    A "place" is latitude, longitude (rad) and ellipsoidal height (m).
    """

    sensor: Vector  # place
    #: Roll, pitch and heading of the aircraft relative to north, east and down at the sensor, rad.
    platform_rpy: Vector
    #: Roll, elevation and azimuth of the line of sight in the aircraft's axes, rad: azimuth
    #: first, then elevation (up positive), then roll about the line of sight.
    sensor_rpy: Vector
    #: The same angles of the line of sight relative to north, east and down at the sensor.
    sight_rpy: Vector
    fields_of_view: tuple[float, float]  # horizontal, vertical, from edge to edge, rad
    centre: Vector  # place: the ground point in the picture's middle
    slant_range_m: float  # from the camera to the centre
    width_m: float  # between the ground points in the middle of the left and the right edge
    ce90_m: float  # with 90 %, the centre's true place is within this horizontal distance
    le90_m: float  # with 90 %, the centre's true height is within plus or minus this
    #: (4, 2) latitude, longitude (rad) of the picture's upper left, upper right, lower right and
    #: lower left corner; all nan if one of them has no ground point.
    corners: Array


def frame_geometry(sight: Sight, config: ConfidenceConfig) -> FrameGeometry:
    """Return the geometry of a picture.

    The centre, and all that is computed from it, is nan if a click on the picture's middle would
    be refused. ``config`` gives the sigmas besides the pose's, as for clicks.
    """
    camera, pose, plane = sight.camera, sight.pose, sight.plane
    middle, left, right, top, bottom = camera.rays(_crosshair(camera))
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(pose.position_n))
    to_local = plane.rotation_from_local(latitude, longitude).T
    # Forward is the middle's ray, right is towards the right edge; nan if the lens has no ray.
    forward = middle / np.linalg.norm(middle)
    across = right - left
    across -= (across @ forward) * forward
    across /= np.linalg.norm(across)
    axes_c = np.stack([forward, across, np.cross(forward, across)], axis=1)
    rotation_ls = to_local @ matrix_from_quat(pose.q_nc) @ axes_c
    platform_rpy = sensor_rpy = _UNKNOWN
    if sight.body is not None:
        rotation_lb = to_local @ matrix_from_quat(sight.body.q_nb)
        platform_rpy = rpy_of(rotation_lb)
        sensor_rpy = rpy_of(rotation_lb.T @ rotation_ls)
    u, v = _crosshair(camera)[0].tolist()
    answer = place(camera, pose, (u, v), plane, sight.ground, config, sight.rates)
    centre = answer if isinstance(answer, Located) else None
    width_m, corners = math.nan, _NO_CORNERS
    if centre:
        uv = np.concatenate([_crosshair(camera)[1:3], _corners(camera)])
        points_n, _ = locate(camera, pose, uv, plane, sight.ground)
        width_m = math.dist(*points_n[:2].tolist())
        places = np.stack(plane.geodetic_from_ned(points_n[2:])[:2], axis=1)
        corners = places if np.isfinite(places).all() else _NO_CORNERS
    return FrameGeometry(
        sensor=(latitude, longitude, height_m),
        platform_rpy=platform_rpy,
        sensor_rpy=sensor_rpy,
        sight_rpy=rpy_of(rotation_ls),
        fields_of_view=(_between(left, right), _between(top, bottom)),
        centre=(
            (centre.latitude_rad, centre.longitude_rad, centre.height_m) if centre else _UNKNOWN
        ),
        slant_range_m=math.dist(centre.point_n, pose.position_n) if centre else math.nan,
        width_m=width_m,
        ce90_m=circular_error_90(centre.covariance_n) if centre else math.nan,
        le90_m=linear_error_90(centre.covariance_n) if centre else math.nan,
        corners=corners,
    )


def _crosshair(camera: Camera) -> Array:
    """Return pixels (5, 2): the picture's middle, and the middles of its four edges.

    The edges are in the order left, right, top, bottom.
    """
    right, bottom = camera.width - 0.5, camera.height - 0.5
    u, v = (right - 0.5) / 2, (bottom - 0.5) / 2
    return np.array([[u, v], [-0.5, v], [right, v], [u, -0.5], [u, bottom]])


def _between(first: Array, last: Array) -> float:
    """Return the angle between two rays (3,), rad."""
    return math.atan2(float(np.linalg.norm(np.cross(first, last))), float(first @ last))


def footprint(
    camera: Camera, pose: CameraPose, plane: TangentPlane, ground: Ground, far_m: float
) -> Array:
    """Return the outline (N, 3) of a picture on the ground, NED in the map's plane, m.

    It is cut where the ground is unknown or farther ahead than ``far_m``; the cut's two ends are
    joined by a straight line. It is empty, (0, 3), if no edge of the picture sees ground.
    """

    def on_ground(uv: Array) -> tuple[Array, BoolArray]:
        points_n, _ = locate(camera, pose, uv, plane, ground)
        ahead_m = (points_n - pose.position_n) @ matrix_from_quat(pose.q_nc)[:, 2]
        return points_n, ahead_m <= far_m  # nan compares false

    # Along the border, from the upper left corner, clockwise.
    corners, share = _corners(camera), np.arange(_PER_EDGE)[:, None] / _PER_EDGE
    edges = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    uv = np.concatenate([here + share * (following - here) for here, following in edges])
    points_n, inside = on_ground(uv)
    after, inside_after = np.roll(uv, -1, axis=0), np.roll(inside, -1)
    cut = np.flatnonzero(inside != inside_after)
    if not len(cut):
        return points_n[inside]
    leaves = inside[cut, None]
    near, far = np.where(leaves, uv[cut], after[cut]), np.where(leaves, after[cut], uv[cut])
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        is_inside = on_ground(middle)[1][:, None]
        near, far = np.where(is_inside, middle, near), np.where(is_inside, far, middle)
    with_ends = np.insert(points_n, cut + 1, on_ground(near)[0], axis=0)
    return np.asarray(with_ends[np.insert(inside, cut + 1, values=True)])


def _corners(camera: Camera) -> Array:
    """Return the pixels (4, 2) of the corners, from the upper left one, clockwise."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    return np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
