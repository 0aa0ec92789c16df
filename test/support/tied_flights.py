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
"""Flights with true poses, planted errors of the set-up, and ties of points that are known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scenes import PLANE

from tirgeo_ros.core.adjustment.tie_fit import fit_ties
from tirgeo_ros.core.adjustment.tied_views import (
    PARAMETERS,
    TiedView,
    corrected_camera,
    moved,
)
from tirgeo_ros.core.calibration.boresight_model import PointSighting
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.frames.rotations import (
    Q_BODY_OPTICAL,
    euler_axes,
    matrix_from_quat,
    quat_conjugate,
    quat_from_euler,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.ties.tracks import Tracks
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

CAMERA = Camera(640, 512, 800.0, 800.0, 319.5, 255.5)
#: Roll, pitch, yaw, gimbal's north, focal length, k1, latency, ground's height.
PLANTED = np.array([*np.radians([1.0, -0.8, 1.5]), 0.0, 0.03, 0.0, 0.07, 0.0])
GROUND_M = PLANE.height_m
SPEED_MPS = 5.0


class Course(NamedTuple):
    """Strips to north and back, with half circles between them."""

    leg_m: float = 100.0
    spacing_m: float = 15.0
    strips: int = 6
    height_m: float = 40.0
    pitch_deg: float = -90.0
    picture_s: float = 2.0

    @property
    def duration_s(self) -> float:
        turn_m = np.pi * self.spacing_m / 2
        return (self.strips * self.leg_m + (self.strips - 1) * turn_m) / SPEED_MPS

    def gimbal(self, time_s: float) -> tuple[Array, Array]:
        """Return position (3,) and attitude q_ng (4,) of a gimbal that is without errors."""
        turn_m = np.pi * self.spacing_m / 2
        strip, along = divmod(np.clip(time_s * SPEED_MPS, 0, None), self.leg_m + turn_m)
        sign = 1.0 if strip % 2 == 0 else -1.0
        angle = max(along - self.leg_m, 0.0) / (self.spacing_m / 2)
        radius = self.spacing_m / 2
        along = min(along, self.leg_m)
        north = (along if sign > 0 else self.leg_m - along) + sign * radius * np.sin(angle)
        east = strip * self.spacing_m + radius * (1 - np.cos(angle))
        yaw = (0.0 if sign > 0 else np.pi) + sign * angle
        q_ng = quat_from_euler(0.0, np.radians(self.pitch_deg), yaw)
        return np.array([north, east, -self.height_m]), q_ng

    def pose(self, time_s: float, planted: Array) -> tuple[Array, Array]:
        """Return the camera's position and q_nc with the planted errors of the set-up."""
        position_n, q_ng = self.gimbal(time_s - planted[6])
        q_ng = quat_multiply(quat_from_euler(0.0, 0.0, planted[3]), q_ng)
        q_gc = quat_multiply(quat_from_euler(*planted[:3]), Q_BODY_OPTICAL)
        return position_n, quat_multiply(q_ng, q_gc)


COURSE = Course()


class TiedTruth(NamedTuple):
    """A flight's pictures as the aircraft reports them, their ties, and the truth."""

    flown: list  # per picture: time in its course, the course, error of its pose (6,)
    views: list[TiedView]
    tracks: Tracks
    true_poses: list[CameraPose]
    points_n: Array


def noise(rng, times_s, sigma, tau_s):
    """Return a stationary Gauss-Markov process (P, 3) at increasing times."""
    values = rng.standard_normal((len(times_s), 3))
    for k, a in enumerate(np.exp(-np.diff(times_s) / tau_s), start=1):
        values[k] = a * values[k - 1] + np.sqrt(1 - a * a) * values[k]
    return sigma * values


def tied_truth(
    courses=(COURSE,),
    planted=PLANTED,
    seed=0,
    attitude_deg=0.15,
    reported_deg=None,
    tau_s=5.0,
    position_m=0.03,
    points=1500,
    pixel_sigma=0.5,
    wrong=0.0,
    most_sightings=6,
    velocity_n=(0.0, 0.0, 0.0),
    moving=1.0,
):
    """Fly courses one after the other; the attitude's sigma is reported as it is, if not given.

    A share of the ground, ``moving``, its west, moves with a velocity, m/s.
    """
    rng = np.random.default_rng(seed)
    starts = np.cumsum([0.0, *(c.duration_s + 20 for c in courses)])
    flown = [
        (start + t, course, t)
        for start, course in zip(starts, courses, strict=False)
        for t in np.arange(0.2, course.duration_s, course.picture_s)
    ]
    times = np.array([t for t, _, _ in flown])
    reported = np.radians(attitude_deg if reported_deg is None else reported_deg)
    covariance = np.diag([position_m**2] * 3 + [reported**2] * 3)
    errors = np.hstack(
        [noise(rng, times, position_m, 60.0), noise(rng, times, np.radians(attitude_deg), tau_s)]
    )
    flown = [(t, course, error) for (_, course, t), error in zip(flown, errors, strict=True)]
    views, true_poses = [], []
    for time, (t, course, error) in zip(times, flown, strict=True):
        stamp = round(time * 1e9)
        none = np.zeros(8)
        views.append(composed(stamp, course, t, none, covariance))
        pose = composed(stamp, course, t, planted, covariance).view.pose
        true_poses.append(moved(pose, error))
    camera = corrected_camera(CAMERA, planted)
    places = np.array([pose.position_n for pose in true_poses])
    low, high = places.min(0)[:2] - 20, places.max(0)[:2] + 20
    points_n = np.column_stack([rng.uniform(low, high, (points, 2)), np.zeros(points)])
    points_n[:, 2] = np.sin(points_n[:, 0] / 20) + rng.normal(0, 1.0, points) - planted[7]
    moves = points_n[:, 1] <= low[1] + moving * (high - low)[1]
    ways_n = (times - times.mean())[:, None, None] * (moves[:, None] * np.array(velocity_n))
    tracks, kept = _tracks(rng, camera, views, true_poses, points_n + ways_n, most_sightings)
    uv = tracks.uv + rng.normal(0, pixel_sigma, tracks.uv.shape)
    first = np.unique(tracks.point, return_index=True)[1]
    bad = rng.permutation(first)[: int(wrong * len(first))]
    uv[bad] += rng.uniform(-40, 40, (len(bad), 2))
    return TiedTruth(flown, views, tracks._replace(uv=uv), true_poses, points_n[kept])


