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
"""Check the dual-antenna heading: offset, sign, unit, and whether it changes at all.

Changes of the heading over a second are compared with the gyroscopes' rotation about the vertical.
The heading itself is compared with the autopilot's, or without an autopilot with the course.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.checks.inertial_checks import ImuMean
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import azimuth, heading_of, matrix_from_quat, wrap_pi
from tirgeo_ros.core.gimbal.pose_buffer import Miss, StampedBuffer
from tirgeo_ros.core.streams.stamps import Spacing
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.measurements import HeadingSample, VelocitySample

_LATEST_S = 3.0  # a heading may be this late
_STEP_NS, _LONGEST_S = 1_000_000_000, 3.0  # between the headings that are compared
_KEPT = 1800  # headings: half an hour, because the turns may be long ago
_LEAST_HEADINGS, _LEAST_COURSES = 5, 20
#: A smaller change is ignored: headings in whole degrees change by one degree by rounding.
_TURNED_RAD = math.radians(5)
_LEAST_TURNED_RAD = math.radians(40)  # sum of the turns that is needed for a finding
#: Largest rms residual of the turns under a correct explanation, relative to the turns' rms.
_EXPLAINED = 0.3
#: Rms difference between changes of heading and of the gyroscopes at which the heading jumps.
_JUMPING_RAD, _LEAST_JUMPS = math.radians(15), 8
#: Up to this share, headings that jump alone are outliers, which the filter rejects itself.
_MOST_OUTLIERS = 0.1
_LEAST_CONSTANT = 0.9  # least length of the mean unit vector of a constant offset: 26 deg rms
#: A compass errs by 10 deg near steel or without its declination.
_OFF_RAD, _WRONG_RAD = math.radians(15), math.radians(45)
_SIGMAS = 5.0
_QUARTER_RAD = math.radians(20)  # an offset within this of a multiple of 90 deg is that multiple
_FORWARD_M_S = 2.0


class HeadingChecks:
    """Check headings against blocks of the IMU and velocities."""

    def __init__(self, config: EkfConfig) -> None:
        sigma_rad = math.radians(config.autopilot.attitude_sigma_deg[2])
        self._off_rad = max(_OFF_RAD, _SIGMAS * sigma_rad)
        # rotation about the vertical since the start, and the autopilot's heading or nan
        self._turns: StampedBuffer[tuple[float, float]] = StampedBuffer(_LATEST_S)
        self._turned_rad = 0.0
        self._waiting: deque[HeadingSample] = deque(maxlen=4)
        self._spacing = Spacing(_STEP_NS)
        self._course_rad = math.nan
        # stamp s, heading, rotation by the gyroscopes, the autopilot's heading, course; rad
        self._rows: deque[tuple[float, ...]] = deque(maxlen=_KEPT)

    def block(self, block: ImuMean) -> None:
        """Take the next block of the IMU."""
        down_b, autopilot_rad = np.array((0.0, 0.0, 1.0)), math.nan
        if block.autopilot_q_nb is not None:
            down_b = matrix_from_quat(block.autopilot_q_nb)[2]
            autopilot_rad = heading_of(block.autopilot_q_nb)
        if not block.joined:
            self._turns.clear()
            self._rows.append((math.nan,) * 5)  # no turn is known across the gap
        self._turned_rad += block.step_s * float(block.rate_b @ down_b)
        self._turns.put(block.stamp_ns, (self._turned_rad, autopilot_rad))
        while self._waiting and self._waiting[0].stamp_ns <= block.stamp_ns:
            self._add(self._waiting.popleft())

    def heading(self, sample: HeadingSample) -> None:
        """Take a heading, one a second; it waits until the IMU's blocks reach its stamp."""
        if math.isfinite(sample.heading_rad):
            if self._spacing.take(sample.stamp_ns):
                self._waiting.append(sample)
            if self._waiting and self._waiting[-1].stamp_ns <= (self._turns.newest_ns or 0):
                self._add(self._waiting.pop())

    def velocity(self, sample: VelocitySample) -> None:
        """Take a velocity; its course is used where there is no autopilot."""
        north, east = sample.velocity_n[:2].tolist()
        is_moving = math.hypot(north, east) > _FORWARD_M_S
        self._course_rad = azimuth((north, east)) if is_moving else math.nan

    def _add(self, sample: HeadingSample) -> None:
        around = self._turns.around(sample.stamp_ns)
        if not isinstance(around, Miss):
            (first, _), (last, autopilot_rad), share = around
            turned_rad = first + share * (last - first)
            own = (sample.stamp_ns * 1e-9, sample.heading_rad)
            self._rows.append((*own, turned_rad, autopilot_rad, self._course_rad))

    def findings(self) -> list[Finding]:
        """Return a fault of the heading's changes, or if there is none, of its mean offset."""
        if not self._rows:
            return []
        rows = _without_outliers(np.array(self._rows))
        steps_s, changes, turns = np.diff(rows[:, :3], axis=0).T
        near = (steps_s > 0) & (steps_s < _LONGEST_S)  # false for nan
        # Turns are not wrapped: nothing that flies turns 180 deg/s.
        changes, turns = wrap_pi(changes[near]), turns[near]
        moved = np.maximum(np.abs(changes), np.abs(turns)) >= _TURNED_RAD
        turned_rad = float(np.abs(turns[moved]).sum())
        fault = _changing(changes[moved], turns[moved], len(turns))
        fault = fault or self._offset(rows[np.isfinite(rows[:, 0])], turned_rad)
        return [fault] if fault else []

    def _offset(self, rows: Array, turned_rad: float) -> Finding | None:
        autopilot, course = (rows[:, 1] - rows[:, k] for k in (3, 4))
        reference, least, offsets = "the autopilot's heading", _LEAST_HEADINGS, autopilot
        if not np.isfinite(autopilot).any():
            if turned_rad < _LEAST_TURNED_RAD:
                return None
            reference, least, offsets = "the course over ground", _LEAST_COURSES, course
        offsets = offsets[np.isfinite(offsets)]
        if len(offsets) < least:
            return None
        mean = np.exp(1j * offsets).mean()
        off = float(np.angle(mean))
        if abs(mean) < _LEAST_CONSTANT or abs(off) < self._off_rad:
            return None
        quarter = math.pi / 2 * round(off / (math.pi / 2))
        case = ""
        if abs(off) < _WRONG_RAD:
            case = "compass"
        elif abs(off - quarter) <= _QUARTER_RAD:
            case = "swapped" if abs(quarter) > 2 else "across"
        return finding("heading_offset", case, off_deg=math.degrees(off), reference=reference)


