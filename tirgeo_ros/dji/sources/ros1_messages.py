"""Convert messages of DJI's ROS 1 wrapper (since 3.3, and 4 under another prefix) to readings.

Not all of them are what their type or frame says: RTK's velocity is north, east, down; the order
of the gimbal's angles depends on how the wrapper is set up; heights are above the sea, or
barometric. Not read: ``acceleration_ground_fused``, ``angular_velocity_fused`` (in an uncertain
frame; ``imu`` has both raw), ``local_position`` (on a sphere), ``height_above_takeoff`` (from a
sonar), ``gps_health`` (0 until a home point is set), ``trigger_time`` (stamp and time reversed),
``rtk_connection_status`` (the flags say more).

A message is any object with the fields of its definition. Every function takes it and the stamp
that its reading is to have, and raises MessageError for invalid values.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from tirgeo_ros.core.frames.axes import quat_turned_both
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.dji.sources.readings import (
    AccelerationUnit,
    AttitudeReading,
    GeodeticPlace,
    GimbalReading,
    GpsReading,
    ImuOrigin,
    ImuReading,
    Quaternion,
    Reading,
    RtkReading,
    Vector,
)

#: Sigma of the fused position's height, which comes without an accuracy: it is barometric, and was
#: found to be more than 100 m off.
FUSED_HEIGHT_SIGMA_M = 100.0

_ABSENT = -1.0  # first entry of a covariance whose value is absent (sensor_msgs/Imu)
_LENGTH_TOLERANCE = 0.01  # of a unit quaternion; rounding alone makes 1e-7
_NO_PLACE_DEG = 1e-6  # a place nearer to 0, 0 means no place
_LARGEST_ANGLE_DEG = 720.0  # a gimbal's angle is within a turn; more is another unit or no angle
_GROUND_FRAME = "ground_ENU"


def imu(message: Any, stamp_ns: int) -> ImuReading:
    """Convert ``imu``: specific force (m/s2) and rate (rad/s) in FLU, attitude FLU to ENU.

    An invalid attitude is passed on, to be counted by the interpretation: the rest of the message
    may be good.
    """
    force = vector(message.linear_acceleration)
    rate = vector(message.angular_velocity)
    absent, q = message.orientation_covariance[0] == _ABSENT, message.orientation
    return ImuReading(
        stamp_ns,
        ImuOrigin.MESSAGE,
        (force[0], -force[1], -force[2]),
        AccelerationUnit.M_S2,
        (rate[0], -rate[1], -rate[2]),
        None if absent else quat_turned_both(q.w, q.x, q.y, q.z),
    )


def attitude(message: Any, stamp_ns: int) -> AttitudeReading:
    """Convert ``attitude``: FLU to ENU."""
    q = message.quaternion
    return AttitudeReading(stamp_ns, quat_turned_both(*unit(q.w, q.x, q.y, q.z)))


def velocity(message: Any, stamp_ns: int) -> GpsReading:
    """Convert ``velocity``: the fused one, east, north, up."""
    east, north, up = vector(message.vector)
    return GpsReading(stamp_ns, velocity_n=(north, east, -up))


def gps_position(message: Any, stamp_ns: int) -> GpsReading:
    """Convert ``gps_position``: the fused one.

    Its status is never set, so the fix stays unknown.
    """
    where = place_deg(message.latitude, message.longitude, message.altitude)
    return fused_position(where, stamp_ns)


def fused_position(where: GeodeticPlace, stamp_ns: int) -> GpsReading:
    """Return a reading of a position whose height is very uncertain."""
    return GpsReading(stamp_ns, where, vertical_sigma_m=FUSED_HEIGHT_SIGMA_M)


def rtk_position(message: Any, stamp_ns: int) -> RtkReading:
    """Convert ``rtk_position``: its altitude is above the sea."""
    return RtkReading(stamp_ns, place_deg(message.latitude, message.longitude, message.altitude))


def rtk_velocity(message: Any, stamp_ns: int) -> RtkReading:
    """Convert ``rtk_velocity``: north, east, down."""
    return RtkReading(stamp_ns, velocity_n=vector(message.vector))


def rtk_yaw(message: Any, stamp_ns: int) -> RtkReading:
    """Convert ``rtk_yaw``: whole degrees of the antennas' baseline."""
    return RtkReading(stamp_ns, yaw_deg=int(message.data))


