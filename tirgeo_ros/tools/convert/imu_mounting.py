"""Find out by gravity whether a recorded IMU has the axes of ``base_link``, and turn it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import quat_conjugate, quat_from_matrix, quat_multiply
from tirgeo_ros.core.navigation.imu_checks import in_body_axes
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample

#: Gravity is seen in the mean of the first seconds: an aircraft begins at rest, or flies steadily.
_SEEN_NS = 2_000_000_000
_LEAST_SAMPLES, _MOST_SAMPLES = 20, 2000
#: No aircraft stands or flies steadily as steep; wrong axes turn it by 90 deg.
_STEEP_RAD = math.radians(45)


class ImuMounting:
    """Turn an IMU's samples to ``base_link``, and watch where gravity is at the beginning.

    ``rpy_deg`` turns the IMU's axes as ``aircraft.imu_rpy_deg`` does: roll, pitch, yaw about
    forward, left, up. ``aircraft`` is what the flight's parameters say of the aircraft.
    """

    def __init__(self, rpy_deg: tuple[float, ...], aircraft: AircraftConfig) -> None:
        self._rotation_bi = AircraftConfig(imu_rpy_deg=rpy_deg).rotation_bi
        self._later_bi = aircraft.rotation_bi
        self._begun_ns = 0
        self._forces_i: list[Array] = []

    def turned(self, sample: ImuSample) -> ImuSample:
        """Return the sample in the axes of ``base_link``, its attitude included.

        The attitude of ``sensor_msgs/Imu`` is that of the IMU.
        """
        self._watch(sample)
        if self._rotation_bi is None:
            return sample
        sample = in_body_axes(sample, self._rotation_bi)
        if sample.autopilot_q_nb is None:
            return sample
        q_ib = quat_conjugate(quat_from_matrix(self._rotation_bi))
        return replace(sample, autopilot_q_nb=quat_multiply(sample.autopilot_q_nb, q_ib))

    def _watch(self, sample: ImuSample) -> None:
        self._begun_ns = self._begun_ns or sample.stamp_ns
        early = sample.stamp_ns - self._begun_ns <= _SEEN_NS
        if early and len(self._forces_i) < _MOST_SAMPLES and not fault_of(sample):
            self._forces_i.append(sample.specific_force_b)

    @property
    def doubt(self) -> str:
        """Return in one line where gravity is, if it is not on +z; else an empty string."""
        if len(self._forces_i) < _LEAST_SAMPLES:
            return ""
        force_i = force_b = np.mean(self._forces_i, axis=0)
        for rotation in (self._rotation_bi, self._later_bi):
            force_b = force_b if rotation is None else rotation @ force_b
        size = float(np.linalg.norm(force_b))
        if size == 0 or -force_b[2] > size * math.cos(_STEEP_RAD):
            return ""
        x, y, z = (flu_from_frd(force_b) + 0.0).tolist()  # no -0
        axis = max(zip(map(abs, (x, y, z)), "xyz", (x, y, z), strict=True))
        up = flu_from_frd(force_i) / size
        roll = round(math.degrees(math.atan2(up[1], up[2])))
        pitch = round(math.degrees(math.atan2(-up[0], math.hypot(up[1], up[2]))))
        return (
            f"imu/data: gravity is on {'+' if axis[2] > 0 else '-'}{axis[1]} at the beginning, "
            f"({x:+.1f}, {y:+.1f}, {z:+.1f}) m/s2, not on +z: the IMU's axes are not those of "
            f"base_link: give --imu-rpy {roll} {pitch} YAW (gravity does not show YAW)"
        )
