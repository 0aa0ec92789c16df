"""Define the aircraft's readings before their interpretation: one record for all sources.

A source (the serial link, a capture, the topics of psdk_ros2, a bag of dji_sdk) converts axes,
units and order of the fields to the form given here. What needs knowledge of the aircraft is left
to ``dji.interpret``: flags, heights above sea level, the antennas' direction, repeats. Vectors are
tuples, since there are hundreds a second.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w, x, y, z


class AccelerationUnit(Enum):
    """List the units of an acceleration, as far as its source states them."""

    G = "g"
    M_S2 = "m/s2"
    UNKNOWN = "unknown"  # the broadcast's: as set in DJI Assistant 2


class ImuOrigin(Enum):
    """List the aircraft's streams of IMU readings; the better ones come first."""

    HARD_SYNC = "hard_sync"
    SUBSCRIPTION = "subscription"
    BROADCAST = "broadcast"
    MESSAGE = "message"  # a ROS message


class ImuReading(NamedTuple):
    """Hold specific force and rate of one instant, and the attitude of the message if any."""

    stamp_ns: int
    origin: ImuOrigin
    acceleration_b: Vector  # FRD, specific force in ``unit``: (0, 0, -1 g) at rest
    unit: AccelerationUnit
    angular_rate_b: Vector  # FRD, rad/s
    q_nb: Quaternion | None  # FRD to NED


class AttitudeReading(NamedTuple):
    """Hold the aircraft's attitude."""

    stamp_ns: int
    q_nb: Quaternion  # FRD to NED


class GeodeticPlace(NamedTuple):
    """Hold the position of an antenna."""

    latitude_rad: float
    longitude_rad: float
    height_msl_m: float  # above mean sea level


class GpsReading(NamedTuple):
    """Hold data of the ordinary GPS; the parts that a message has."""

    stamp_ns: int
    place: GeodeticPlace | None = None
    velocity_n: Vector | None = None  # NED, m/s
    fix: int | None = None  # 0 none, 1 dead reckoning, 2 2D, 3 3D, 4 GPS and DR, 5 time only
    horizontal_sigma_m: float | None = None
    vertical_sigma_m: float | None = None
    velocity_sigma_m_s: float | None = None


class RtkReading(NamedTuple):
    """Hold data of the RTK receiver of one epoch; the parts that a message has."""

    stamp_ns: int
    place: GeodeticPlace | None = None
    position_flag: int | None = None  # NovAtel's numbers; 50 = narrow-lane integer
    velocity_n: Vector | None = None  # NED, m/s
    yaw_deg: int | None = None  # deg, azimuth of the antennas' baseline, in any turn
    yaw_flag: int | None = None


class GimbalReading(NamedTuple):
    """Hold the gimbal's angles: yaw, then pitch, then roll, from level axes."""

    stamp_ns: int
    roll_rad: float  # right side down
    pitch_rad: float  # camera up
    yaw_rad: float  # clockwise, from north (or from the nose: ``gimbal_reference``)


Reading = ImuReading | AttitudeReading | GpsReading | RtkReading | GimbalReading
