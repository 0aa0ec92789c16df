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
"""Track points from one picture to the next; fit set-up errors to them and the camera's poses.

Pictures are reduced first: a shift of a quarter of a reduced pixel can still be measured. Points
that are fixed in the picture (a crosshair, dead pixels) are excluded when the scene moves.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.motion_fit import OFFSETS_S, MotionFit, PicturePair, fit_motion
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, Terrain, is_given
from tirgeo_ros.core.streams.stamps import Spacing, exposure_ns
from tirgeo_ros.core.types.arrays import Array, Pixels, RawPixels
from tirgeo_ros.core.types.poses import CameraPose

_EVERY_NS = 400_000_000
#: Time between the two pictures of a pair: long enough to move, short enough to be tracked.
_SHORTEST_NS, _LONGEST_NS = 80_000_000, 350_000_000
_WIDTH = 360  # largest width of the reduced picture, px
_SMALLEST = 32  # least height and width of the reduced picture, px
_POINTS, _FEWEST_POINTS = 14, 6
_QUALITY = 0.05
_WINDOW = (15, 15)
_LEVELS = 3
_COMES_BACK = 0.3  # largest error, reduced px, of a point tracked forward and back
_STANDS, _MOVES = 0.25, 1.5  # motion of a fixed point, and of a moving scene, reduced px
_LEAST_SPAN = 16.0  # of values in a 16-bit picture, as in tone mapping
_LEAST_CONTRAST = 2.0  # grey levels

# Pairs of pictures, and poses around them.
#: Number of pairs kept with turns, which show lens and latency, and of pairs without turns.
_KEPT = 48
_TURNS_PX = 8.0
_FEWEST, _NEW = 14, 20  # pairs for the first fit, and new pairs for the next one
_LONGEST_GAP_S = 0.1  # between poses
#: Poses are averaged over this time, so that their noise is the same at all instants. An instant
#: with less noise would look like the right exposure.
_MEAN_S = 0.08
_WAIT_NS = round((OFFSETS_S[-1] + _MEAN_S / 2 + 0.01) * 1e9)
_POSES_S = 3.0  # time for which poses are kept, beyond the latency
#: Largest attitude variance of a usable pose: the heading of a filter that has had no headings or
#: accelerations yet may be far off, and may turn when they come.
_LARGEST_RAD2 = math.radians(3.0) ** 2
_WAITING = 8  # pairs, at most
_LEAST_ABOVE_M = 1.0
_FLATTEST = 0.2  # least downward component of a ray: terrain is not looked up further away
_STEPS = 4  # iterations of a ray's intersection with terrain
_HERE = int(np.argmin(np.abs(OFFSETS_S)))  # index of the exposure itself
_UNKNOWN_M = 50.0  # assumed height above ground if nothing gives it; the fit then finds it


class Tracks(NamedTuple):
    """Hold points in two pictures."""

    first_ns: int
    second_ns: int
    first: Array  # (N, 2) column, row in the whole picture
    second: Array  # (N, 2)


class PictureTracker:
    """Take frames a few times a second, return tracks of each pair; ``pairs`` counts them."""

    def __init__(self) -> None:
        self.pairs = 0
        self._first: tuple[int, RawPixels] | None = None  # stamp and reduced picture
        self._spacing = Spacing(_EVERY_NS)

    def take(self, stamp_ns: int, pixels: RawPixels) -> Tracks | None:
        """Take a frame (h, w) uint8 or uint16, or (h, w, 3) uint8."""
        if not self.wants(stamp_ns):
            return None
        scale = -(-pixels.shape[1] // _WIDTH)
        grey = pixels[..., 1] if pixels.ndim == 3 else pixels
        size = max(grey.shape[1] // scale, 1), max(grey.shape[0] // scale, 1)
        whole = grey[: size[1] * scale, : size[0] * scale]
        small = np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA))
        first, self._first = self._first, None
        if first is not None and 0 < stamp_ns - first[0] <= _LONGEST_NS:
            return self._tracks(*first, stamp_ns, small, scale)
        self._first = stamp_ns, small
        self._spacing.take(stamp_ns)
        return None

    def wants(self, stamp_ns: int) -> bool:
        """Return whether a frame with this stamp would be used."""
        if self._first is not None:
            apart_ns = stamp_ns - self._first[0]
            if 0 < apart_ns <= _LONGEST_NS:
                return apart_ns >= _SHORTEST_NS
        return self._spacing.is_due(stamp_ns)

    def _tracks(
        self, first_ns: int, first: RawPixels, second_ns: int, second: RawPixels, scale: int
    ) -> Tracks | None:
        alike = (first.shape, first.dtype) == (second.shape, second.dtype)
        if not alike or min(first.shape) < _SMALLEST:
            return None
        before, after = _grey(first, second)
        if before.std() < _LEAST_CONTRAST:
            return None
        self.pairs += 1
        followed = _followed(before, after)
        if followed is None:
            return None
        middle = 0.5 * (scale - 1)  # offset of a reduced pixel's centre in the whole picture
        start, end = (points * scale + middle for points in followed)
        return Tracks(first_ns, second_ns, start, end)


def _grey(first: RawPixels, second: RawPixels) -> tuple[Pixels, Pixels]:
    """Return a pair of pictures in 8 bits; the first one's range scales both 16-bit pictures."""
    if first.dtype != np.uint16:
        return first, second
    low, high = np.percentile(first, (1.0, 99.0))
    factor = 255.0 / max(high - low, _LEAST_SPAN)
    eight = (np.stack((first, second)) - low) * factor
    before, after = np.clip(eight, 0, 255).astype(np.uint8)
    return before, after