def composed(stamp, course, time_s, correction, covariance):
    """Return a picture's TiedView as a set-up with a correction (8,) composes it."""
    pose = CameraPose(stamp, *course.pose(time_s, correction), covariance)
    view = View(stamp, corrected_camera(CAMERA, correction), pose)
    return TiedView(view, slopes_of(course, time_s, pose, correction))


def slopes_of(course, time_s, pose, correction):
    """Return the slopes (6, 8) of a pose of a course, by the parameters."""
    slopes = np.zeros((6, len(PARAMETERS)))
    mounted = quat_multiply(quat_from_euler(*correction[:3]), Q_BODY_OPTICAL)
    rotation_ng = matrix_from_quat(quat_multiply(pose.q_nc, quat_conjugate(mounted)))
    slopes[3:, :3] = rotation_ng @ euler_axes(*correction[1:3])
    slopes[5, 3] = 1.0
    (p, q), (p2, q2) = (course.pose(time_s + s, correction) for s in (-0.05, 0.05))
    none = np.zeros((6, 6))
    rates = CameraRates.between(CameraPose(0, p, q, none), CameraPose(100_000_000, p2, q2, none))
    slopes[:, 6] = -np.concatenate(rates)
    return slopes


def _tracks(rng, camera, views, poses, points_n, most):
    picture, point, uv = [], [], []
    for k, pose in enumerate(poses):
        seen, valid = camera.project((points_n[k] - pose.position_n) @ matrix_from_quat(pose.q_nc))
        with np.errstate(invalid="ignore"):
            inside = valid & ((seen >= 0) & (seen < [camera.width, camera.height])).all(1)
        own = np.flatnonzero(inside)
        picture += [k] * len(own)
        point += own.tolist()
        uv += seen[own].tolist()
    picture, point, uv = np.array(picture), np.array(point), np.array(uv)
    order = rng.permutation(len(point))
    order = order[np.argsort(point[order], kind="stable")]
    starts = np.flatnonzero(np.diff(point[order], prepend=-1))
    place = np.arange(len(order)) - np.repeat(starts, np.diff([*starts, len(order)]))
    order = order[place < most]
    order = order[np.bincount(point[order])[point[order]] > 1]
    kept, index = np.unique(point[order], return_inverse=True)
    pictures, by_picture = np.unique(picture[order], return_inverse=True)
    stamps = np.array([views[k].view.stamp_ns for k in pictures])
    return Tracks(stamps, by_picture, index, uv[order]), kept


def fitted(truth, prior_sigma, ground_m=GROUND_M, again=True, **config):
    """Fit a flight of tests; then compose it again with the correction, and fit again."""
    fit = fit_ties(truth.views, truth.tracks, PLANE, ground_m, prior_sigma, **config)
    if not again:
        return fit
    views = [
        composed(tied.view.stamp_ns, course, t, fit.correction, tied.view.pose.covariance)
        for tied, (t, course, _) in zip(truth.views, truth.flown, strict=True)
    ]
    applied = fit.correction
    return fit_ties(views, truth.tracks, PLANE, ground_m, prior_sigma, applied, **config)


def clicked(truth, count):
    """Return the flight with surveyed points for its first ties, and the clicks on them."""
    tracks, rng = truth.tracks, np.random.default_rng(count)
    own = tracks.point < count
    uv = tracks.uv + rng.normal(0, np.sqrt(0.75), tracks.uv.shape)  # 1 px with the ties' 0.5 px
    surveyed_n = truth.points_n[:count] + rng.normal(0, 0.02, (count, 3))
    clicks = [
        PointSighting(f"P{p:03}", int(tracks.stamps_ns[k]), at, surveyed_n[p])
        for p, k, at in zip(tracks.point[own], tracks.picture[own], uv[own], strict=True)
    ]
    pictures, picture = np.unique(tracks.picture[~own], return_inverse=True)
    stamps_ns, point = tracks.stamps_ns[pictures], tracks.point[~own] - count
    rest = Tracks(stamps_ns, picture, point, tracks.uv[~own])
    return truth._replace(tracks=rest, points_n=truth.points_n[count:]), clicks


def pose_errors(fit, truth):
    """Return the errors (P, 6) of the fit's poses, truth minus estimate, and their covariances."""
    pairs = [(fit.views[p.stamp_ns].pose, p) for p in truth.true_poses if p.stamp_ns in fit.views]
    errors = [error_of(pose, true) for pose, true in pairs]
    return np.array(errors), np.array([pose.covariance for pose, _ in pairs])


def error_of(pose, true):
    """Return the error (6,) of a pose, truth minus estimate."""
    turn = rotvec_from_quat(quat_multiply(true.q_nc, quat_conjugate(pose.q_nc)))
    return np.concatenate([true.position_n - pose.position_n, turn])
