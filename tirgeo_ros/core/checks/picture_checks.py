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
"""Check the set-up with pictures, lens, camera poses and ground together."""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Collection
from typing import Any

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.checks.ground_checks import HeightChecks, ground_parameter
from tirgeo_ros.core.checks.input_checks import lens_findings
from tirgeo_ros.core.checks.motion_fit import (
    BORESIGHT,
    FOCAL,
    FROM_S,
    HEIGHT,
    LATENCY,
    TO_S,
    MotionFit,
)
from tirgeo_ros.core.checks.picture_motion import PictureMotion, PictureTracker
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.rotations import flu_from_frd
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, is_given
from tirgeo_ros.core.streams.sanity_checks import pose_fault
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.poses import CameraPose

#: Slices of latency, focal length, height and boresight in the vectors of a fit.
_PARTS = slice(0, 1), slice(1, 2), slice(2, 3), BORESIGHT
_BORESIGHT = 3  # its index in _PARTS
#: An error is significant beyond this many of its standard deviations. Errors of picture pairs are
#: correlated where a flight turns all the time: 3.8 sigmas were seen without an error.
_SIGNIFICANT = 6.0
#: The residual without this correction must also be larger by this factor: flights without an
#: error reached 1.19, and 1.26 for the latency in a straight flight.
_IMPROVEMENT = (1.5, 1.1, 1.1, 1.1)  # latency, focal length, height, boresight
#: The largest residual with good poses. Above it, as where a filter starts without headings, an
#: error must explain more: flights without an error reached a factor of 1.29.
_GOOD_PX = 1.0
#: Least errors: s, two logarithms, three angles (rad).
_LEAST = np.array((0.03, 0.05, 0.12, *np.radians((2.5, 2.5, 2.5))))
_LEAST_HEIGHT_M = 2.0
_WRONG = 0.15  # as a logarithm: a larger error makes the map wrong, not only displaced
#: A residual that no fitted error explains: share of the pairs' motion, and least size.
_UNEXPLAINED, _LEAST_UNEXPLAINED_PX = 0.3, 3.0
#: With a larger residual, or this near to the end of its range, a latency means another fault.
_DOUBTFUL_PX, _END_S = 1.5, 0.06
_LATENCY_PAIRS = 40  # pairs after which the latency is observed, if the flight shows it at all
#: Least latency error with fewer pairs, s: the heading of a filter that just started still turns;
#: flights without an error reached 0.051 s at 7 sigma.
_LEAST_EARLY_S = 0.1
_MOST_ELLIPSES = 3.0  # 95 % ellipses, of an error that makes the map wrong

# Stamps of frames.
_KEPT = 3000  # the newest frames
_FEWEST = 20  # frames before anything is reported
#: Share of the frames from which a fault is reported; a busy computer gets some late anyway.
_SHARE, _LATE_SHARE = 0.1, 0.5
#: Limits of a stamp's differences: from its arrival, and from the newest pose's stamp.
_AHEAD_S, _LATE_S, _APART_S = 0.1, 1.0, 2.0


