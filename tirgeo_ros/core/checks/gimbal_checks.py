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
"""Check the gimbal's joint angles against the reported camera attitudes.

Both are yaw, roll, pitch of the same chain, so there are few ways to mistake axes, signs, unit or
order of the joints. Each of these readings of the numbers is tried. The mean difference of yaw is
ignored in this, because the gimbal's north may be biased.

The joints keep the camera level while the body tilts. An attitude computed with joint angles of
another time tilts too; the delay at which it tilts least is that of the joints.

Pictures of drones without an IMU's rates (stills, MP4) come from gimbals that hardly turn in yaw.
If such a camera looks away from the nose by one large angle during a whole flight, the gimbal's
north is wrong.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.frames.rotations import (
    azimuth,
    heading_of,
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
    slerp,
    wrap_pi,
)
from tirgeo_ros.core.gimbal.camera_pose import camera_turn, joint_angles
from tirgeo_ros.core.gimbal.pose_buffer import Miss, StampedBuffer
from tirgeo_ros.core.streams.sanity_checks import joints_fault, usable_attitude
from tirgeo_ros.core.streams.stamps import Spacing
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.measurements import JOINT_ORDERS, CameraAttitudeSample, JointSample
from tirgeo_ros.core.types.poses import BodyPose

_EVERY_NS = 200_000_000  # interval between the compared instants
_HISTORY_S = 2.0
_STEP_S = 0.05  # between the tried delays of joints, from 0.3 s early to 1 s late
_DELAYS_NS = [round(_STEP_S * 1e9) * step for step in range(-6, 21)]
_NO_DELAY = _DELAYS_NS.index(0)
_STILLER, _LEAST_DELAY_S = 0.35, 0.09  # largest share of squares left by a right delay
_STEP_NS = 18_000_000  # least interval between attitudes that are kept: about the joints' rate
_KEPT, _FEWEST = 300, 25  # instants: one minute, five seconds
_NAMES = ("gimbal_yaw_joint", "gimbal_roll_joint", "gimbal_pitch_joint")
#: Mean square difference without a mistake, from errors of the reported attitudes and of the
#: body's, and from the gimbal's wander: Table 8's 0.27 and 0.48 deg rms, 0.5 deg of the
#: body's tilt, and stamps that are 20 ms apart.
_FLOOR_RAD2 = math.radians(0.8) ** 2
_LARGEST_RAD2 = 0.25  # limit for one sample, so that a flight's start does not dominate
#: Another reading of the angles must leave less than this share of the squared differences.
_SHARE = 0.25
_LEAST_BETWEEN_RAD = math.radians(0.7)  # rms difference between two orders that can be told apart
_EXPLAINED = 0.7  # share of the squares that the right order explains
_ALIKE = 1.5  # readings within this factor of the least are equal: the simplest is chosen
#: Largest constant difference without a finding; yaw includes the gimbal's north bias (3 deg).
_OFF_RAD = np.radians((12.0, 3.0, 3.0))
_UNLIKE_RAD = math.radians(5.0)  # rms; above it the two do not agree at all
#: The same limits for a map that is wrong by more than three ellipses.
_FAR_OFF_RAD, _FAR_UNLIKE_RAD = np.radians((18.0, 9.0, 9.0)), math.radians(15.0)
#: Largest constant angle between nose and camera of a gimbal that does not turn in yaw, and the
#: largest scatter (a median of absolute differences) of a constant one.
_ASIDE_RAD, _CONSTANT_RAD, _FEWEST_ASIDE = math.radians(20.0), math.radians(5.0), 8
_STEEP = math.cos(math.radians(20.0))  # down component of a camera that looks down
_LEAST_LEVEL = 0.1  # length of the horizontal part of an axis that has an azimuth


class GimbalChecks:
    """Take samples in order of arrival; return findings at any time.

    ``explicit`` are the parameters of gimbal_node that were set, None if not known.
    """

    def __init__(self, config: GimbalConfig, explicit: Collection[str] | None = None) -> None:
        untouched = explicit is not None and "boresight_rpy_deg" not in explicit
        self._uncalibrated = untouched and not np.any(config.boresight_rpy_deg)
        self._case = "paper" if config.composition == "paper" else ""
        self._north_rad = math.radians(config.north.bias_deg)
        #: Angle from the nose to the camera, and the down component of its view: attitudes alone.
        self._aside: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._alone: tuple[int, Array] | None = None  # the newest attitude without rates
        self._yaw_zero_rad, self._order = config.yaw_zero_rad, config.joint_order
        self._joints: StampedBuffer[Array] = StampedBuffer(_HISTORY_S)
        self._autopilot: StampedBuffer[Array] = StampedBuffer(_HISTORY_S)
        self._bodies: StampedBuffer[Array] = StampedBuffer(_HISTORY_S)
        self._waiting: CameraAttitudeSample | None = None  # until later data have come
        # joints, reported q_bg, heading of the body
        self._pairs: deque[tuple[Array, Array, float]] = deque(maxlen=_KEPT)
        # (L, 3) down in the camera's axes, with the joint angles of each of L delays
        self._downs: deque[Array] = deque(maxlen=_KEPT)
        self._spacing = Spacing(_EVERY_NS)

    def configure(self, config: GimbalConfig) -> None:
        """Take other parameters; another yaw zero removes all data so far."""
        self._uncalibrated = self._uncalibrated and not np.any(config.boresight_rpy_deg)
        self._north_rad = math.radians(config.north.bias_deg)
        if config.yaw_zero_rad != self._yaw_zero_rad:
            self._yaw_zero_rad = config.yaw_zero_rad
            for buffer in (self._joints, self._pairs, self._downs):
                buffer.clear()

    def joints(self, sample: JointSample) -> None:
        """Take joint angles; computed ones, which no encoder measured, are ignored."""
        angles = (sample.yaw_rad, sample.roll_rad, sample.pitch_rad)
        if not (sample.computed or joints_fault(angles)):
            zero = (self._yaw_zero_rad, 0.0, 0.0)
            self._joints.put(sample.stamp_ns, np.subtract(angles, zero))
            if self._spacing.take(sample.stamp_ns):
                self._add_downs(sample.stamp_ns - _DELAYS_NS[-1])

    def _add_downs(self, stamp_ns: int) -> None:
        """Keep the camera's tilt at an instant, with the joints of each delay."""
        body = self._body_at(stamp_ns)
        around = [self._joints.around(stamp_ns + delay_ns) for delay_ns in _DELAYS_NS]
        joints = [angles[0] for angles in around if not isinstance(angles, Miss)]
        if body is None or len(joints) < len(around):
            return
        turns = [camera_turn(JointSample(0, *angles.tolist()), self._order) for angles in joints]
        self._downs.append(matrix_from_quat(body)[2] @ matrix_from_quat(np.array(turns)))

    def _body_at(self, stamp_ns: int) -> Array | None:
        """Return the body's attitude (4,): the autopilot's, or else the filter's."""
        body = self._autopilot.around(stamp_ns)
        if isinstance(body, Miss):
            body = self._bodies.around(stamp_ns)
        return None if isinstance(body, Miss) else slerp(*body)

    def autopilot(self, stamp_ns: int, q_nb: Array) -> None:
        """Take the autopilot's attitude (4,), whose errors the reported attitudes share."""
        _put(self._autopilot, stamp_ns, q_nb)

    def autopilot_alone(self, stamp_ns: int, q_nb: Array) -> None:
        """Take the autopilot's attitude (4,) once more, if it came without an IMU's rates."""
        self._alone = (stamp_ns, q_nb) if usable_attitude(q_nb) else None
        self._compare_headings()

    def body(self, pose: BodyPose) -> None:
        """Take a body pose, which is used where the autopilot's attitude is missing."""
        _put(self._bodies, pose.stamp_ns, pose.q_nb)

    def reported(self, sample: CameraAttitudeSample) -> None:
        """Take the camera attitude that the flight controller reports."""
        before = self._waiting
        if before is not None and 0 <= sample.stamp_ns - before.stamp_ns < _EVERY_NS:
            return
        self._waiting = sample if usable_attitude(sample.q_ng) else None
        self._compare_headings()
        if before is None:
            return
        joints = self._joints.around(before.stamp_ns)
        q_nb = self._body_at(before.stamp_ns)
        if not isinstance(joints, Miss) and q_nb is not None:
            start, end, share = joints
            q_bg = quat_multiply(quat_conjugate(q_nb), before.q_ng)
            self._pairs.append((start if share < 0.5 else end, q_bg, heading_of(q_nb)))

    def _compare_headings(self) -> None:
        """Keep the angle from the nose to the camera, if attitudes of both have the same stamp.

        The camera's heading is that of its right axis: looking straight down, with any roll, the
        axis of view has none.
        """
        alone, camera_ng = self._alone, self._waiting
        if alone is None or camera_ng is None or alone[0] != camera_ng.stamp_ns:
            return
        nose_n, camera = matrix_from_quat(alone[1])[:, 0], matrix_from_quat(camera_ng.q_ng)
        right_n, down = camera[:, 1], float(camera[2, 0])
        if min(math.hypot(*nose_n[:2]), math.hypot(*right_n[:2])) > _LEAST_LEVEL:
            self._aside.append((azimuth(right_n) - math.pi / 2 - azimuth(nose_n), down))

    def _north(self) -> list[Finding]:
        """Return a finding if the camera looks aside by one large angle, more than the bias set.

        Encoders would show where it looks.
        """
        if len(self._aside) < _FEWEST_ASIDE or self._joints.newest_ns is not None:
            return []
        aside, down = np.array(self._aside).T
        turn = np.exp(1j * aside)
        middle = float(np.angle(np.median(turn.real) + 1j * np.median(turn.imag)))
        bias = float(wrap_pi(middle + np.median(wrap_pi(aside - middle))))
        scatter = float(np.median(np.abs(wrap_pi(aside - bias))))
        if abs(wrap_pi(bias - self._north_rad)) < _ASIDE_RAD or scatter > _CONSTANT_RAD:
            return []
        degrees = {"bias_deg": math.degrees(bias), "scatter_deg": math.degrees(scatter)}
        case = "down" if np.median(down) > _STEEP else ""
        return [finding("gimbal_north", case, **degrees, count=len(aside))]

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        findings = self._north()
        if len(self._pairs) >= _FEWEST:
            joints, reported, headings = map(np.array, zip(*self._pairs, strict=True))
            findings += self._compared(joints, matrix_from_quat(reported), headings)
        if all(each.check == "joints_unlike" for each in findings):
            findings = self._late() or findings
        has_gimbal = self._waiting is not None or self._joints.newest_ns is not None
        if self._uncalibrated and has_gimbal:
            findings = [*findings, finding("boresight_default")]
        return findings

    def _late(self) -> list[Finding]:
        """Return a finding if the camera tilts much less with another delay of the joints."""
        if len(self._downs) < _FEWEST:
            return []
        squares = (np.diff(self._downs, axis=0) ** 2).sum(axis=2).mean(axis=0)
        best = int(np.clip(squares.argmin(), 1, len(squares) - 2))
        before, least, after = squares[best - 1 : best + 2]
        bend = max(before - 2 * least + after, 1e-12)
        delay_s = _STEP_S * (best - _NO_DELAY + 0.5 * (before - after) / bend)
        if least > _STILLER * squares[_NO_DELAY] or abs(delay_s) < _LEAST_DELAY_S:
            return []
        way = "later" if delay_s > 0 else "earlier"
        return [finding("joints_late", self._case, size_s=abs(delay_s), way=way)]

    def _compared(self, joints: Array, rotations_bg: Array, headings_rad: Array) -> list[Finding]:
        """Compare angles (N, 3) yaw, roll, pitch, rad, with reported ``R_bg`` (N, 3, 3)."""
        reported = joint_angles(rotations_bg, self._order)
        other = _other_order(joints, reported, rotations_bg)
        before = _sizes(joints, reported)
        if other:
            words = f"the joints are those of a gimbal {other}, not {self._order}"
            after = _sizes(joints, joint_angles(rotations_bg, other))
            texts = {"words": words, "before": before, "after": after}
            return [finding("joint_order", self._case, **texts, other=other, order=self._order)]
        limit = _SHARE * _cost(joints, reported)
        possible = _READINGS if limit > 3 * _FLOOR_RAD2 else ()  # no reading costs less
        costs = [_cost(each.angles(joints, headings_rad), reported) for each in possible]
        least = min(costs, default=math.inf)
        if least < limit:
            best = possible[[cost <= _ALIKE * least for cost in costs].index(True)]
            after = _sizes(best.angles(joints, headings_rad), reported)
            texts = {"words": best.words, "before": before, "after": after}
            return [finding("joint_angles", self._case, **texts)]
        mean, spread = _differences(joints, reported)
        size = np.abs(mean)
        if not ((size > _OFF_RAD) | (spread > _UNLIKE_RAD)).any():
            return []
        far = ((size > _FAR_OFF_RAD) | (spread > _FAR_UNLIKE_RAD)).any()
        off, within = (
            ", ".join(f"{angle:+.1f}" for angle in np.degrees(each).tolist())
            for each in (mean, spread)
        )
        case = f"{self._case} {'far' if far else ''}"
        return [finding("joints_unlike", case, mean=off, spread=within)]