def _followed(first: Pixels, second: Pixels) -> tuple[Array, Array] | None:
    """Return points (N, 2) in both reduced pictures; None if too few can be tracked."""

    def moved(start: Pixels, end: Pixels, points: Any) -> tuple[Any, Any]:
        ends, tracked, _ = cv2.calcOpticalFlowPyrLK(
            start, end, points, np.empty(0), winSize=_WINDOW, maxLevel=_LEVELS
        )
        return ends, tracked

    points = cv2.goodFeaturesToTrack(first, _POINTS, _QUALITY, max(first.shape) / 9)
    if points is None or len(points) < _FEWEST_POINTS:
        return None
    ends, forward = moved(first, second, points)
    back, backward = moved(second, first, ends)
    good = (forward & backward)[:, 0] > 0
    good &= np.abs(back - points).max(axis=(1, 2)) < _COMES_BACK
    way = np.linalg.norm(ends - points, axis=(1, 2))
    if good.any() and np.median(way[good]) > _MOVES:
        good &= way > _STANDS
    if good.sum() < _FEWEST_POINTS:
        return None
    return points[good, 0].astype(float), ends[good, 0].astype(float)


class PictureMotion:
    """Collect tracks and poses, and fit the errors."""

    def __init__(self, latency_s: float, ground: Ground | None) -> None:
        self._plane: TangentPlane | None = None
        self._camera: Camera | None = None
        self._latency_s = latency_s
        self._ground = ground if is_given(ground) else None
        self._poses: deque[tuple[float, ...]] = deque()
        self._newest_ns: int | None = None
        self._variances = np.zeros(6)  # of the newest pose
        self._waiting: deque[Tracks] = deque(maxlen=_WAITING)
        self._turning: deque[PicturePair] = deque(maxlen=_KEPT)
        self._straight: deque[PicturePair] = deque(maxlen=_KEPT)
        self._new = 0
        self._fit: MotionFit | None = None

    def set_camera(self, camera: Camera) -> None:
        """Set the calibration; another one removes all data so far."""
        if camera != self._camera:
            self._camera = camera
            self._forget()

    def set_plane(self, plane: TangentPlane) -> None:
        """Set the plane of the poses; another one removes all data so far."""
        if plane != self._plane:
            self._plane = plane
            self._forget()

    def set_latency(self, latency_s: float) -> None:
        """Set the delay of the pictures, s; all data so far are removed."""
        self._latency_s = latency_s
        self._forget()

    def _forget(self) -> None:
        """Remove all data."""
        for buffer in (self._poses, self._waiting, self._turning, self._straight):
            buffer.clear()
        self._newest_ns, self._new, self._fit = None, 0, None

    def pose(self, pose: CameraPose) -> None:
        """Take a pose, in order of time."""
        if self._newest_ns is not None and pose.stamp_ns <= self._newest_ns:
            if pose.stamp_ns == self._newest_ns:
                return
            self._poses.clear()
        self._newest_ns = pose.stamp_ns
        self._variances = np.maximum(pose.covariance.diagonal(), 0.0)
        if self._variances[3:].max() > _LARGEST_RAD2:
            self._poses.clear()
            return
        self._poses.append((pose.stamp_ns, *pose.position_n.tolist(), *pose.q_nc.tolist()))
        while pose.stamp_ns - self._poses[0][0] > (_POSES_S + max(self._latency_s, 0.0)) * 1e9:
            self._poses.popleft()
        waiting = self._waiting
        due_ns = pose.stamp_ns - _WAIT_NS
        while waiting and exposure_ns(waiting[0].second_ns, self._latency_s) <= due_ns:
            self._pair(waiting.popleft())

    def tracks(self, tracks: Tracks) -> None:
        """Take tracks; they wait for the poses after them."""
        self._waiting.append(tracks)

    def _pair(self, tracks: Tracks) -> None:
        camera, plane = self._camera, self._plane
        if camera is None or plane is None:
            return
        poses = self._poses_around(tracks)
        first, second = camera.rays(tracks.first)[:, :2], camera.rays(tracks.second)[:, :2]
        good = np.isfinite(first).all(1) & np.isfinite(second).all(1)
        if poses is None or not good.any():
            return
        first, second = first[good], second[good]
        above_m = self._above_m(plane, poses[0, _HERE], first)
        if not (above_m > _LEAST_ABOVE_M).all():
            return
        variances, step_s = self._variances, (tracks.second_ns - tracks.first_ns) * 1e-9
        angle_rad2 = variances[3:].max() + variances[:3].max() / np.median(above_m) ** 2
        sigmas = math.sqrt(variances[2]), math.sqrt(angle_rad2)
        pair = PicturePair(first, second, above_m, poses, *sigmas, step_s)
        turns = np.linalg.norm(np.median(second - first, axis=0)) * camera.fx > _TURNS_PX
        (self._turning if turns else self._straight).append(pair)
        self._new += 1

    def _poses_around(self, tracks: Tracks) -> Array | None:
        """Return poses (2, K, 7) at OFFSETS_S from both exposures; None if poses are missing."""
        rows = np.array(self._poses)
        exposed_ns = [exposure_ns(stamp_ns, self._latency_s) for stamp_ns in tracks[:2]]
        starts_s = [(stamp_ns - rows[0, 0]) * 1e-9 for stamp_ns in exposed_ns]
        times_s = (rows[:, 0] - rows[0, 0]) * 1e-9
        wanted_s = np.add.outer(starts_s, OFFSETS_S)
        begin_s, end_s = wanted_s.min() - _MEAN_S / 2, wanted_s.max() + _MEAN_S / 2
        used = (times_s > begin_s - _LONGEST_GAP_S) & (times_s < end_s)
        gaps = np.diff(times_s[used])
        if begin_s < times_s[0] or not gaps.size or gaps.max() > _LONGEST_GAP_S:
            return None
        signs = np.sign(np.einsum("ij,ij->i", rows[1:, 4:], rows[:-1, 4:]))
        rows[1:, 4:] *= np.cumprod(np.where(signs < 0, -1.0, 1.0))[:, None]
        return _means(times_s, rows[:, 1:], wanted_s)

    def _above_m(self, plane: TangentPlane, pose: Array, rays: Array) -> Array:
        """Return (N,) heights of the camera above the ground hit by rays (N, 2); nan off a DEM."""
        ground = self._ground
        if ground is None:
            return np.full(len(rays), _UNKNOWN_M)
        *_, height_m = plane.geodetic_from_ned(pose[:3])
        if not isinstance(ground, Terrain):
            return np.full(len(rays), float(height_m) - ground)
        rotation_nc = matrix_from_quat(pose[3:] / np.linalg.norm(pose[3:]))
        rays_n = np.append(rays, np.ones((len(rays), 1)), axis=1) @ rotation_nc.T
        rays_n /= np.maximum(rays_n[:, 2:], _FLATTEST)  # keeps a ray towards the sky near
        above_m = np.zeros(len(rays))
        for _ in range(_STEPS):
            places = plane.geodetic_from_ned(pose[:3] + rays_n * above_m[:, None])
            above_m = height_m - ground.height_m(*places[:2])
        return np.asarray(above_m)

    def fit(self) -> MotionFit | None:
        """Return the newest fit; None until there are enough pairs."""
        pairs = [*self._turning, *self._straight]
        due = len(pairs) >= _FEWEST and self._new >= (_NEW if self._fit else 1)
        if due and self._camera is not None:
            self._fit = fit_motion(pairs, self._camera.fx)
            self._new = 0
        return self._fit


def _means(times_s: Array, values: Array, wanted_s: Array) -> Array:
    """Return means (..., C) over _MEAN_S of ``values`` (N, C) about instants of any shape."""
    areas = 0.5 * np.diff(times_s)[:, None] * (values[1:] + values[:-1])
    summed = np.append(np.zeros((1, values.shape[1])), np.cumsum(areas, axis=0), axis=0)
    ends = wanted_s + 0.5 * _MEAN_S, wanted_s - 0.5 * _MEAN_S
    after, before = (
        np.stack([np.interp(end, times_s, column) for column in summed.T], axis=-1) for end in ends
    )
    return np.asarray((after - before) / _MEAN_S)
