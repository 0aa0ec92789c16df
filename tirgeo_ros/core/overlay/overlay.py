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
"""Draw the map on the video: each frame waits for the camera's pose at its exposure.

Only lines that can be trusted are drawn. Without a camera, an origin, or a pose at the exposure
(interpolated or predicted), the picture has a notice instead of the lines. If only the map is
missing, clicks are still answered and targets are still drawn.

A pose after the newest one is predicted at constant linear and angular rates, which are the slopes
of a straight line fitted to the last tenth of a second. The extrapolation error is measured, not
assumed: the poses of the last second are predicted in the same way from the poses before them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.config.overlay_parameters import PictureConfig
from tirgeo_ros.core.frames.rotations import (
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.map.vector_map import MapLayer
from tirgeo_ros.core.overlay.clicks import Clicks, thermal_of
from tirgeo_ros.core.overlay.frame_shapes import DrawingVerdict, Unpainted
from tirgeo_ros.core.overlay.map_shapes import DrapedMap
from tirgeo_ros.core.overlay.picture_painter import OverlayResult, PicturePainter
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.arrays import Array, IntArray, RawPixels
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import NavigationStatus

#: Time over which the camera's rates are averaged: shorter than a turn, long enough for the noise.
RATES_S = 0.1
# The prediction of a pose.
#: The length of the fitted line, and the least span that a fit needs. On simulated flights a
#: shorter line follows the poses' noise (with 20 ms the error of a predicted attitude is twice
#: that with 100 ms); a longer line lags behind turns.
FIT_S, _LEAST_FIT_S = 0.1, 0.05
#: The poses of this time span are predicted to measure the extrapolation error.
TRIAL_S = 1.0
_FEWEST_TRIALS = 5
#: The least manoeuvre that is assumed after the newest pose, because past poses cannot show it:
#: standard deviations of the camera's acceleration (m/s2) and angular acceleration (rad/s2), as
#: of an aircraft that corrects its course in light wind.
_ACCELERATION, _ANGULAR_ACCELERATION = 0.5, 0.2
_ROUNDING_S = 1e-9
# The queue of frames.
#: A stamp that goes back by more than this means that a clock was set, not a late frame.
_JUMP_NS = 1_000_000_000
_RATE_FRAMES = 10
#: One second of video: longer than any sensible wait for a pose.
_MOST_WAITING = 30
_LARGEST_PX = 65_500  # libjpeg's JPEG_MAX_DIMENSION
_SHAPES = {np.dtype(np.uint8): (2, 3), np.dtype(np.uint16): (2,)}  # dimensions by pixel type
# The overlay.
_MARGIN_S = 1.0  # poses are kept this much longer than the oldest waiting frame needs
_READING = "reading"


def rates_up_to(pose: CameraPose, poses: PoseBuffer[CameraPose]) -> CameraRates | None:
    """Return the camera's mean rates before a pose; None without a pose RATES_S earlier."""
    before = poses.at(pose.stamp_ns - round(RATES_S * 1e9))
    return None if isinstance(before, Miss) else CameraRates.between(before, pose)


def predicted(poses: Sequence[CameraPose], stamp_ns: int, max_gap_s: float) -> CameraPose | None:
    """Return the pose at a stamp after the last of ``poses``, which are in order of their stamps.

    Its covariance is the last pose's plus that of the extrapolation. None if the poses after the
    last gap (longer than ``max_gap_s``) span less than 0.05 s.
    """
    stamps = np.array([pose.stamp_ns for pose in poses], np.int64)
    gaps = np.flatnonzero(np.diff(stamps) > max_gap_s * 1e9)
    first = int(gaps[-1]) + 1 if len(gaps) else 0
    poses, stamps = poses[first:], stamps[first:]
    if len(poses) < 2:
        return None
    last, times_s, places = poses[-1], (stamps - stamps[-1]) * 1e-9, _places(poses)
    first_of = np.searchsorted(times_s, times_s - FIT_S - _ROUNDING_S)
    first_of = np.minimum(first_of, np.maximum(np.arange(len(times_s)) - 1, 0))
    is_fitted = times_s - times_s[first_of] >= _LEAST_FIT_S - _ROUNDING_S
    if not is_fitted[-1]:
        return None
    rates = _slopes(times_s, places, first_of)
    ahead_s = (stamp_ns - last.stamp_ns) * 1e-9
    step = rates[-1] * ahead_s
    turned = quat_multiply(quat_from_rotvec(step[3:]), last.q_nc)
    tried = np.flatnonzero((times_s <= -ahead_s) & is_fitted)
    reached = [np.interp(times_s[tried] + ahead_s, times_s, column) for column in places.T]
    missed = np.stack(reached, axis=-1) - places[tried] - rates[tried] * ahead_s
    covariance = last.covariance + _spread(missed, ahead_s, last.covariance)
    return CameraPose(stamp_ns, last.position_n + step[:3], turned, covariance)


