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
"""Model how the set-up's parameters and each picture's pose errors move the pixels of ties.

The unknowns x = (gamma, z) count in their own prior standard deviations. ``gamma`` (8,) are the
parameters' corrections. ``z`` (P, 6) are the pictures' pose errors: with L the Cholesky factor of
a pose's covariance, position first, the pose is off by L z.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import pixel_jacobian, rays_to
from tirgeo_ros.core.frames.rotations import quat_from_rotvec, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, Terrain, locate
from tirgeo_ros.core.ties.tracks import Tracks
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray
from tirgeo_ros.core.types.errors import CalibrationError, CameraError
from tirgeo_ros.core.types.poses import CameraPose

#: The parameters, in the order of every vector of corrections: angles in rad, a share of the focal
#: length, a coefficient of the lens, s, m.
PARAMETERS = ("roll", "pitch", "yaw", "gimbal_north", "focal", "k1", "latency", "ground_height")
FOCAL, K1, GROUND = 4, 5, 7
#: Added to a pose's variances (share, and m2 or rad2), so that a covariance has a Cholesky factor.
_JITTER, _LEAST_VARIANCE = 1e-9, 1e-14


class TiedView(NamedTuple):
    """Hold a picture and the slopes (6, 8) of its position (m) and phi_n (rad) by PARAMETERS.

    Slopes by focal length, k1 and ground height are zero.
    """

    view: View
    slopes: Array


@dataclasses.dataclass(frozen=True, eq=False)
class TiedFlight:
    """Hold the P tied pictures of a flight, in order of time, and the ground below them."""

    views: Sequence[TiedView]
    tracks: Tracks  # N sightings of M points
    prior_sigma: Array  # (8,) of PARAMETERS; 0 holds a parameter
    plane: TangentPlane
    ground: Ground  # ellipsoidal height, m, or an elevation model
    applied: Array  # (8,) corrections with which the views were composed
    #: (C, 3) where the survey has the last C of the points, m.
    surveyed_n: Array = dataclasses.field(default_factory=lambda: np.empty((0, 3)))

    @functools.cached_property
    def surveyed(self) -> IntArray:
        """Return the numbers (C,) of the surveyed points."""
        end = int(self.tracks.point.max()) + 1
        return np.arange(end - len(self.surveyed_n), end)

    @functools.cached_property
    def clicks(self) -> BoolArray:
        """Return which sightings (N,) are of surveyed points."""
        return np.isin(self.tracks.point, self.surveyed)

    @functools.cached_property
    def roots(self) -> Array:
        """Return the Cholesky factors (P, 6, 6) of the poses' covariances."""
        return np.array([pose_root(tied.view.pose) for tied in self.views])

    @functools.cached_property
    def times_s(self) -> Array:
        """Return the times of exposure (P,), s after the first."""
        stamps = np.array([tied.view.pose.stamp_ns for tied in self.views])
        return np.asarray((stamps - stamps[0]) * 1e-9)

    @functools.cached_property
    def sightings(self) -> list[IntArray]:
        """Return the indices of each picture's sightings."""
        return [np.flatnonzero(self.tracks.picture == k) for k in range(len(self.views))]

    def corrected(self, k: int, correction: Array, z: Array) -> View:
        """Return picture k with camera and pose corrected by (8,) of PARAMETERS and ``z`` (6,)."""
        view, slopes = self.views[k]
        more = correction - self.applied
        pose = moved(view.pose, slopes @ more + self.roots[k] @ z)
        return View(view.stamp_ns, corrected_camera(view.camera, more), pose)

    def first_points(self) -> Array:
        """Return places (M, 3): the survey's, else the mean of where rays meet the ground."""
        tracks, places = self.tracks, np.full((len(self.tracks.uv), 3), np.nan)
        for (view, _), own in zip(self.views, self.sightings, strict=True):
            uv = tracks.uv[own]
            places[own] = locate(view.camera, view.pose, uv, self.plane, self.ground)[0]
        hits = np.isfinite(places[:, 0])
        sums = np.zeros((tracks.point.max() + 1, 4))
        np.add.at(sums, tracks.point[hits], np.insert(places[hits], 3, 1.0, axis=1))
        with np.errstate(invalid="ignore"):
            means = np.asarray(sums[:, :3] / sums[:, 3:])
        means[self.surveyed] = self.surveyed_n
        return means

    def linearised(self, x: Array, points_n: Array) -> tuple[Array, Array]:
        """Return N + M + C residuals of two components, observed minus expected, and their slopes.

        The slopes (N + M + C, 2, 17) are by gamma, z of the sighting's picture, and the point
        (1/m). First come the sightings (px), with nan for what is not in view; then each point's
        down coordinate against the survey's or the ground's (m, 0), zero where no ground is known;
        then north and east of the surveyed points against the survey's (m).
        """
        gamma, z, tracks = x[:8], x[8:].reshape(-1, 6), self.tracks
        count = len(tracks.uv)
        end = count + len(points_n)
        residual = np.zeros((end + len(self.surveyed), 2))
        slopes = np.zeros((*residual.shape, 17))
        for k, own in enumerate(self.sightings):
            view = self.corrected(k, gamma * self.prior_sigma, z[k])
            places = points_n[tracks.point[own]]
            uv, by_pose, by_k1 = _pixels(view, places)
            by_gamma = by_pose @ self.views[k].slopes
            by_gamma[:, :, FOCAL] = uv - [view.camera.cx, view.camera.cy]
            by_gamma[:, :, K1] = by_k1
            parts = (by_gamma * self.prior_sigma, by_pose @ self.roots[k], -by_pose[:, :, :3])
            residual[own] = tracks.uv[own] - uv
            slopes[own] = np.nan_to_num(np.concatenate(parts, axis=2))
        lack = self._above(points_n) - gamma[GROUND] * self.prior_sigma[GROUND]
        known = np.isfinite(lack)
        residual[count:end, 0] = np.where(known, lack, 0.0)
        slopes[count:end, 0, GROUND] = known * self.prior_sigma[GROUND]
        slopes[count:end, 0, -1] = known
        down, off_n = count + self.surveyed, self.surveyed_n - points_n[self.surveyed]
        residual[down, 0], residual[end:] = off_n[:, 2], off_n[:, :2]
        slopes[down, 0, GROUND], slopes[down, 0, -1] = 0.0, 1.0
        slopes[end:, :, 14:16] = np.eye(2)
        return residual, slopes

    def _above(self, points_n: Array) -> Array:
        """Return the heights (M,), m, of points above the ground; nan where that is unknown."""
        latitude, longitude, height_m = self.plane.geodetic_from_ned(points_n)
        ground = self.ground
        ground_m = ground.height_m(latitude, longitude) if isinstance(ground, Terrain) else ground
        return np.asarray(height_m - ground_m)


