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
"""Model how the boresight, the video's latency and related parameters move the pixels of points.

A surveyed point seen in a picture shows where the camera looked. Its residual is the observed
pixel minus the pixel at which the flight's pose projects the point. Six parameters move that
pixel, each counted from its present value in the aircraft's parameters:

``roll``, ``pitch``, ``yaw``
    the mounting error ``boresight_rpy_deg``, about the gimbal's camera axes.
``latency``
    the video's latency: the pose is that of another instant.
``gimbal_north``
    turns the camera about the vertical (the encoder's zero turns it about the body's). Its effect
    on a pose is computed from the poses of the same flight with that parameter changed.
``ground_height``
    the height of all points together, relative to the heights of the aircraft's positioning.

The derivative of the projection by the pose is that of ``core.camera.projection_covariance``; this
module applies the chain rule before it. An observation's expected covariance is that of the click,
the survey and the pose. A pose's error is not white but correlated in time, so
``Sight.systematic`` holds it separately.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates, pixel_jacobian
from tirgeo_ros.core.frames.rotations import (
    BODY_OPTICAL,
    FLU_FRD,
    euler_axes,
    flu_from_frd,
    matrix_from_euler,
    matrix_from_quat,
    quat_conjugate,
    quat_from_matrix,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

#: The parameters, in the order of every vector of corrections: rad, s and m.
PARAMETERS = ("roll", "pitch", "yaw", "latency", "gimbal_north", "ground_height")
_LATENCY, _NORTH, _GROUND = (
    PARAMETERS.index(name) for name in ("latency", "gimbal_north", "ground_height")
)
#: Position sigma of a surveyed point, per axis: that of an RTK rover.
SURVEY_SIGMA_M = 0.02
#: Standard deviation per axis (px) of an operator's click on a point in a thermal picture.
CLICK_SIGMA_PX = 1.0

#: Returns the camera's pose and rates at an instant (ns), or None if it is not known.
PoseAt = Callable[[int], tuple[CameraPose, CameraRates | None] | None]


@dataclass(frozen=True)
class PointSighting:
    """Hold a surveyed point observed in a picture."""

    id: str
    stamp_ns: int  # of the picture's header
    uv: Array  # (2,) column and row, px
    point_n: Array  # (3,) NED in the map's plane, m


class Stepped(NamedTuple):
    """Hold the same flight with one parameter changed."""

    poses: PoseAt
    step: float  # change of the parameter, rad


@dataclass(frozen=True)
class SightedFlight:
    """Hold a flight's poses under the present parameters, and those parameters."""

    camera: Camera
    poses: PoseAt
    boresight_rpy_rad: Array  # (3,) as configured: about forward, left, up
    latency_s: float
    camera_offset_g: Array  # (3,) from the pivot to the camera, m
    click_sigma_px: float
    #: By parameter name; a parameter that is absent cannot be estimated.
    stepped: Mapping[str, Stepped]
    #: Variance of the gimbal's north in the poses (rad2): removed, because it is estimated here.
    north_variance: float = 0.0


class Sight(NamedTuple):
    """Hold one sighting, or N of them, linearised; nan if there is no pose or no projection."""

    residual: Array  # (2,) observed minus expected, px
    design: Array  # (2, 6) of the expected pixel by the parameters, px per rad, s, m
    noise: Array  # (2, 2) covariance of click and survey, px2
    systematic: Array  # (2, 6) root of the pose's part of the covariance, px

    @property
    def covariance(self) -> Array:
        """Return the covariance (..., 2, 2) of the residual, px2."""
        return self.noise + self.systematic @ np.swapaxes(self.systematic, -1, -2)


_NO_SIGHT = Sight(*(np.full(shape, np.nan) for shape in ((2,), (2, 6), (2, 2), (2, 6))))


def sights(flight: SightedFlight, sightings: Sequence[PointSighting], correction: Array) -> Sight:
    """Return all N sightings under a correction (6,), stacked: (N, 2), (N, 2, 6), ..."""
    each = [_sight(flight, sighting, correction) for sighting in sightings]
    return Sight(*(np.array(part) for part in zip(*each, strict=True)))