def _places(poses: Sequence[CameraPose]) -> Array:
    """Return (N, 6) positions and angles in NED, relative to the last and to the first pose.

    The angles are sums of the turns from each pose to the next. Over a tenth of a second their
    differences are the turn itself, to second order.
    """
    q_nc = np.array([pose.q_nc for pose in poses])
    turns = rotvec_from_quat(quat_multiply(q_nc[1:], quat_conjugate(q_nc[:-1])))
    places = np.zeros((len(poses), 6))
    places[:, :3] = [pose.position_n - poses[-1].position_n for pose in poses]
    places[1:, 3:] = turns.cumsum(axis=0)
    return places


def _slopes(times_s: Array, places: Array, first: IntArray) -> Array:
    """Return slopes (N, 6) of lines fitted from ``places[first[k]]`` to ``places[k]``.

    The slope is 0 if these are one and the same.
    """

    def total(values: Array) -> Array:
        sums = np.concatenate([np.zeros((1, values.shape[1])), values.cumsum(axis=0)])
        return np.asarray(sums[1:] - sums[first])

    t = times_s[:, None]
    count = (np.arange(len(t)) + 1 - first)[:, None]
    sum_t, sum_x = total(t), total(places)
    above = total(t * places) - sum_t * sum_x / count
    below = total(t * t) - sum_t * sum_t / count
    return above / np.where(below > _ROUNDING_S, below, np.inf)


def _spread(missed: Array, ahead_s: float, covariance: Array) -> Array:
    """Return the (6, 6) mean square error of a prediction over ``ahead_s``, plus a floor.

    ``missed`` (N, 6) are the errors of predictions from past poses over the same time. If there
    are too few, the errors of both ends of the fitted line are assumed to be independent, each
    with the last pose's covariance.
    """
    floor = np.repeat([_ACCELERATION, _ANGULAR_ACCELERATION], 3) * ahead_s**2 / 2
    spread = np.diag(floor**2)
    if len(missed) < _FEWEST_TRIALS:
        return spread + 2 * (ahead_s / _LEAST_FIT_S) ** 2 * covariance
    return np.asarray(spread + missed.T @ missed / len(missed))


@dataclass(frozen=True, slots=True)
class Frame:
    """Hold a picture of the video."""

    stamp_ns: int
    pixels: RawPixels  # (h, w) of 8 or 16 bits, or (h, w, 3) BGR
    arrival_ns: int  # on the caller's clock


