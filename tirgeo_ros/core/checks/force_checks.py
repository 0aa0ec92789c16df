"""Check the accelerometers' specific force: its unit, its sign, its axes, its size.

At rest and in steady flight the specific force is the reaction to gravity: 9.8 m/s2, upwards.
Accelerations in flight change sign; over some seconds their mean is small compared with gravity.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from tirgeo_ros.core.checks.imu_blocks import ImuMean
from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity

_GRAVITY = 9.81
_BLOCKS = 20  # IMU blocks in a second
_SECONDS = 30  # seconds that are kept
_LEAST_SECONDS = 4
#: The mean force in flight is between half of gravity and twice gravity (consistency_checks).
_LEAST, _LARGEST = 4.9, 19.6
#: A mean near 1.0 is in g, unless its direction varies: then gravity was removed.
_LEAST_G, _LARGEST_G, _LARGEST_MEAN_G = 0.7, 1.6, 2.0
#: A mean acceleration of 0.5 g turns the mean force by 27 deg; wrong axes turn it by 90 deg.
_LARGEST_ANGLE_RAD = math.radians(45)
#: Limits of a quiet second, without turns or shocks, where the force's size is gravity's.
_QUIET_RAD_S, _QUIET_M_S2 = 0.05, 0.5
#: A larger relative error is a fault: 3 % is 0.3 m/s2, 15 times ``imu.accel_turn_on_bias``.
_LARGEST_SHARE = 0.03
#: No aircraft turns at this mean rate over seconds.
_LARGEST_RATE_RAD_S = 10.0
_TOPIC = "imu/data linear_acceleration"


class ForceChecks:
    """Check the means of the IMU over seconds, computed from its blocks."""

    def __init__(self, aircraft: AircraftConfig) -> None:
        self._rotation_bi = aircraft.rotation_bi
        self._blocks: list[ImuMean] = []
        # for each second: mean force (3,), its expected direction (3,), mean size of the rate
        self._seconds: deque[tuple[Array, Array, float]] = deque(maxlen=_SECONDS)
        self._quiet: deque[float] = deque(maxlen=_SECONDS)

    def block(self, block: ImuMean) -> None:
        """Take the next block."""
        self._blocks.append(block)
        if len(self._blocks) == _BLOCKS:
            self._second(self._blocks)
            self._blocks = []

    def findings(self) -> list[Finding]:
        """Return the findings: at most one on the force and one on the rates."""
        if len(self._seconds) < _LEAST_SECONDS:
            return []
        forces, upwards, rates = (np.array(column) for column in zip(*self._seconds, strict=True))
        mean_b = forces.mean(axis=0)
        size = float(np.linalg.norm(forces, axis=1).mean())
        found = _wrong_size(size, float(np.linalg.norm(mean_b)))
        found = found or _wrong_axes(mean_b, upwards.mean(axis=0)) or self._wrong_scale()
        turning = float(rates.mean())
        if turning < _LARGEST_RATE_RAD_S:
            return [found] if found else []
        evidence = f"the gyroscopes turn at {turning:.0f} rad/s in the mean"
        mend = f"are they in deg/s? ({turning:.0f} deg/s is {math.radians(turning):.2f} rad/s)"
        rate = Finding("gyro_unit", Severity.STOP, evidence, "imu/data angular_velocity", mend)
        return [found, rate] if found else [rate]

    def _second(self, blocks: list[ImuMean]) -> None:
        forces, rates = (np.array([b[k] for b in blocks]) for k in (2, 3))
        force_b, last = forces.mean(axis=0), blocks[-1].autopilot_q_nb
        if self._rotation_bi is not None:
            force_b = self._rotation_bi @ force_b
        up_b = np.array((0.0, 0.0, -1.0))
        if last is not None and usable_attitude(last):
            up_b = -matrix_from_quat(last)[2]
        turning = float(np.linalg.norm(rates, axis=1).mean())
        self._seconds.append((force_b, up_b, turning))
        if turning < _QUIET_RAD_S and float(forces.std(axis=0).max()) < _QUIET_M_S2:
            self._quiet.append(float(np.linalg.norm(force_b)))

    def _wrong_scale(self) -> Finding | None:
        if len(self._quiet) < _LEAST_SECONDS:
            return None
        size = float(np.median(self._quiet))
        if abs(size / _GRAVITY - 1) < _LARGEST_SHARE:
            return None
        evidence = f"the specific force is {size:.2f} m/s2 in {len(self._quiet)} s without turns"
        mend = "it should be 9.81: calibrate the accelerometers (scale, bias)"
        return Finding("force_scale", Severity.CAUTION, evidence, _TOPIC, mend)


def _wrong_size(size: float, mean: float) -> Finding | None:
    if _LEAST < size < _LARGEST:
        return None
    mend = f"divide it by {size / _GRAVITY:.4g}: the unit is m/s2"
    if _LEAST_G < size < _LARGEST_G and _LEAST_G < mean < _LARGEST_MEAN_G:
        mend = "it is in g: multiply it by 9.80665"
    elif size < _LEAST:
        mend = "gravity was taken off: send the accelerometers' readings"
    evidence = f"the specific force is {size:.3g} m/s2 in the mean, not 9.8"
    return Finding("force_unit", Severity.STOP, evidence, _TOPIC, mend)


def _wrong_axes(mean_b: Array, up_b: Array) -> Finding | None:
    """Check the direction of a mean force (3,), m/s2, against the mean expected direction (3,)."""
    cosine = float(mean_b @ up_b / (np.linalg.norm(mean_b) * np.linalg.norm(up_b)))
    if cosine > math.cos(_LARGEST_ANGLE_RAD):
        return None
    numbers = ", ".join(f"{value:+.1f}" for value in flu_from_frd(mean_b))
    evidence = f"the mean specific force is ({numbers}) m/s2 forward, left, up, not (0, 0, +9.8)"
    mend = "turn the axes to forward, left, up, or set aircraft.imu_rpy_deg"
    if cosine < -math.cos(_LARGEST_ANGLE_RAD):
        mend = "the sign is wrong: at rest z is +9.8 (axes forward, left, up)"
    return Finding("force_axes", Severity.STOP, evidence, _TOPIC, mend)
