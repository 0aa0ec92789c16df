"""Check the gyroscopes against the autopilot's attitude: unit, signs, axes.

Rotations over a quarter of a second, from the gyroscopes and from the attitude in ``imu/data``,
are compared axis by axis by their correlations. So slow errors of the attitude do not matter.
"""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.checks.imu_blocks import ImuMean
from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.frames.rotations import quat_conjugate, quat_multiply, rotvec_from_quat
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity

_BLOCKS = 5  # IMU blocks in a comparison: a quarter of a second
_LEAST_NUMBER = 24
#: Least rms rate at which an axis is judged. Noise does not correlate.
_LEAST_RAD_S = math.radians(1.0)
_SURE = 0.8  # correlation; 24 pairs of noise reach it with probability 1e-5
_UNSURE = 0.5
#: A Phantom's attitude yaws 1.4 times less than the aircraft; no autopilot is wrong by twice.
_WRONG_SCALE = 2.0
_IN_DEGREES = (40.0, 80.0)
_AXES = ("forward (roll)", "left (pitch)", "up (yaw)")
_TOPIC = "imu/data angular_velocity"


class RunningProducts:
    """Sum squares and products of pairs of vectors (3,); each pair's weight falls by ``kept``."""

    def __init__(self, kept: float) -> None:
        self._kept, self.number = kept, 0.0
        self.first, self.second = np.zeros(3), np.zeros(3)  # sums of squares
        self.both = np.zeros((3, 3))  # sums of products [first, second]

    def add(self, first: Array, second: Array) -> None:
        """Add a pair."""
        self.number = self._kept * self.number + 1
        self.first = self._kept * self.first + first * first
        self.second = self._kept * self.second + second * second
        self.both = self._kept * self.both + np.outer(first, second)


class GyroChecks:
    """Compare the IMU's blocks with the autopilot's attitude."""

    def __init__(self, aircraft: AircraftConfig) -> None:
        self._rotation_bi = aircraft.rotation_bi
        self._rotated_b = np.zeros(3)  # by the gyroscopes since the comparison's start, rad
        self._seconds = 0.0
        self._count = 0
        self._from: Array | None = None  # attitude at the comparison's start
        self._sums = RunningProducts(1 - 1 / 240)  # of gyroscopes and attitude, over a minute

    def block(self, block: ImuMean) -> None:
        """Take the next block."""
        if not block.joined:
            self._begin(None)
        self._rotated_b += np.multiply(block.rate_b, block.step_s)
        self._seconds += block.step_s
        self._count += 1
        if self._count < _BLOCKS:
            return
        now = block.autopilot_q_nb if usable_attitude(block.autopilot_q_nb) else None
        if now is not None and self._from is not None:
            turned_b = rotvec_from_quat(quat_multiply(quat_conjugate(self._from), now))
            own = self._rotated_b
            own = own if self._rotation_bi is None else self._rotation_bi @ own
            self._sums.add(own / self._seconds, turned_b / self._seconds)
        self._begin(now)

    def _begin(self, attitude: Array | None) -> None:
        self._rotated_b, self._seconds, self._count = np.zeros(3), 0.0, 0
        self._from = attitude

    def findings(self) -> list[Finding]:
        """Return the most severe fault of any axis: unit, axes and signs, or scale."""
        sums = self._sums
        if sums.number < _LEAST_NUMBER:
            return []
        is_excited = np.sqrt(sums.second / sums.number) > _LEAST_RAD_S
        scale = np.sqrt(np.outer(sums.first, sums.second))
        same = np.divide(sums.both, scale, out=np.zeros((3, 3)), where=scale > 0)
        ratio = np.sqrt(sums.first / np.maximum(sums.second, 1e-12))
        found = [_fault(k, same[:, k], float(ratio[k])) for k in range(3) if is_excited[k]]
        kinds = [one for one in found if one]
        return sorted(kinds, key=lambda one: -one.severity)[:1]


def _fault(axis: int, same: Array, ratio: float) -> Finding | None:
    """Return an axis' fault or None; ``same`` (3,) is its correlation with each gyroscope axis."""
    name, best = _AXES[axis], int(np.argmax(np.abs(same)))
    against = f"(correlation with the orientation in imu/data {same[axis]:+.2f})"
    if _IN_DEGREES[0] < ratio < _IN_DEGREES[1] and same[axis] > _SURE:
        evidence = f"the gyroscopes turn {ratio:.1f} times as fast as the orientation in imu/data"
        mend = "they are in deg/s: multiply them by 0.0174533"
        return Finding("gyro_unit", Severity.STOP, evidence, _TOPIC, mend)
    if same[axis] < -_SURE:
        evidence = f"the gyroscope {name} has the wrong sign {against}"
        mend = "axes are forward, left, up, positive counter-clockwise seen from their tips"
        return Finding("gyro_axes", Severity.STOP, evidence, _TOPIC, mend)
    if abs(same[axis]) < _UNSURE and abs(same[best]) > _SURE:
        evidence = f"turns about {name} stand on the gyroscope {_AXES[best]} {against}"
        mend = "turn the axes to forward, left, up, or set aircraft.imu_rpy_deg"
        return Finding("gyro_axes", Severity.STOP, evidence, _TOPIC, mend)
    if same[axis] > _SURE and max(ratio, 1 / ratio) > _WRONG_SCALE:
        evidence = f"the gyroscope {name} turns {ratio:.2f} times as fast as the orientation"
        return Finding("gyro_scale", Severity.CAUTION, evidence, _TOPIC, "check unit and scale")
    return None
