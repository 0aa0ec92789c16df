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
"""Define the sensor samples: immutable records with time stamps, frames and units.

All stamps are integer nanoseconds, the time of the measurement. The frames are defined in
``tirgeo_ros/__init__.py``. Arrays are float64 unless another type is given.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import ClassVar

import numpy as np

from tirgeo_ros.core.types.arrays import Array

JOINTS = ("yaw", "roll", "pitch")
#: Values of the parameters ``joint_order``; the usual order first.
JOINT_ORDERS = tuple("-".join(order) for order in itertools.permutations(JOINTS))
USUAL_ORDER = JOINT_ORDERS[0]

#: End of the stamps of ROS messages, in 2038: their seconds are an int32.
LAST_NS = (1 << 31) * 1_000_000_000
#: Range of air pressure: the standard atmosphere from 11 km high to 1 km below sea level.
PRESSURES_PA = (22_632.0, 113_930.0)


class FixStatus(IntEnum):
    """Name the quality of a satellite fix; the numbers are those of the status of ``rtk/fix``."""

    NONE = -1
    SINGLE = 0
    FLOAT = 1
    FIXED = 2


class Source(Enum):
    """Name the source of a sample, and the topic on which it comes.

    The value is its name in diagnostics and verdicts. The order is that in which the filter uses
    samples of one instant.
    """

    IMU = "imu", "imu/data"
    RTK_POSITION = "rtk_position", "rtk/fix"
    RTK_VELOCITY = "rtk_velocity", "rtk/vel"
    RTK_HEADING = "rtk_heading", "rtk/heading"
    GPS_POSITION = "gps_position", "gps/fix"
    GPS_VELOCITY = "gps_velocity", "gps/vel"
    BAROMETER = "barometer", "baro/pressure"
    AUTOPILOT_HEADING = "autopilot_heading", "imu/data"
    SET_HEADING = "set_heading", "ekf_node/set_heading"
    REST = "rest", "imu/data"

    topic: str

    def __new__(cls, value: str, topic: str) -> Source:
        """Return a member whose value is its name alone."""
        member = object.__new__(cls)
        member._value_ = value
        member.topic = topic
        return member

    # Each member exists once, so its identity can be its hash. Enum's own hash, which hashes the
    # name, takes ten times as long.
    __hash__ = object.__hash__


@dataclass(frozen=True, slots=True)
class ImuSample:
    """Hold the body's specific force and angular rate, and the autopilot's attitude if known.

    Where only the attitude is measured (stills, MISB), force and rate are nan.
    """

    source: ClassVar[Source] = Source.IMU
    stamp_ns: int
    specific_force_b: Array  # (3,) FRD, m/s2; (0, 0, -9.8) at rest
    angular_rate_b: Array  # (3,) FRD, rad/s
    autopilot_q_nb: Array | None = None  # (4,) wxyz; None if the message marks it as absent

    @classmethod
    def of_attitude(cls, stamp_ns: int, q_nb: Array) -> ImuSample:
        """Return a sample of an attitude (4,) alone, body FRD to NED."""
        return cls(stamp_ns, np.full(3, math.nan), np.full(3, math.nan), q_nb)

    @property
    def is_attitude_alone(self) -> bool:
        """Return whether it has an attitude, but neither a force nor a rate."""
        if self.autopilot_q_nb is None or not math.isnan(self.angular_rate_b[0]):
            return False
        return all(map(math.isnan, (*self.angular_rate_b, *self.specific_force_b)))


@dataclass(frozen=True, slots=True)
class PositionSample:
    """Hold the satellite position of an antenna."""

    stamp_ns: int
    source: Source  # RTK_POSITION or GPS_POSITION
    status: FixStatus
    latitude_rad: float
    longitude_rad: float
    height_m: float  # ellipsoidal
    covariance_n: Array  # (3, 3) NED, m2


@dataclass(frozen=True, slots=True)
class VelocitySample:
    """Hold the satellite velocity of an antenna."""

    stamp_ns: int
    source: Source  # RTK_VELOCITY or GPS_VELOCITY
    velocity_n: Array  # (3,) NED, m/s
    covariance_n: Array  # (3, 3) NED, m2/s2


@dataclass(frozen=True, slots=True)
class HeadingSample:
    """Hold the heading that a receiver with two antennas measures."""

    source: ClassVar[Source] = Source.RTK_HEADING
    stamp_ns: int
    heading_rad: float  # 0 = true north, clockwise
    variance_rad2: float  # zero or negative: unknown


@dataclass(frozen=True, slots=True)
class AutopilotHeading:
    """Hold the heading from the autopilot's attitude, which the filter uses as a last resort."""

    source: ClassVar[Source] = Source.AUTOPILOT_HEADING
    stamp_ns: int
    heading_rad: float  # 0 = true north, clockwise
    variance_rad2: float


@dataclass(frozen=True, slots=True)
class PressureSample:
    """Hold the air pressure that a barometer measures."""

    source: ClassVar[Source] = Source.BAROMETER
    stamp_ns: int
    pressure_pa: float
    variance_pa2: float  # zero: unknown

    @property
    def fault(self) -> str:
        """Return why no aircraft can fly at this pressure, or an empty string."""
        if not 0 <= self.variance_pa2 < math.inf:
            return "variance is negative or not finite"
        least, most = PRESSURES_PA
        if least <= self.pressure_pa <= most:
            return ""
        return f"pressure is {self.pressure_pa:g} Pa, not {least:g} to {most:g} Pa"


@dataclass(frozen=True, slots=True)
class SetHeading:
    """Hold a heading of the nose that a person sets where nothing measures one."""

    source: ClassVar[Source] = Source.SET_HEADING
    stamp_ns: int
    heading_rad: float  # 0 = true north, clockwise
    variance_rad2: float  # zero or negative: not given

    @property
    def fault(self) -> str:
        """Return why the heading cannot be used, or an empty string."""
        finite = math.isfinite(self.heading_rad) and math.isfinite(self.variance_rad2)
        return "" if finite else "heading or its variance is not finite"


@dataclass(frozen=True, slots=True)
class Rest:
    """Hold the mean rate of the gyroscopes while the aircraft stands still, at its end."""

    source: ClassVar[Source] = Source.REST
    stamp_ns: int
    angular_rate_b: Array  # (3,) FRD, rad/s
    variance_b: Array  # (3,) (rad/s)^2


NavigationInput = (
    ImuSample | PositionSample | VelocitySample | HeadingSample | PressureSample | SetHeading
)


@dataclass(frozen=True, slots=True)
class JointSample:
    """Hold gimbal encoder angles: ``R_bg = Rz(yaw) Rx(roll) Ry(pitch)``, FRD axes, radians."""

    stamp_ns: int
    yaw_rad: float  # positive clockwise, seen from above
    roll_rad: float  # positive with the right side down
    pitch_rad: float  # positive with the camera up
    computed: bool = False  # computed from the reported attitudes, not measured by encoders


@dataclass(frozen=True, slots=True)
class CameraAttitudeSample:
    """Hold the camera attitude that the flight controller reports: camera body (FRD) to NED."""

    stamp_ns: int
    q_ng: Array  # (4,) wxyz