class PictureChecks:
    """Take frames and poses as the overlay gets them; return findings at any time.

    ``ground`` is the ground under the map, None if not known. ``explicit`` are the parameters of
    overlay_node that were set, None if not known. Two or three frames a second cost 3 ms each, the
    others almost nothing. A fit, every eight seconds, costs 20 to 60 ms, or 0.2 s if no error
    explains the pictures.
    """

    def __init__(
        self,
        config: OverlayConfig,
        ground: Ground | None,
        explicit: Collection[str] | None = None,
    ) -> None:
        self._latency_s = config.video_latency_s
        self._default = explicit is not None and "video_latency_s" not in explicit
        self._lens = "overlay_node camera" if config.camera else "thermal/camera_info"
        self._ground = ground_parameter(ground) if is_given(ground) else ""
        self._camera: Camera | None = None
        self._heights = HeightChecks(ground)
        self._stamps = FrameStamps()
        self._tracker = PictureTracker()
        self._motion = PictureMotion(config.video_latency_s, ground)
        self._size: tuple[int, int] | None = None  # of a picture that does not fit the lens

    def configure(self, config: OverlayConfig) -> None:
        """Take other parameters; another latency removes the fit and its data."""
        if config.video_latency_s != self._latency_s:
            self._latency_s, self._default = config.video_latency_s, False
            self._motion.set_latency(self._latency_s)

    def camera(self, camera: Camera) -> None:
        """Set the calibration."""
        if camera != self._camera:
            self._camera, self._size = camera, None
            self._motion.set_camera(camera)

    def plane(self, plane: TangentPlane) -> None:
        """Set the plane of the poses."""
        self._motion.set_plane(plane)
        self._heights.plane(plane)

    def pose(self, pose: CameraPose) -> None:
        """Take a camera pose, in order of time."""
        self._stamps.pose_ns = pose.stamp_ns
        is_due = self._camera is not None or self._heights.spacing.is_due(pose.stamp_ns)
        if is_due and not pose_fault(pose.position_n, pose.q_nc, pose.covariance):
            self._heights.pose(pose)
            self._motion.pose(pose)

    def wants_pixels(self, stamp_ns: int, arrival_ns: int) -> bool:
        """Return whether a frame's pixels are needed; for the others call ``passed``."""
        return self._tracker.wants(stamp_ns or arrival_ns)

    def passed(self, stamp_ns: int, arrival_ns: int) -> None:
        """Take a frame of which only the stamp is known."""
        self._stamps.frame(stamp_ns, arrival_ns)

    def frame(self, stamp_ns: int, pixels: npt.NDArray[Any], arrival_ns: int) -> None:
        """Take a frame (h, w) uint8 or uint16, or (h, w, 3) uint8."""
        height, width = pixels.shape[:2]
        self._stamps.frame(stamp_ns, arrival_ns)
        camera = self._camera
        if camera is not None and (width, height) != (camera.width, camera.height):
            self._size = width, height
            return
        tracks = self._tracker.take(stamp_ns or arrival_ns, pixels)
        if tracks is not None:
            self._motion.tracks(tracks)

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        findings = [*self._heights.findings(), *self._stamps.findings()]
        camera, lens = self._camera, self._lens
        if camera is not None:
            findings += lens_findings(camera, lens, self._size)
            fit = self._motion.fit()
            if fit is not None:
                findings += motion_findings(fit, self._latency_s, camera.fx, lens, self._ground)
        if self._default and self._tracker.pairs:
            findings.append(finding("latency_default", latency_s=self._latency_s))
        return findings


class FrameStamps:
    """Check the stamps of frames."""

    def __init__(self) -> None:
        self.pose_ns = 0  # stamp of the newest pose since the last frame, or 0
        # of each frame: its stamp, its arrival and that pose, ns; 0 where unknown
        self._frames: deque[tuple[int, int, int]] = deque(maxlen=_KEPT)

    def frame(self, stamp_ns: int, arrival_ns: int) -> None:
        """Take a frame's stamp and its arrival time.

        An arrival time of 0 means unknown, because a clock that is played with a bag is 0 until
        its first message.
        """
        self._frames.append((stamp_ns, arrival_ns, self.pose_ns))
        self.pose_ns = 0  # compare only with a pose that came since the last frame

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        if len(self._frames) < _FEWEST:
            return []
        stamps, arrivals, poses = np.array(self._frames, np.int64).T
        stamped = stamps != 0
        early = (stamps - arrivals) * 1e-9 * (stamped & (arrivals != 0))
        apart = (stamps - poses) * 1e-9 * (stamped & (poses != 0))
        steps = np.diff(stamps[stamped]) * 1e-9
        findings = []
        for check, off_s, wrong in (
            ("picture_stamps_zero", stamps * 1e-9, ~stamped),
            ("picture_stamps_ahead", early, early > _AHEAD_S),
            ("picture_stamps_late", -early, -early > _LATE_S),
            ("picture_clock", apart, np.abs(apart) > _APART_S),
            ("picture_stamps_back", steps, steps <= 0),
        ):
            share = _LATE_SHARE if check == "picture_stamps_late" else _SHARE
            if wrong.any() and wrong.mean() > share:
                numbers = {"count": wrong.sum(), "frames": len(stamps)}
                findings.append(finding(check, **numbers, mean_s=off_s[wrong].mean()))
        return findings