def corrected_pose(
    flight: SightedFlight, stamp_ns: int, correction: Array
) -> tuple[CameraPose, Array] | None:
    """Return the camera's pose at a picture's exposure under a correction (6,), and its slopes.

    The slopes (6, 6) are of position (m) and phi_n (rad) by the parameters. None if there is no
    pose.
    """
    exposed_ns = exposure_ns(stamp_ns, flight.latency_s + correction[_LATENCY])
    posed = flight.poses(exposed_ns)
    if posed is None:
        return None
    pose, rates = posed
    slopes = np.zeros((6, len(PARAMETERS)))
    if rates is not None:  # of a still, which has no latency, they are not known
        slopes[:, _LATENCY] = -np.concatenate(rates)
    for name, stepped in flight.stepped.items():
        other = stepped.poses(exposed_ns)
        if other is None:
            return None
        turn = rotvec_from_quat(quat_multiply(other[0].q_nc, quat_conjugate(pose.q_nc)))
        move = np.concatenate([other[0].position_n - pose.position_n, turn])
        slopes[:, PARAMETERS.index(name)] = move / stepped.step
    moved = slopes.copy()
    moved[:, _LATENCY] = 0  # already applied by the exposure's time
    return _turned(flight, pose, moved @ correction, correction[:3], slopes)


def by_mounting(flight: SightedFlight, pose: CameraPose) -> tuple[CameraPose, Array]:
    """Return any pose of a flight without the variance of north, and its slopes (6, 6).

    As in ``corrected_pose``; the slopes by latency and height of the ground are left zero.
    """
    slopes = np.zeros((6, len(PARAMETERS)))
    pose, slopes = _turned(flight, pose, np.zeros(6), np.zeros(3), slopes)
    slopes[:, _NORTH] = -_about_down(flight, pose)
    return pose, slopes


def _about_down(flight: SightedFlight, pose: CameraPose) -> Array:
    """Return the motion (6,), m and rad, of the camera by a unit turn about down of its pivot."""
    mounted = quat_conjugate(_mounting(tuple(flight.boresight_rpy_rad.tolist()))[0])
    offset_n = matrix_from_quat(quat_multiply(pose.q_nc, mounted)) @ flight.camera_offset_g
    return np.array([-offset_n[1], offset_n[0], 0.0, 0.0, 0.0, 1.0])


def _turned(
    flight: SightedFlight, pose: CameraPose, move: Array, turn_rpy: Array, slopes: Array
) -> tuple[CameraPose, Array]:
    """Return the pose moved by (6,), with the boresight turned; fill its columns of ``slopes``."""
    mounted = quat_conjugate(_mounting(tuple(flight.boresight_rpy_rad.tolist()))[0])
    q_ng = quat_multiply(quat_from_rotvec(move[3:]), quat_multiply(pose.q_nc, mounted))
    q_gc, axes_g = _mounting(tuple((flight.boresight_rpy_rad + turn_rpy).tolist()))
    rotation_ng = matrix_from_quat(q_ng)
    slopes[3:, :3] = rotation_ng @ axes_g
    about_down = _about_down(flight, pose)
    covariance = pose.covariance - flight.north_variance * np.outer(about_down, about_down)
    position_n, q_nc = pose.position_n + move[:3], quat_multiply(q_ng, q_gc)
    return CameraPose(pose.stamp_ns, position_n, q_nc, covariance), slopes


@functools.lru_cache(maxsize=2)  # all sightings of a step use the same two mountings
def _mounting(rpy_rad: tuple[float, ...]) -> tuple[Array, Array]:
    """Return ``q_gc`` (4,) of a configured mounting error, and the axes (3, 3) of its angles.

    The axes are columns in g: a small change of roll, pitch or yaw turns the camera about them.
    """
    roll, pitch, yaw = flu_from_frd(np.array(rpy_rad))
    q_gc = quat_from_matrix(matrix_from_euler(roll, pitch, yaw) @ BODY_OPTICAL)
    return q_gc, euler_axes(pitch, yaw) @ FLU_FRD


def _sight(flight: SightedFlight, sighting: PointSighting, correction: Array) -> Sight:
    posed = corrected_pose(flight, sighting.stamp_ns, correction)
    if posed is None:
        return _NO_SIGHT
    pose, slopes = posed
    point_n = sighting.point_n - [0.0, 0.0, correction[_GROUND]]
    by_pose, by_point = (part[0] for part in pixel_jacobian(flight.camera, pose, point_n[None]))
    uv = flight.camera.project((point_n - pose.position_n) @ matrix_from_quat(pose.q_nc))[0][0]
    design = by_pose @ slopes
    design[:, _GROUND] = -by_point[:, 2]
    noise = flight.click_sigma_px**2 * np.eye(2) + SURVEY_SIGMA_M**2 * by_point @ by_point.T
    values, vectors = np.linalg.eigh(pose.covariance)  # a variance may be negative by rounding
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return Sight(sighting.uv - uv, design, noise, by_pose @ root)
