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
_KEPT = 1 - 1 / 240  # weight per comparison of the running sums: a memory of one minute
#: Least rms rate at which an axis is judged. Noise does not correlate.
_LEAST_RAD_S = math.radians(1.0)
_SURE = 0.8  # correlation; 24 pairs of noise reach it with probability 1e-5
_UNSURE = 0.5
#: A Phantom's attitude yaws 1.4 times less than the aircraft; no autopilot is wrong by twice.
_WRONG_SCALE = 2.0
_IN_DEGREES = (40.0, 80.0)
_AXES = ("forward (roll)", "left (pitch)", "up (yaw)")
_TOPIC = "imu/data angular_velocity"


class GyroChecks:
    """Compare the IMU's blocks with the autopilot's attitude."""

    def __init__(self, aircraft: AircraftConfig) -> None:
        self._rotation_bi = aircraft.rotation_bi
        self._rotated_b = np.zeros(3)  # by the gyroscopes since the comparison's start, rad
        self._seconds = 0.0
        self._count = 0
        self._from: Array | None = None  # attitude at the comparison's start
        self._number = 0.0
        self._own = np.zeros(3)  # sums of squares, gyroscopes
        self._other = np.zeros(3)  # sums of squares, attitude
        self._both = np.zeros((3, 3))  # sums of products [gyroscope, attitude]

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
            self._compare(rotvec_from_quat(quat_multiply(quat_conjugate(self._from), now)))
        self._begin(now)

    def _begin(self, attitude: Array | None) -> None:
        self._rotated_b, self._seconds, self._count = np.zeros(3), 0.0, 0
        self._from = attitude

    def _compare(self, turned_b: Array) -> None:
        own = self._rotated_b if self._rotation_bi is None else self._rotation_bi @ self._rotated_b
        own, other = own / self._seconds, turned_b / self._seconds
        self._number = _KEPT * self._number + 1
        self._own = _KEPT * self._own + own * own
        self._other = _KEPT * self._other + other * other
        self._both = _KEPT * self._both + np.outer(own, other)

    def findings(self) -> list[Finding]:
        """Return the most severe fault of any axis: unit, axes and signs, or scale."""
        if self._number < _LEAST_NUMBER:
            return []
        is_excited = np.sqrt(self._other / self._number) > _LEAST_RAD_S
        scale = np.sqrt(np.outer(self._own, self._other))
        same = np.divide(self._both, scale, out=np.zeros((3, 3)), where=scale > 0)
        ratio = np.sqrt(self._own / np.maximum(self._other, 1e-12))
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
