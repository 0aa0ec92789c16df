"""Convert messages of DJI's ROS 1 wrapper (dji_sdk 3.3 and later) to readings.

Not all of them are what their type or frame says: RTK's velocity is north, east, down; the order
of the gimbal's angles depends on how the wrapper is set up; heights are above the sea, or
barometric. Not read: ``acceleration_ground_fused``, ``angular_velocity_fused`` (in an uncertain
frame; ``imu`` has both raw), ``local_position`` (on a sphere), ``height_above_takeoff`` (from a
sonar), ``gps_health`` (0 until a home point is set), ``trigger_time`` (stamp and time reversed),
``rtk_connection_status`` (the flags say more).

A message is any object with the fields of its definition. A reader takes it and the stamp that its
reading is to have, and raises MessageError for invalid values.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

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


def _imu(message: Any, stamp_ns: int) -> ImuReading:
    """Convert ``imu``: specific force (m/s2) and rate (rad/s) in FLU, attitude FLU to ENU.

    An invalid attitude is passed on, to be counted by the interpretation: the rest of the message
    may be good.
    """
    x, y, z = _vector(message.linear_acceleration)
    p, q, r = _vector(message.angular_velocity)
    absent, turn = message.orientation_covariance[0] == _ABSENT, message.orientation
    q_nb = None if absent else quat_turned_both(turn.w, turn.x, turn.y, turn.z)
    unit, origin = AccelerationUnit.M_S2, ImuOrigin.MESSAGE
    return ImuReading(stamp_ns, origin, (x, -y, -z), unit, (p, -q, -r), q_nb)


def _attitude(message: Any, stamp_ns: int) -> AttitudeReading:
    """Convert ``attitude``: FLU to ENU."""
    q = message.quaternion
    length = math.hypot(q.w, q.x, q.y, q.z)
    if not abs(length - 1) <= _LENGTH_TOLERANCE:
        raise MessageError(f"not an attitude: a quaternion of length {length:g}")
    return AttitudeReading(stamp_ns, quat_turned_both(q.w, q.x, q.y, q.z))


def _velocity_enu(message: Any, stamp_ns: int) -> GpsReading:
    east, north, up = _vector(message.vector)
    return GpsReading(stamp_ns, velocity_n=(north, east, -up))


def _gimbal_angle(message: Any, stamp_ns: int) -> GimbalReading:
    """Convert ``gimbal_angle``: degrees in level axes.

    With subscription, which leaves the frame empty: pitch, roll, yaw. With broadcast, which calls
    it ground_ENU: roll, pitch, yaw.
    """
    first, second, yaw = _vector(message.vector)
    frame = str(message.header.frame_id).rpartition("/")[2]
    if frame and frame != _GROUND_FRAME:
        raise MessageError(
            f"frame {frame!r} does not name the order of the angles: it must be empty or "
            f"{_GROUND_FRAME}"
        )
    roll, pitch = (first, second) if frame else (second, first)
    if max(abs(roll), abs(pitch), abs(yaw)) > _LARGEST_ANGLE_DEG:
        raise MessageError(f"not angles of a gimbal: {roll:g}, {pitch:g}, {yaw:g} deg")
    return GimbalReading(stamp_ns, *map(math.radians, (roll, pitch, yaw)))


def _place(message: Any) -> GeodeticPlace:
    latitude, longitude, height = _finite(message.latitude, message.longitude, message.altitude)
    if abs(latitude) > 90 or abs(longitude) > 180:
        raise MessageError(f"not a place on the Earth: {latitude:g}, {longitude:g} deg")
    if max(abs(latitude), abs(longitude)) < _NO_PLACE_DEG:
        raise MessageError("no position yet: 0, 0 deg")
    return GeodeticPlace(math.radians(latitude), math.radians(longitude), height)


def _vector(xyz: Any) -> Vector:
    return _finite(xyz.x, xyz.y, xyz.z)


def _finite(x: float, y: float, z: float) -> Vector:
    if not math.isfinite(x + y + z):
        raise MessageError(f"not finite: {x:g}, {y:g}, {z:g}")
    return float(x), float(y), float(z)


class Ros1Topic(NamedTuple):
    """Hold the type of one of the wrapper's topics, what it becomes, and how it is read."""

    typename: str
    feeds: tuple[str, ...]  # topics of the contract
    read: Callable[[Any, int], Reading]


_FIX, _VECTOR = "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/Vector3Stamped"
#: The topics that are read, by their names in the wrapper; RTK's are NED and degrees.
TOPICS: dict[str, Ros1Topic] = {
    "imu": Ros1Topic("sensor_msgs/msg/Imu", ("imu/data",), _imu),
    "attitude": Ros1Topic(
        "geometry_msgs/msg/QuaternionStamped", ("gimbal/joint_states",), _attitude
    ),
    "velocity": Ros1Topic(_VECTOR, ("gps/vel",), _velocity_enu),
    "gps_position": Ros1Topic(
        _FIX,
        ("gps/fix",),
        lambda m, t: GpsReading(t, _place(m), vertical_sigma_m=FUSED_HEIGHT_SIGMA_M),
    ),
    "rtk_position": Ros1Topic(_FIX, ("rtk/fix",), lambda m, t: RtkReading(t, _place(m))),
    "rtk_velocity": Ros1Topic(
        _VECTOR, ("rtk/vel",), lambda m, t: RtkReading(t, velocity_n=_vector(m.vector))
    ),
    "rtk_yaw": Ros1Topic(
        "std_msgs/msg/Int16", ("rtk/heading",), lambda m, t: RtkReading(t, yaw_deg=int(m.data))
    ),
    "rtk_info_position": Ros1Topic(
        "std_msgs/msg/UInt8",
        ("rtk/fix", "rtk/vel"),
        lambda m, t: RtkReading(t, position_flag=int(m.data)),
    ),
    "rtk_info_yaw": Ros1Topic(
        "std_msgs/msg/UInt8", ("rtk/heading",), lambda m, t: RtkReading(t, yaw_flag=int(m.data))
    ),
    "gimbal_angle": Ros1Topic(_VECTOR, ("gimbal/attitude", "gimbal/joint_states"), _gimbal_angle),
}
#: What an import should have.
NEEDED = ("imu", "rtk_position", "rtk_yaw", "gimbal_angle")
