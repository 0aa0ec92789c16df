"""Define what sensors say: immutable records with stamps, frames and units.

All stamps are integer nanoseconds of the measurement. Frames as in the charter
(``tirgeo_ros/__init__.py``). Arrays are float64 unless said otherwise.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from enum import Enum, IntEnum

from tirgeo_ros.core.types.arrays import Array


class FixStatus(IntEnum):
    """Quality of a satellite fix, numbered as the status of ``rtk/fix``."""

    NONE = -1
    SINGLE = 0
    FLOAT = 1
    FIXED = 2


class Source(Enum):
    """Where a sample comes from; the value is its name in diagnostics and verdicts."""

    IMU = "imu"
    RTK_POSITION = "rtk_position"
    RTK_VELOCITY = "rtk_velocity"
    RTK_HEADING = "rtk_heading"
    GPS_POSITION = "gps_position"
    GPS_VELOCITY = "gps_velocity"
    AUTOPILOT_HEADING = "autopilot_heading"

    # Members are single objects: Enum's own hash, of the name, costs ten times as much.
    __hash__ = object.__hash__


@dataclass(frozen=True, slots=True)
class ImuSample:
    """Body specific force and rate at ``stamp_ns``, with the autopilot's own attitude if known."""

    stamp_ns: int
    specific_force_b: Array  # (3,) FRD, m/s2; (0, 0, -9.8) at rest
    angular_rate_b: Array  # (3,) FRD, rad/s
    autopilot_q_nb: Array | None = None  # (4,) wxyz; None where the message says it is absent


@dataclass(frozen=True, slots=True)
class PositionSample:
    """A satellite position of an antenna."""

    stamp_ns: int
    source: Source  # RTK_POSITION or GPS_POSITION
    status: FixStatus
    latitude_rad: float
    longitude_rad: float
    height_m: float  # ellipsoidal
    covariance_n: Array  # (3, 3) NED, m2


@dataclass(frozen=True, slots=True)
class VelocitySample:
    """A satellite velocity of an antenna."""

    stamp_ns: int
    source: Source  # RTK_VELOCITY or GPS_VELOCITY
    velocity_n: Array  # (3,) NED, m/s
    covariance_n: Array  # (3, 3) NED, m2/s2


@dataclass(frozen=True, slots=True)
class HeadingSample:
    """The heading that two antennas give."""

    stamp_ns: int
    heading_rad: float  # 0 = true north, clockwise
    variance_rad2: float  # not positive: not known


@dataclass(frozen=True, slots=True)
class AutopilotHeading:
    """The nose's azimuth by the autopilot's own attitude; the filter's last resort."""

    stamp_ns: int
    heading_rad: float  # 0 = true north, clockwise
    variance_rad2: float


NavigationInput = ImuSample | PositionSample | VelocitySample | HeadingSample


JOINTS = ("yaw", "roll", "pitch")
#: Orders in which a gimbal's joints may follow each other, aircraft to camera; the usual first.
JOINT_ORDERS = tuple("-".join(order) for order in itertools.permutations(JOINTS))
USUAL_ORDER = JOINT_ORDERS[0]


@dataclass(frozen=True, slots=True)
class JointSample:
    """Gimbal encoder angles: ``R_bg = Rz(yaw) Rx(roll) Ry(pitch)``, FRD axes, radians."""

    stamp_ns: int
    yaw_rad: float  # clockwise from above
    roll_rad: float  # right side down
    pitch_rad: float  # camera up
    computed: bool = False  # from the reported attitudes: no encoder saw them


@dataclass(frozen=True, slots=True)
class CameraAttitudeSample:
    """Camera attitude as the flight controller reports it: camera body (FRD) to NED."""

    stamp_ns: int
    q_ng: Array  # (4,) wxyz
