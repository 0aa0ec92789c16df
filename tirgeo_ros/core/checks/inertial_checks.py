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
"""Check the IMU's units, signs and axes: the force against gravity, rates against the attitude.

The mean specific force over seconds is nearly the reaction to gravity: 9.8 m/s2, upwards.
Rotations over a quarter of a second, from the gyroscopes and from the attitude in ``imu/data``,
are compared by their correlations, so slow errors of the attitude do not matter.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.config import ImuConfig
from tirgeo_ros.core.frames.rotations import (
    euler_from_matrix,
    flu_from_frd,
    matrix_from_quat,
    matrix_from_rotvec,
    quat_conjugate,
    quat_multiply,
    rotation_z,
    rotvec_from_quat,
)
from tirgeo_ros.core.navigation.ins.propagation import mean_powers
from tirgeo_ros.core.navigation.timeline.imu_checks import Clipping
from tirgeo_ros.core.streams.sanity_checks import fault_of, usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.measurements import ImuSample

_BLOCK_NS = 50_000_000
#: After a longer step samples were lost, and a block across the step would not be a mean.
_LONGEST_STEP_NS = 40_000_000
_NO_NUMBER = 1e7  # no force or rate is as large, whatever its unit

# Force and rates.
_KEPT = 1200  # blocks: a minute
_SECOND, _QUARTER = 20, 5  # blocks in a second, and in a quarter of one
_LEAST_SECONDS = 4
_GRAVITY = 9.81
#: The mean force in flight is between half of gravity and twice gravity; in g it is about 1.
_LEAST, _LARGEST, _LEAST_G, _LARGEST_G = 4.9, 19.6, 0.7, 1.6
#: A mean acceleration of 0.5 g turns the mean force by 27 deg; wrong axes turn it by 90 deg.
_LARGEST_ANGLE_RAD = math.radians(45)
#: Limits of a quiet second, without turns or shocks, where the force's size is gravity's.
_QUIET_RAD_S, _QUIET_M_S2 = 0.05, 0.5
#: A larger relative error is a fault: 3 % is 0.3 m/s2, 15 times ``imu.accel_turn_on_bias``.
_LARGEST_SHARE = 0.03
_LEAST_PAIRS = 24
#: Least rms rate at which an axis is judged. Noise does not correlate.
_LEAST_RAD_S = math.radians(1.0)
_SURE, _UNSURE = 0.8, 0.5  # correlations; 24 pairs of noise reach 0.8 with probability 1e-5
_IN_DEGREES = (40.0, 80.0)
_AXES = ("forward (roll)", "left (pitch)", "up (yaw)")
_LEVEL = np.array([[1.0, 0.0, 0.0, 0.0]])
_NO_ATTITUDE = (math.nan,) * 4
_COLUMNS = (3, 6, 10)
_SQUARE = 0.2  # a turn whose entries are this near to quarter turns is rounded to them

# Vibration and clipping.
#: The vibration of one second in five is measured.
_LOOK_NS, _EVERY_NS = 1_000_000_000, 5_000_000_000
_LEAST_NUMBER = 3
#: Ratio of measured to configured noise density; the filter itself adds noise for vibration.
_STRONG = 10.0
#: More clipped samples than one knock gives, and the share of samples that harms the filter.
_LEAST_CLIPPED, _MOST_CLIPPED = 5, 1e-4


class ImuMean(NamedTuple):
    """Hold means over an interval that ends at ``stamp_ns``, in body axes, FRD."""

    stamp_ns: int
    step_s: float
    force_b: Array  # (3,) m/s2
    rate_b: Array  # (3,) rad/s
    autopilot_q_nb: Array | None  # (4,) at the interval's end; None without a usable one
    joined: bool  # whether it begins where the previous block ended


class ImuBlocks:
    """Collect samples into blocks; ``rotation_bi`` (3, 3) turns the IMU's axes into the body's."""

    def __init__(self, rotation_bi: Array | None) -> None:
        self._rotation_bi = np.eye(3) if rotation_bi is None else rotation_bi
        self._samples: list[ImuSample] = []
        self._begin_ns = self._newest_ns = 0
        self._joined = False

    def add(self, sample: ImuSample) -> ImuMean | None:
        """Take the next sample; return the block that it completes, or None.

        A sample represents the interval before its stamp. A block with invalid values is left out.
        """
        stamp_ns = sample.stamp_ns
        step_ns, self._newest_ns = stamp_ns - self._newest_ns, stamp_ns
        if not 0 < step_ns <= _LONGEST_STEP_NS:
            self._begin(stamp_ns, joined=False)
            return None
        self._samples.append(sample)
        if stamp_ns - self._begin_ns < _BLOCK_NS:
            return None
        pairs = [(s.specific_force_b, s.angular_rate_b) for s in self._samples]
        with np.errstate(invalid="ignore", over="ignore"):
            sums = np.add.reduce(pairs) @ self._rotation_bi.T
            force_b, rate_b = sums / len(pairs)
            good = bool(np.vdot(sums, sums) < _NO_NUMBER**2)  # False for nan
        q_nb = sample.autopilot_q_nb if usable_attitude(sample.autopilot_q_nb) else None
        step_s = (stamp_ns - self._begin_ns) * 1e-9
        block = ImuMean(stamp_ns, step_s, force_b, rate_b, q_nb, self._joined)
        self._begin(stamp_ns, joined=good)
        return block if good else None

    def _begin(self, stamp_ns: int, *, joined: bool) -> None:
        self._begin_ns, self._samples, self._joined = stamp_ns, [], joined


class ImuChecks:
    """Check the IMU's blocks of the last minute; ``rotation_bi`` (3, 3) is as configured."""

    def __init__(self, rotation_bi: Array | None) -> None:
        self._rotation_bi = rotation_bi
        # Of each block: force, rate, attitude, and its length (s): (11,). nan where not known.
        self._rows: deque[Array] = deque(maxlen=_KEPT)

    def block(self, block: ImuMean) -> None:
        """Take the next block."""
        q_nb = _NO_ATTITUDE if block.autopilot_q_nb is None else block.autopilot_q_nb
        step_s = [block.step_s if block.joined else math.nan]
        self._rows.append(np.concatenate([block.force_b, block.rate_b, q_nb, step_s]))

    def findings(self) -> list[Finding]:
        """Return at most one finding on the force and one on the gyroscopes."""
        if len(self._rows) < _LEAST_SECONDS * _SECOND:
            return []
        rows = np.array(self._rows)[-(len(self._rows) // _SECOND) * _SECOND :]
        force_b, rate_b, q_nb, steps_s = map(
            np.ascontiguousarray, np.split(rows, _COLUMNS, axis=1)
        )
        own, turned = _turns(rate_b, q_nb, steps_s[:, 0])
        attitudes_nb = q_nb[np.isfinite(q_nb[:, 0])]
        up_b = -matrix_from_quat(attitudes_nb if len(attitudes_nb) else _LEVEL)[:, 2].mean(axis=0)
        turn = _turn(force_b.mean(axis=0), up_b, own, turned)
        case = "turned" if len(attitudes_nb) else "turned no_yaw"
        angles = rpy_text(turn, self._rotation_bi)
        of_rates = _gyro_findings(own, turned)
        if of_rates and not _gyro_findings(own @ turn.T, turned):
            of_rates = _gyro_findings(own, turned, case, angles)
        return [*_force_findings(force_b, rate_b, up_b, case, angles), *of_rates]


def imu_findings(samples: Iterable[object], rotation_bi: Array | None) -> list[Finding]:
    """Return the findings on the IMU among samples; ``rotation_bi`` turns its axes to the body."""
    blocks, checks = ImuBlocks(rotation_bi), ImuChecks(rotation_bi)
    for sample in samples:
        block = blocks.add(sample) if isinstance(sample, ImuSample) else None
        if block is not None:
            checks.block(block)
    return checks.findings()


def rpy_text(turn: Array, rotation_bi: Array | None) -> str:
    """Return the text of ``aircraft.imu_rpy_deg`` after a further turn (3, 3), FRD."""
    whole = turn if rotation_bi is None else turn @ rotation_bi
    angles = np.degrees(flu_from_frd(euler_from_matrix(whole)))
    return str((angles.round(1) + 0.0).tolist())  # no -0


def _turn(force_b: Array, up_b: Array, own: Array, turned: Array) -> Array:
    """Return the turn (3, 3) from the IMU's axes to the body's; yaw is from the rates (N, 3)."""
    axis = np.cross(force_b, up_b)
    size = float(np.linalg.norm(axis))
    level = matrix_from_rotvec(axis / max(size, 1e-9) * math.atan2(size, float(force_b @ up_b)))
    own, turned = ((rates[:, 0] + 1j * rates[:, 1]) for rates in (own @ level.T, turned))
    same = complex(np.vdot(own, turned))
    sizes = float(np.linalg.norm(own) * np.linalg.norm(turned))
    turn = rotation_z(np.angle(same)) @ level if abs(same) > _SURE * sizes > 0 else level
    square = turn.round() + 0.0  # without -0, which gives Euler angles of 180 deg
    return square if np.abs(turn - square).max() < _SQUARE else turn


def _force_findings(
    force_b: Array, rate_b: Array, up_b: Array, case: str, angles: str
) -> list[Finding]:
    """Check forces and rates (N, 3) of whole seconds; ``angles`` turn the force to ``up_b``."""
    forces = force_b.reshape(-1, _SECOND, 3)
    mean_b = force_b.mean(axis=0)
    size = float(np.linalg.norm(forces.mean(axis=1), axis=1).mean())
    if not _LEAST < size < _LARGEST:
        unit = "no_gravity" if size < _LEAST else ""
        if _LEAST_G < size < _LARGEST_G and np.linalg.norm(mean_b) > _LEAST_G:
            unit = "g"
        return [finding("force_unit", unit, size=size, factor=size / _GRAVITY)]
    cosine = float(mean_b @ up_b / (np.linalg.norm(mean_b) * np.linalg.norm(up_b)))
    if cosine < math.cos(_LARGEST_ANGLE_RAD):
        force = ", ".join(f"{value:+.1f}" for value in flu_from_frd(mean_b))
        case = "reversed" if cosine < -math.cos(_LARGEST_ANGLE_RAD) else case
        return [finding("force_axes", case, force=force, angles=angles)]
    turning = np.linalg.norm(rate_b, axis=1).reshape(-1, _SECOND).mean(axis=1)
    quiet = (turning < _QUIET_RAD_S) & (forces.std(axis=1).max(axis=1) < _QUIET_M_S2)
    quiet_sizes = np.linalg.norm(forces[quiet].mean(axis=1), axis=1)
    if len(quiet_sizes) < _LEAST_SECONDS:
        return []
    size = float(np.median(quiet_sizes))
    if abs(size / _GRAVITY - 1) < _LARGEST_SHARE:
        return []
    return [finding("force_scale", size=size, seconds=len(quiet_sizes))]


def _turns(rate_b: Array, q_nb: Array, steps_s: Array) -> tuple[Array, Array]:
    """Return mean rates (M, 3) from gyroscopes (N, 3) and attitudes (N, 4), where both are known.

    ``steps_s`` (N,) are nan after a gap.
    """
    seconds = steps_s.reshape(-1, _QUARTER).sum(axis=1)[1:, None]
    own = (rate_b * steps_s[:, None]).reshape(-1, _QUARTER, 3).sum(axis=1)[1:] / seconds
    ends = q_nb[_QUARTER - 1 :: _QUARTER]
    turned = rotvec_from_quat(quat_multiply(quat_conjugate(ends[:-1]), ends[1:])) / seconds
    both = np.isfinite(own + turned).all(axis=1)
    return own[both], turned[both]


def _gyro_findings(own: Array, turned: Array, case: str = "", angles: str = "") -> list[Finding]:
    """Check rates (M, 3) of the gyroscopes against those of the attitude.

    ``angles`` is the text of mounting angles that correct the axes, if ``case`` has "turned".
    """
    if len(own) < _LEAST_PAIRS:
        return []
    sizes, true_sizes = (np.sqrt((rates**2).mean(axis=0)) for rates in (own, turned))
    scale = np.maximum(np.outer(sizes, true_sizes), 1e-12)
    same = own.T @ turned / len(own) / scale  # correlations (3, 3) [gyroscope, attitude]
    judged = [k for k in range(3) if true_sizes[k] > _LEAST_RAD_S]
    ratios = sizes / np.maximum(true_sizes, 1e-6)
    for axis in judged:
        correlation, ratio = same[axis, axis], float(ratios[axis])
        if _IN_DEGREES[0] < ratio < _IN_DEGREES[1] and correlation > _SURE:
            return [finding("gyro_unit", ratio=ratio)]
        best = int(np.argmax(np.abs(same[:, axis])))
        is_exchanged = abs(correlation) < _UNSURE and abs(same[best, axis]) > _SURE
        if correlation < -_SURE or is_exchanged:
            case = f"{case} {'' if is_exchanged else 'sign'}"
            names = {"axis": _AXES[axis], "other": _AXES[best]}
            return [finding("gyro_axes", case, **names, correlation=correlation, angles=angles)]
    return []


class VibrationChecks:
    """Check every IMU sample for clipping, and one second in five for vibration."""

    def __init__(self, config: ImuConfig) -> None:
        self._densities = np.array((*config.angle_random_walk, *config.velocity_random_walk))
        self._clipping = Clipping()
        self._count = 0
        self._samples: list[ImuSample] = []
        self._begin_ns = 0
        # six noise powers of each measured second, for an hour
        self._powers: deque[tuple[float, ...]] = deque(maxlen=720)

    def add(self, sample: ImuSample) -> None:
        """Take the next sample, as it arrived; an invalid one is ignored."""
        if fault_of(sample):
            return
        self._count += 1
        self._clipping.add(sample)
        since_ns = sample.stamp_ns - self._begin_ns
        if not 0 <= since_ns < _EVERY_NS:
            self._begin_ns, self._samples = sample.stamp_ns, [sample]
        elif since_ns < _LOOK_NS:
            self._samples.append(sample)
        elif len(self._samples) > 2:
            self._powers.append(mean_powers(self._samples))
            self._samples = []

    def findings(self) -> list[Finding]:
        """Return the findings on vibration and on clipping."""
        findings = []
        if len(self._powers) >= _LEAST_NUMBER:
            measured, densities = np.sqrt(np.mean(self._powers, axis=0)), self._densities
            ratios = np.divide(measured, densities, out=np.zeros(6), where=densities > 0)
            if ratios.max() > _STRONG:
                gyros, accels = ratios.reshape(2, 3).max(axis=1).tolist()
                findings.append(finding("vibration", gyroscopes=gyros, accelerometers=accels))
        counts = self._clipping.counts
        if sum(counts.values()) >= max(_LEAST_CLIPPED, _MOST_CLIPPED * self._count):
            listed = ", ".join(f"{name} {number}" for name, number in counts.items())
            findings.append(finding("imu_clipping", counts=listed, samples=self._count))
        return findings