def _put(attitudes: StampedBuffer[Array], stamp_ns: int, q_nb: Array) -> None:
    """Put a usable attitude (4,) into a buffer whose newest one is a step older."""
    newest_ns = attitudes.newest_ns
    is_due = newest_ns is None or not 0 <= stamp_ns - newest_ns < _STEP_NS
    if is_due and usable_attitude(q_nb):
        attitudes.put(stamp_ns, q_nb)


class _Reading(NamedTuple):
    """Hold one way to read three joint numbers: their order, signs, unit and zero of yaw."""

    axes: tuple[int, ...]
    signs: tuple[float, ...]
    degrees: bool
    north: bool  # whether yaw counts from north

    def angles(self, joints: Array, headings_rad: Array) -> Array:
        """Return (N, 3) yaw, roll, pitch, rad, of the numbers (N, 3) as received."""
        unit = math.pi / 180 if self.degrees else 1.0
        angles = joints[:, self.axes] * np.array(self.signs) * unit
        angles[:, 0] -= self.north * headings_rad
        return np.asarray(angles)

    @property
    def words(self) -> str:
        """Return a description for the operator."""
        signs = ("-" if sign < 0 else "" for sign in self.signs)
        read = ", ".join(sign + _NAMES[k] for sign, k in zip(signs, self.axes, strict=True))
        north = ", yaw counted from north" if self.north else ""
        return f"yaw, roll, pitch are {read}{', in degrees' if self.degrees else ''}{north}"