def rtk_info_position(message: Any, stamp_ns: int) -> RtkReading:
    """Convert ``rtk_info_position``: the flag."""
    return RtkReading(stamp_ns, position_flag=int(message.data))


def rtk_info_yaw(message: Any, stamp_ns: int) -> RtkReading:
    """Convert ``rtk_info_yaw``: the flag."""
    return RtkReading(stamp_ns, yaw_flag=int(message.data))


def gimbal_angle(message: Any, stamp_ns: int) -> GimbalReading:
    """Convert ``gimbal_angle``: degrees in level axes.

    With subscription, which leaves the frame empty: pitch, roll, yaw. With broadcast, which calls
    it ground_ENU: roll, pitch, yaw.
    """
    first, second, yaw = vector(message.vector)
    frame = str(message.header.frame_id).rpartition("/")[2]
    if not frame:
        return gimbal_deg(stamp_ns, roll=second, pitch=first, yaw=yaw)
    if frame == _GROUND_FRAME:
        return gimbal_deg(stamp_ns, roll=first, pitch=second, yaw=yaw)
    raise MessageError(
        f"frame {frame!r} tells no order of the angles: it is empty or {_GROUND_FRAME}"
    )


#: Topic, type, and how its messages are read.
TOPICS: dict[str, tuple[str, Callable[[Any, int], Reading]]] = {
    "imu": ("sensor_msgs/msg/Imu", imu),
    "attitude": ("geometry_msgs/msg/QuaternionStamped", attitude),
    "velocity": ("geometry_msgs/msg/Vector3Stamped", velocity),
    "gps_position": ("sensor_msgs/msg/NavSatFix", gps_position),
    "rtk_position": ("sensor_msgs/msg/NavSatFix", rtk_position),
    "rtk_velocity": ("geometry_msgs/msg/Vector3Stamped", rtk_velocity),
    "rtk_yaw": ("std_msgs/msg/Int16", rtk_yaw),
    "rtk_info_position": ("std_msgs/msg/UInt8", rtk_info_position),
    "rtk_info_yaw": ("std_msgs/msg/UInt8", rtk_info_yaw),
    "gimbal_angle": ("geometry_msgs/msg/Vector3Stamped", gimbal_angle),
}


def gimbal_deg(stamp_ns: int, *, roll: float, pitch: float, yaw: float) -> GimbalReading:
    """Return a reading of the gimbal's angles in degrees."""
    angles = finite(roll, pitch, yaw)
    if max(map(abs, angles)) > _LARGEST_ANGLE_DEG:
        raise MessageError(f"no angles of a gimbal: {roll:g}, {pitch:g}, {yaw:g} deg")
    return GimbalReading(stamp_ns, *map(math.radians, angles))


def place_deg(latitude_deg: float, longitude_deg: float, height_m: float) -> GeodeticPlace:
    """Return a place on the earth."""
    latitude, longitude, height = finite(latitude_deg, longitude_deg, height_m)
    if abs(latitude) > 90 or abs(longitude) > 180:
        raise MessageError(f"no place on the earth: {latitude:g}, {longitude:g} deg")
    if max(abs(latitude), abs(longitude)) < _NO_PLACE_DEG:
        raise MessageError("no position yet: 0, 0 deg")
    return GeodeticPlace(math.radians(latitude), math.radians(longitude), height)


def vector(xyz: Any) -> Vector:
    """Convert a ``geometry_msgs/Vector3``; its numbers must be finite."""
    return finite(xyz.x, xyz.y, xyz.z)


def finite(x: float, y: float, z: float) -> Vector:
    """Return the three numbers. Raises MessageError if one of them is not finite."""
    if not math.isfinite(x + y + z):
        raise MessageError(f"not finite: {x:g}, {y:g}, {z:g}")
    return float(x), float(y), float(z)


def unit(w: float, x: float, y: float, z: float) -> Quaternion:
    """Return a quaternion of length 1. Raises MessageError for any other."""
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1) <= _LENGTH_TOLERANCE:
        raise MessageError(f"no attitude: a quaternion of length {length:g}")
    return float(w), float(x), float(y), float(z)