def motion_findings(
    fit: MotionFit, latency_s: float, focal_px: float, lens: str, ground: str
) -> list[Finding]:
    """Return the findings of a fit; ``lens`` and ``ground`` name the parameters it corrects.

    ``ground`` is empty if no parameter sets the ground's height.
    """
    if fit.turned:
        return [finding("picture_turned", turned=fit.turned)]
    limit_px = max(_LEAST_UNEXPLAINED_PX, _UNEXPLAINED * max(fit.moved, fit.before))
    doubtful = fit.after > _DOUBTFUL_PX or not FROM_S + _END_S < fit.values[0] < TO_S - _END_S
    if fit.after > limit_px or (doubtful and _is_significant(fit, LATENCY, math.inf)):
        return [finding("picture_motion", moved_px=fit.moved, off_px=fit.before)]
    off_rad = _MOST_ELLIPSES * math.sqrt(CHI2_95) * fit.angle_sigma_rad
    off_s = off_rad * focal_px * fit.step_s / max(fit.moved, 1e-3)
    limits = (off_s, _WRONG, _WRONG, off_rad)
    far = [
        np.abs(fit.values[part]).max() > most for part, most in zip(_PARTS, limits, strict=True)
    ]
    cases = ["far" if is_far else "" for is_far in far]
    significant = [_is_significant(fit, part) for part in range(len(_PARTS))]
    of_fit = functools.partial(finding, pairs=fit.pairs)
    findings = []
    if significant[LATENCY]:
        numbers = {"true_s": latency_s + fit.values[LATENCY], "sigma_s": fit.sigmas[LATENCY]}
        findings.append(of_fit("video_latency", cases[0], **numbers, latency_s=latency_s))
    if significant[FOCAL]:
        true_px = focal_px * math.exp(fit.values[FOCAL])
        numbers = {"true_px": true_px, "sigma_px": true_px * fit.sigmas[FOCAL]}
        findings.append(of_fit("focal_length", cases[1], **numbers, focal_px=focal_px, lens=lens))
    true_m = fit.above_m * math.exp(fit.values[HEIGHT])
    off_m = fit.above_m - true_m
    off_enough = abs(off_m) > max(_LEAST_HEIGHT_M, _SIGNIFICANT * fit.height_sigma_m)
    if significant[HEIGHT] and ground and off_enough:
        numbers = {"true_m": true_m, "sigma_m": true_m * fit.sigmas[HEIGHT]}
        numbers |= {"off_m": abs(off_m), "above_m": fit.above_m}
        move = "raise" if off_m > 0 else "lower"
        findings.append(of_fit("ground_by_motion", cases[2], **numbers, ground=ground, move=move))
    if significant[_BORESIGHT]:
        off_deg = np.degrees(flu_from_frd(fit.values[BORESIGHT])).tolist()
        sigma_deg = math.degrees(fit.sigmas[BORESIGHT].max())
        numbers = {"off_deg": math.hypot(*off_deg), "sigma_deg": sigma_deg}
        angles = ", ".join(f"{angle:+.1f}" for angle in off_deg)
        findings.append(of_fit("boresight_by_motion", cases[3], **numbers, angles=angles))
    unclear = fit.assumed[LATENCY] or abs(fit.values[LATENCY]) > _LEAST[LATENCY]
    if unclear and not significant[LATENCY] and fit.pairs >= _LATENCY_PAIRS:
        findings.append(finding("video_latency_untold"))
    return findings


def _is_significant(fit: MotionFit, number: int, good_px: float = _GOOD_PX) -> bool:
    """Return whether the latency, focal length, height or boresight (0 to 3) is wrong."""
    part = _PARTS[number]
    least = np.maximum(_LEAST[part], _SIGNIFICANT * fit.sigmas[part])
    if number == LATENCY and fit.pairs < _LATENCY_PAIRS:
        least = np.maximum(least, _LEAST_EARLY_S)
    sure = (np.abs(fit.values[part]) > least) & ~np.array(fit.assumed[part])
    enough = _IMPROVEMENT[number] * fit.after + max(fit.after - good_px, 0.0)
    return bool(sure.any() and fit.without[number] > enough)