_ORDERS, _SIGNS = itertools.permutations(range(3)), itertools.product((1.0, -1.0), repeat=3)
#: All readings, those with fewer mistakes first.
_READINGS = sorted(
    itertools.starmap(_Reading, itertools.product(_ORDERS, _SIGNS, (False, True), (False, True))),
    key=lambda r: np.sum(np.not_equal(r.axes, range(3))) + r.signs.count(-1) + r.degrees + r.north,
)


def _other_order(joints: Array, reported: Array, rotations_bg: Array) -> str | None:
    """Return another order that fits angles (N, 3) to reported R_bg (N, 3, 3), or None.

    The angles of one attitude in two orders differ by amounts that change with the attitude. If
    the joints differ from the ``reported`` angles by these amounts, they are in the other order.
    """
    off = _about_mean_yaw(joints - reported)
    residuals: dict[str, float] = {}
    for order in JOINT_ORDERS:
        between = _about_mean_yaw(joint_angles(rotations_bg, order) - reported)
        if (between**2).sum(axis=1).mean() > _LEAST_BETWEEN_RAD**2:
            residuals[order] = float((_about_mean_yaw(off - between) ** 2).sum())
    best = min(residuals, key=lambda order: residuals[order], default=None)
    is_explained = best and residuals[best] < (1 - _EXPLAINED) * (off**2).sum()
    return best if is_explained else None