class FrameQueue:
    """Hold the newest frames, each until it or a newer frame is taken.

    ``counts``: ``replaced`` frames were dropped for a newer one; ``out_of_order`` frames were not
    newer than the previous one; ``time_jumps`` are stamps that went back by more than a second
    (the video continues after them); ``invalid`` frames are not pictures of 8 or 16 bits;
    ``too_large`` frames have a side longer than JPEG allows.
    """

    def __init__(self) -> None:
        self.counts = {"replaced": 0, "out_of_order": 0, "time_jumps": 0}
        self.counts |= {"invalid": 0, "too_large": 0}
        self._frames: deque[Frame] = deque()
        self._stamps: deque[int] = deque(maxlen=_RATE_FRAMES)

    def __len__(self) -> int:
        """Return the number of waiting frames."""
        return len(self._frames)

    def __iter__(self) -> Iterator[Frame]:
        """Iterate over the waiting frames, the newest first."""
        return reversed(self._frames)

    def put(self, frame: Frame) -> None:
        """Add a frame, or count why it is refused."""
        pixels, stamp_ns = frame.pixels, frame.stamp_ns
        is_picture = pixels.ndim in _SHAPES.get(pixels.dtype, ()) and pixels.size > 0
        before_ns = self._stamps[-1] if self._stamps else stamp_ns - 1
        if not is_picture or (pixels.ndim == 3 and pixels.shape[2] != 3):
            self.counts["invalid"] += 1
        elif max(pixels.shape) > _LARGEST_PX:
            self.counts["too_large"] += 1
        elif before_ns - _JUMP_NS <= stamp_ns <= before_ns:
            self.counts["out_of_order"] += 1
        else:
            if stamp_ns < before_ns:
                self.counts["time_jumps"] += 1
                self._stamps.clear()
                self._replace(len(self._frames))
            self._stamps.append(stamp_ns)
            self._frames.append(frame)
            self._replace(len(self._frames) - _MOST_WAITING)

    def take(self, frame: Frame) -> None:
        """Remove a frame, and all older ones, which count as replaced."""
        place = next(i for i, each in enumerate(self._frames) if each is frame)
        self._replace(place)
        self._frames.popleft()

    def _replace(self, number: int) -> None:
        """Remove the oldest frames and count them as replaced."""
        for _ in range(number):
            self._frames.popleft()
            self.counts["replaced"] += 1

    @property
    def rate_hz(self) -> float:
        """Return the frame rate, Hz, over the last ten stamps; nan with fewer than two."""
        if len(self._stamps) < 2:
            return float("nan")
        return (len(self._stamps) - 1) * 1e9 / (self._stamps[-1] - self._stamps[0])