def _without_outliers(rows: Array) -> Array:
    """Leave out single headings that are far from both of their neighbours, if they are few."""
    residual = wrap_pi(rows[:, 1] - rows[:, 2])  # the heading without the gyroscopes' turns
    jumps = np.abs(wrap_pi(np.diff(residual))) > _JUMPING_RAD  # false for nan
    across = np.abs(wrap_pi(residual[2:] - residual[:-2])) < _JUMPING_RAD
    single = np.zeros(len(rows), bool)
    single[1:-1] = jumps[:-1] & jumps[1:] & across
    return rows[~single] if single.sum() <= _MOST_OUTLIERS * len(rows) else rows


def _changing(changes: Array, turns: Array, pairs: int) -> Finding | None:
    """Compare the heading's changes with the gyroscopes' turns (N,), rad, out of ``pairs``."""
    unlike, squares = float(((changes - turns) ** 2).sum()), float((turns**2).sum())
    if unlike <= _EXPLAINED**2 * squares:
        return None
    turned_rad = float(np.abs(turns).sum())
    slope = float(changes @ turns) / max(squares, 1e-12)
    residual = max(float((changes**2).sum()) - slope**2 * squares, 0.0)
    is_explained = residual < _EXPLAINED**2 * squares
    is_jumping = pairs >= _LEAST_JUMPS and math.sqrt(unlike / pairs) > _JUMPING_RAD
    if not is_jumping and (turned_rad < _LEAST_TURNED_RAD or not is_explained):
        return None
    return finding(
        "heading_turns",
        "sign" if is_explained and slope < -0.7 else "",
        turned_deg=math.degrees(turned_rad),
        slope=slope,
        jumps_deg=math.degrees(math.sqrt(residual / len(turns))),
    )
