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
"""Project points to pixels and locate pixels on the ground, each with its covariance.

Both need the camera's pose at the exposure of the picture.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import (
    CameraRates,
    FrameConfidence,
    matrices,
    rays_to,
)
from tirgeo_ros.core.frames.rotations import Q_BODY_OPTICAL, quat_from_euler, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, Terrain
from tirgeo_ros.core.ground.ground_point import Answer, Located, Refusal, place
from tirgeo_ros.core.streams.sanity_checks import place_fault, pose_fault
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import PoseError, SurveyError, TableError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.files.whole_files import PathLike, path_of, write_files
from tirgeo_ros.io.surveys.survey import Answered
from tirgeo_ros.io.targets.formats import exported_answers, form_of
from tirgeo_ros.library.tables import check_unmasked
from tirgeo_ros.tools.replay.node_configs import Config, load_config


@dataclass(frozen=True, eq=False)
class PicturePose:
    """Hold the camera's pose at the exposure of a picture, and the plane that the pose is in."""

    stamp_ns: int
    """Stamp of the picture, ns."""
    pose: CameraPose
    """The camera's pose at the exposure, with its covariance, in ``plane``."""
    plane: TangentPlane
    """The tangent plane: ``plane.ned_from_geodetic`` gives points for ``project``."""
    rates: CameraRates | None = None
    """The camera's motion at the exposure; None: the time of exposure counts as exact."""

    @classmethod
    def of_angles(
        cls,
        latitude_rad: float,
        longitude_rad: float,
        height_m: float,
        *,
        roll_rad: float = 0.0,
        pitch_rad: float,
        heading_rad: float,
        covariance: npt.ArrayLike,
        stamp_ns: int = 0,
    ) -> PicturePose:
        """Return the pose of a camera whose place and angles are known from elsewhere.

        The angles are those of the camera body against north, east, down at its place: forward is
        the optical axis, heading 0 is true north, pitch -pi/2 looks straight down, roll is 0 with
        the picture's rows level. ``height_m`` is above the ellipsoid. ``covariance`` (6, 6) is of
        position (north, east, down, m2) and of the attitude error phi (north, east, down, rad2).
        The plane's origin is the camera's place. Raises PoseError for an invalid place, angle or
        covariance.
        """
        try:
            matrix = np.array(covariance, float)
            place = float(latitude_rad), float(longitude_rad), float(height_m)
            q_ng = quat_from_euler(float(roll_rad), float(pitch_rad), float(heading_rad))
        except (TypeError, ValueError) as error:
            raise PoseError(f"not the pose of a camera: {error}") from None
        if matrix.shape != (6, 6):
            raise PoseError(f"covariance must be of shape (6, 6), is {matrix.shape}")
        q_nc = quat_multiply(q_ng, Q_BODY_OPTICAL)
        fault = place_fault(*place)
        fault = fault or pose_fault(np.zeros(3), q_nc, matrix)
        if not fault and not np.allclose(matrix, matrix.T):
            fault = "covariance is not symmetric"
        if fault:
            raise PoseError(f"not the pose of a camera: {fault}")
        plane = TangentPlane(*place)
        return cls(stamp_ns, CameraPose(stamp_ns, np.zeros(3), q_nc, matrix), plane)


class Projected(NamedTuple):
    """Hold the pixels of N points; nan where a point is behind the camera or off its lens."""

    pixels: Array
    """(N, 2) column and row, px; (0, 0) is the centre of the first pixel."""
    visible: BoolArray
    """(N,) whether the pixel is in the picture."""
    covariance: Array
    """(N, 2, 2) of the pixel, px2: from the pose, the time, the lens and the point."""
    linear: BoolArray
    """(N,) whether the covariance, which is computed to first order, is accurate enough."""


def project(
    points_n: npt.ArrayLike,
    pose: PicturePose,
    camera: Camera,
    *,
    sigma_m: npt.ArrayLike | None = None,
    config: Config = None,
) -> Projected:
    """Project points (N, 3) to the pixels of a picture, with covariances.

    ``points_n`` are north, east, down in ``pose.plane``, m, as ``pose.plane.ned_from_geodetic``
    gives them. ``sigma_m``, one for all or (N,), is the standard deviation of their horizontal
    positions; if None, and where nan, it is the parameter ``confidence.map_sigma_m``. The
    parameters ``confidence`` also have the sigmas of the time, the lens and the ground's height.
    Raises ConfigError, and TableError for points of another shape.
    """
    _check_kinds(pose, camera)
    points = _rows("points_n", points_n, 3)
    rays = rays_to(camera, pose.pose, points)
    valid = np.isfinite(rays[0])
    confidence = load_config(config).overlay.confidence
    confidence_of = FrameConfidence(confidence, camera, pose.pose, pose.rates)
    sigma = _sigmas(sigma_m, len(points))
    spread, first_order = confidence_of.spread(rays[:, valid], sigma[valid], int(valid.sum()))
    pixels, covariance = np.full((len(points), 2), np.nan), np.full((len(points), 2, 2), np.nan)
    pixels[valid] = camera.pixels(*rays[:2, valid]).T
    covariance[valid] = matrices(spread)
    linear = np.zeros(len(points), bool)
    linear[valid] = first_order
    with np.errstate(invalid="ignore"):
        beyond = (pixels < -0.5) | (pixels > [camera.width - 0.5, camera.height - 0.5])
    return Projected(pixels, valid & ~beyond.any(axis=1), covariance, linear)