def _about_mean_yaw(off: Array) -> Array:
    """Return differences (N, 3) wrapped to half a turn, yaw's relative to its mean."""
    off = wrap_pi(off)
    off[:, 0] = wrap_pi(off[:, 0] - np.angle(np.exp(1j * off[:, 0]).mean()))
    return np.asarray(off)


def _cost(angles: Array, reported: Array) -> float:
    """Return the sum of the axes' mean square differences, yaw's relative to its mean."""
    off = _about_mean_yaw(angles - reported)
    squares = np.minimum(off**2, _LARGEST_RAD2).mean(axis=0)
    return float(np.maximum(squares, _FLOOR_RAD2).sum())


def _differences(joints: Array, reported: Array) -> tuple[Array, Array]:
    """Return (3,) mean and (3,) standard deviation of joints minus reported angles (N, 3), rad."""
    mean = np.angle(np.exp(1j * (joints - reported)).mean(axis=0))
    return mean, np.asarray(wrap_pi(joints - reported - mean).std(axis=0))


def _sizes(joints: Array, reported: Array) -> str:
    """Return the rms differences of yaw, roll and pitch, deg."""
    sizes_deg = np.degrees(np.hypot(*_differences(joints, reported)))
    return ", ".join(f"{angle:.1f}" for angle in sizes_deg.tolist())