def _pixels(view: View, points_n: Array) -> tuple[Array, Array, Array]:
    """Return the pixels (n, 2) of points (n, 3), and their slopes by pose (n, 2, 6) and k1 (n, 2).

    nan where a point is not in view.
    """
    camera = view.camera
    x, y, _ = rays_to(camera, view.pose, points_n)
    by_k1 = np.array([camera.fx * x, camera.fy * y]) * (x * x + y * y)
    return camera.pixels(x, y).T, pixel_jacobian(camera, view.pose, points_n)[0], by_k1.T


def pose_root(pose: CameraPose) -> Array:
    """Return the lower Cholesky factor (6, 6) of a pose's covariance."""
    more = np.diag(_JITTER * np.diag(pose.covariance) + _LEAST_VARIANCE)
    try:
        return np.asarray(np.linalg.cholesky(pose.covariance + more))
    except np.linalg.LinAlgError:
        raise CalibrationError(
            f"the pose at {pose.stamp_ns} ns has an impossible covariance: leave this picture out"
        ) from None


def moved(pose: CameraPose, move: Array, covariance: Array | None = None) -> CameraPose:
    """Return a pose moved by (6,), m and rad of phi_n, with its own or another covariance."""
    q_nc = quat_multiply(quat_from_rotvec(move[3:]), pose.q_nc)
    covariance = pose.covariance if covariance is None else covariance
    return CameraPose(pose.stamp_ns, pose.position_n + move[:3], q_nc, covariance)


def corrected_camera(camera: Camera, correction: Array) -> Camera:
    """Return a camera with focal length and k1 corrected by (8,) of PARAMETERS.

    Raises CalibrationError if there is no such camera.
    """
    return _lens(camera, 1.0 + float(correction[FOCAL]), float(correction[K1]))


@functools.lru_cache(maxsize=8)  # most flights have one camera for all pictures
def _lens(camera: Camera, scale: float, k1: float) -> Camera:
    first, *others = camera.distortion or (0.0, 0.0, 0.0, 0.0)
    lens = (first + k1, *others) if k1 else camera.distortion
    try:
        return dataclasses.replace(
            camera, fx=camera.fx * scale, fy=camera.fy * scale, distortion=lens
        )
    except CameraError:
        raise CalibrationError(
            f"the ties lead to an impossible lens: focal length times {scale:.2f}, k1 {k1:+.2f}; "
            "check the camera's calibration and the stamps"
        ) from None