def locate(
    pixels: npt.ArrayLike,
    pose: PicturePose,
    camera: Camera,
    ground: Ground,
    *,
    config: Config = None,
) -> list[Answer]:
    """Locate pixels (N, 2), column and row, on the ground: a Located or a Refusal for each.

    ``ground`` is the ellipsoidal height of level ground, m, or an elevation model of
    ``load_terrain``. A Located has latitude, longitude, height, the point in ``pose.plane``, its
    covariance and its 95 % ellipse; a Refusal has the reason why there is no point, or why it is
    too uncertain. The sigmas of time, lens and ground are those of the parameters
    (``confidence``). The numbers are those of ``tirgeo locate``. Raises ConfigError, and
    TableError for pixels of another shape or for another kind of ground.
    """
    confidence = load_config(config).overlay.confidence
    _check_kinds(pose, camera)
    level = _checked(ground)
    answers = (
        place(camera, pose.pose, (u, v), pose.plane, level, confidence, pose.rates)
        for u, v in _rows("pixels", pixels, 2).tolist()
    )
    return [replace(answer, stamp_ns=pose.stamp_ns) for answer in answers]


def save_located(
    path: PathLike, answers: Sequence[Answer], ids: Sequence[str] | None = None
) -> None:
    """Write what ``locate`` returned, as ``tirgeo locate`` does: points with 95 % ellipses.

    The name's ending chooses the format: ``.kml``, ``.gpx``, ``.csv``, ``.gpkg``; any other gives
    GeoJSON. ``ids`` name the pixels; by default they are numbered. The file is complete or absent.
    Raises SurveyError if it cannot be written, TableError if there are more or fewer ids.
    """
    if not np.iterable(answers) or not all(isinstance(x, Located | Refusal) for x in answers):
        raise TableError("answers: must be a list as locate returns it")
    names = [str(number) for number in range(1, len(answers) + 1)] if ids is None else list(ids)
    if len(names) != len(answers):
        raise TableError(f"ids: {len(names)} given for {len(answers)} answers")
    answered = [Answered(str(name), answer) for name, answer in zip(names, answers, strict=True)]
    file = path_of(path, SurveyError)
    write_files({file: exported_answers(answered, form_of(file))}, SurveyError)


def _check_kinds(pose: PicturePose, camera: Camera) -> None:
    """Raise TableError unless these are a PicturePose and a Camera."""
    for name, value, kind in (("pose", pose, PicturePose), ("camera", camera, Camera)):
        if not isinstance(value, kind):
            raise TableError(f"{name}: must be a {kind.__name__}; it is {value!r}")


def _checked(ground: Ground) -> Ground:
    """Return the ground. Raises TableError for one that is neither a height nor a model."""
    if isinstance(ground, Terrain):
        return ground
    if not isinstance(ground, numbers.Real) or not math.isfinite(ground):
        wanted = "a height in m, or an elevation model of load_terrain"
        raise TableError(f"ground: must be {wanted}; it is {ground!r}")
    return float(ground)


def _sigmas(sigma_m: npt.ArrayLike | None, count: int) -> Array:
    """Return (count,) standard deviations; nan: the parameter's applies. Raises TableError."""
    sigma = _numbers("sigma_m", np.nan if sigma_m is None else sigma_m)
    if sigma.shape not in {(), (count,)}:
        raise TableError(f"sigma_m: must be a number or of shape ({count},), is {sigma.shape}")
    if (sigma < 0).any():
        raise TableError(f"sigma_m: must not be negative, is {sigma.min():g}")
    return np.broadcast_to(sigma, count)


def _rows(name: str, values: npt.ArrayLike, width: int) -> Array:
    """Return numbers (N, width); a single row may stand alone. Raises TableError."""
    rows = np.atleast_2d(_numbers(name, values))
    if rows.ndim != 2 or (rows.shape[1] != width and rows.size):
        raise TableError(f"{name}: must be of shape (N, {width}), is {rows.shape}")
    return rows.reshape(-1, width)


def _numbers(name: str, values: npt.ArrayLike) -> Array:
    """Return an array of numbers. Raises TableError for other values and for masked numbers."""
    check_unmasked(name, values)
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise TableError(f"{name}: must be numbers, is {np.asarray(values).dtype}") from None