class Overlay:
    """Take frames and poses, return pictures. Raises ConfigError if map heights are unknown.

    ``layers`` are draped here as soon as the plane is known, which takes a second or two for a
    large map. If they are None, the caller drapes the map, again for each plane, and passes it to
    ``set_map``. ``clicks`` locates clicks on the pictures that were returned. ``frames`` are the
    frames that wait, ``poses`` the camera's poses, added in order of time; ``plane`` is the map's
    plane, None until it is known. ``painter`` has the camera and the map.
    """

    def __init__(
        self,
        config: OverlayConfig,
        layers: Sequence[MapLayer] | None,
        terrain: Terrain | None = None,
    ) -> None:
        self.painter = PicturePainter(config, layers or (), terrain)
        self._draped_elsewhere = layers is None
        #: Whether there is, or will be, a map to draw.
        self.map_given = layers is None or len(layers) > 0
        #: Why the map that is draped elsewhere was not set yet; else empty.
        self._map_not_ready = _READING if layers is None else ""
        self.clicks = Clicks(config.confidence)
        self.clicks.ground = self.painter.shaper.ground
        self.frames = FrameQueue()
        self.poses: PoseBuffer[CameraPose] = PoseBuffer()
        self.plane: TangentPlane | None = None
        self._camera: Camera | None = None
        self._rectify = config.rectify
        #: The estimator's status, for the status line and the notices.
        self.status: NavigationStatus | None = None
        #: The verdict of the checks on the set-up, for the notice at the top and the status line.
        self.verdict = DrawingVerdict()
        self._results = {"drawn": 0, "predicted": 0, "notices": 0, "late": 0}
        self.configure(config)

    def configure(self, config: OverlayConfig) -> None:
        """Set the live parameters, at start or in flight. Raises CameraError as ``set_camera``."""
        if self._camera is not None and config.rectify is not self._rectify:
            self.painter.set_lens(self._camera, rectify=config.rectify)
        self._rectify, self._picture = config.rectify, config.picture
        self._latency_s = config.video_latency_s
        self._wait_ns = round(config.max_pose_wait_s * 1e9)
        self._prediction_ns = round(config.max_prediction_s * 1e9)
        self.poses.keep(max(config.video_latency_s, 0.0) + config.max_pose_wait_s + _MARGIN_S)
        self.painter.configure(config)
        self.clicks.confidence = config.confidence

    @property
    def counts(self) -> dict[str, int]:
        """Return the counts of frames and poses, for diagnostics.

        Frames: the counts of FrameQueue; ``drawn``, with a trusted pose; ``predicted``, those of
        them with a predicted pose; ``notices``, without a trusted pose; ``late``, finished only
        after the longest wait for a pose. Poses: ``poses_invalid`` and ``poses_went_back``.
        """
        poses = {"poses_invalid": self.poses.invalid, "poses_went_back": self.poses.went_back}
        return self._results | self.frames.counts | poses

    @property
    def deadlines_ns(self) -> list[int]:
        """Return when each waiting frame must be drawn, on the caller's clock, oldest first."""
        return [frame.arrival_ns + self._wait_ns for frame in self.frames][::-1]

    @property
    def notes(self) -> tuple[str, ...]:
        """Return notes for the operator about the map as draped on the ground."""
        return self.painter.shaper.draped.map.notes if self.painter.shaper.draped else ()

    @property
    def no_map_yet(self) -> str:
        """Return why a map draped elsewhere is not set yet; empty if it is, or without a plane."""
        return self._map_not_ready if self.plane else ""

    def set_plane(self, plane: TangentPlane) -> None:
        """Set the map's plane; forget poses in another plane."""
        if plane != self.plane:
            self.plane = plane
            self.poses.clear()
            self.painter.shaper.set_plane(plane)
            self._map_not_ready = _READING if self._draped_elsewhere else ""
            self.clicks.set_plane(plane)

    def set_camera(self, camera: Camera) -> None:
        """Set the camera's calibration. Raises CameraError if its images cannot be rectified."""
        if camera != self._camera:
            self.painter.set_lens(camera, rectify=self._rectify)
            self._camera = camera

    def set_map(self, new: DrapedMap) -> None:
        """Draw this map, draped elsewhere, from now on; ignore a map in another plane."""
        if new.plane == self.plane:
            self._draped_elsewhere, self.map_given, self._map_not_ready = True, True, ""
            self.painter.shaper.set_map(new)

    def map_failed(self, why: str) -> None:
        """Record why the map that is draped elsewhere failed; keep a map that is drawn."""
        self._map_not_ready = self._map_not_ready and why

    def add_frame(self, stamp_ns: int, pixels: RawPixels, now_ns: int) -> None:
        """Add a frame (h, w) uint8 or uint16, or (h, w, 3) BGR uint8; ``now_ns`` is as in take."""
        self.add_temperatures(stamp_ns, pixels, self._picture)
        self.frames.put(Frame(stamp_ns, pixels, now_ns))

    def add_temperatures(self, stamp_ns: int, pixels: RawPixels, scale: PictureConfig) -> None:
        """Add a frame's temperatures (h, w) uint16; of no use for a picture that is rectified."""
        thermal = thermal_of(pixels, scale)
        if thermal is not None and not self._rectify:
            self.clicks.show_thermal(stamp_ns, thermal)

    def take(self, now_ns: int) -> OverlayResult | None:
        """Return the newest picture that need not wait any longer, or None.

        Older frames are dropped and counted as replaced. ``now_ns`` is the caller's clock, which
        is the clock of the stamps.
        """
        picture = self.take_unpainted(now_ns)
        return None if picture is None else self.painter.paint(picture)

    def take_unpainted(self, now_ns: int) -> Unpainted | None:
        """Return the picture that ``take`` returns, before a PicturePainter paints it."""
        for frame in self.frames:
            exposed_ns = exposure_ns(frame.stamp_ns, self._latency_s)
            pose, obstacle = self.poses.at(exposed_ns), self._no_view(frame.pixels)
            # If the clock went back, the wait is negative: without the lower limit it never ends.
            has_time = 0 <= now_ns - frame.arrival_ns < self._wait_ns
            if obstacle or not (has_time and pose in (Miss.EMPTY, Miss.TOO_NEW)):
                self.frames.take(frame)
                self._results["late"] += now_ns - frame.arrival_ns >= self._wait_ns
                return self._unpainted(frame, now_ns, exposed_ns, pose, obstacle)
        return None

    def _no_view(self, pixels: RawPixels) -> str:
        """Return why no point of the ground can be drawn, whatever the pose; else empty."""
        camera = self._camera
        if camera is None:
            return "no camera info"
        height, width = pixels.shape[:2]
        if (width, height) != (camera.width, camera.height):
            return f"image is {width}x{height}, camera info {camera.width}x{camera.height}"
        if self.plane is None:
            return self._not_navigating() or "no origin"
        return ""

    def _not_navigating(self) -> str:
        """Return why the estimator does not navigate; empty if it does or is unknown."""
        if self.status is None or self.status.state.navigating:
            return ""
        why = self.status.for_operator
        return why[0].lower() + why[1:]

    def _unpainted(
        self, frame: Frame, now_ns: int, exposed_ns: int, pose: CameraPose | Miss, obstacle: str
    ) -> Unpainted:
        predicted_s, newest_ns = 0.0, self.poses.newest_ns
        if not obstacle and pose is Miss.TOO_NEW:
            pose, predicted_s = self._predicted(exposed_ns)
        if not obstacle and isinstance(pose, Miss):
            why = "camera poses are missing" if pose is Miss.GAP else "no pose at this frame"
            if pose is Miss.TOO_NEW and newest_ns is not None:
                why = f"pose {(exposed_ns - newest_ns) / 1e9:.1f} s old"
            obstacle = self._not_navigating() or why
        trusted = None if obstacle or isinstance(pose, Miss) else pose
        self._results["notices" if trusted is None else "drawn"] += 1
        self._results["predicted"] += trusted is not None and predicted_s > 0
        rates = None if trusted is None else rates_up_to(trusted, self.poses)
        camera = self.painter.shaper.camera
        if camera is not None:
            self.clicks.show(frame.stamp_ns, camera, trusted, rates)
            if frame.pixels.shape[:2] != (camera.height, camera.width):
                camera = None
        return Unpainted(
            stamp_ns=frame.stamp_ns,
            pixels=frame.pixels,
            camera=camera,
            pose=trusted,
            rates=rates,
            notice=self._notice(obstacle),
            predicted_s=predicted_s,
            markers=() if trusted is None else tuple(self.clicks.markers()),
            verdict=self.verdict,
            status=self.status,
            age_s=(now_ns - frame.stamp_ns) * 1e-9,
            rate_hz=self.frames.rate_hz,
            replaced=self.frames.counts["replaced"],
        )

    def _notice(self, no_pose: str) -> str:
        """Return the notice that there is no map or, for the reason given, no pose; else empty."""
        no_map = self._map_not_ready
        if not no_map and self.map_given and not self.painter.shaper.has_features:
            no_map = "the map has no features"
        if no_map == _READING and not no_pose:
            return f"NO MAP YET: {_READING}"
        why = [text for text in (no_map, no_pose) if text not in {"", _READING}]
        return f"NO {'MAP' if self.map_given else 'POSE'}: {'; '.join(why)}" if why else ""

    def _predicted(self, exposed_ns: int) -> tuple[CameraPose | Miss, float]:
        """Return a pose predicted from the last ones, and how far, s; a Miss if it is too far.

        Nothing is predicted while the estimator reports that it does not navigate.
        """
        ahead_ns = exposed_ns - (self.poses.newest_ns or 0)
        if ahead_ns > self._prediction_ns or self._not_navigating():
            return Miss.TOO_NEW, 0.0
        latest = self.poses.latest(FIT_S + TRIAL_S)
        pose = predicted(latest, exposed_ns, self.poses.max_gap_s)
        return (pose, ahead_ns * 1e-9) if pose is not None else (Miss.TOO_NEW, 0.0)
