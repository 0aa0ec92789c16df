"""Convert messages of DJI's ROS 1 wrappers to readings.

Not all of them are what their type or frame says: RTK's velocity is north, east, down; the order
of the gimbal's angles depends on how the wrapper is set up; heights are above the sea, or
barometric. Not read: ``acceleration_ground_fused``, ``angular_velocity_fused`` (in an uncertain
frame; ``imu`` has both raw), ``local_position`` (on a sphere), ``height_above_takeoff`` (from a
sonar), ``gps_health`` (0 until a home point is set), ``trigger_time`` (stamp and time reversed),
``rtk_connection_status`` (the flags say more).

The wrapper from before REP 103 (3.1.9, 3.2) has types of its own, in NED and FRD. ``A3_RTK`` and
``A3_GPS`` have no header and come with each packet of the aircraft, whether it has new values or
not. The yaw of ``A3_RTK`` counts from south by the comment in its definition, from north by DJI's
later documents; in either case the direction of the antennas is a parameter that is checked
against the attitude. Other definitions of the same types, of versions in between, lack fields that
are read here; their messages are refused.

A message is any object with the fields of its definition. A reader takes it and the stamp that its
reading is to have, and raises MessageError for invalid values.
"""

from __future__ import annotations

import math
from collections import OrderedDict
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
#: Acceleration and attitude of one packet come within this many messages of each other.
_WAITING = 20


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
    return AttitudeReading(stamp_ns, quat_turned_both(*_unit(q.w, q.x, q.y, q.z)))


def _velocity_enu(message: Any, stamp_ns: int) -> GpsReading:
    east, north, up = _vector(message.vector)
    return GpsReading(stamp_ns, velocity_n=(north, east, -up))


def _fused_position(message: Any, stamp_ns: int) -> GpsReading:
    """Convert a fused position: its status is never set, its height is very uncertain."""
    return GpsReading(stamp_ns, _fix(message), vertical_sigma_m=FUSED_HEIGHT_SIGMA_M)


def _gimbal_angle(message: Any, stamp_ns: int) -> GimbalReading:
    """Convert ``gimbal_angle``: degrees in level axes.

    With subscription, which leaves the frame empty: pitch, roll, yaw. With broadcast, which calls
    it ground_ENU: roll, pitch, yaw.
    """
    first, second, yaw = _vector(message.vector)
    frame = str(message.header.frame_id).rpartition("/")[2]
    if frame and frame != _GROUND_FRAME:
        raise MessageError(
            f"frame {frame!r} tells no order of the angles: it is empty or {_GROUND_FRAME}"
        )
    roll, pitch = (first, second) if frame else (second, first)
    return _gimbal_deg(stamp_ns, roll, pitch, yaw)


def _a3_gps(message: Any, stamp_ns: int) -> GpsReading:
    """Convert ``A3_GPS``: 1e-7 deg, mm above the sea, cm/s north, east, down."""
    m = message
    where = _place_deg(m.latitude * 1e-7, m.longitude * 1e-7, m.height_above_sea * 1e-3)
    return GpsReading(stamp_ns, where, _a3_velocity(m))


def _a3_rtk(message: Any, stamp_ns: int) -> RtkReading:
    """Convert ``A3_RTK``: deg, m above the sea, cm/s north, east, down, whole degrees."""
    m = message
    return RtkReading(
        stamp_ns,
        _place_deg(m.latitude_RTK, m.longitude_RTK, m.height_above_sea_RTK),
        int(m.position_flag),
        _a3_velocity(m),
        int(m.yaw),
        int(m.yaw_flag),
    )


def _a3_velocity(message: Any) -> Vector:
    m = message
    north, east, down = _finite(m.velocity_north, m.velocity_east, m.velocity_ground)
    return north * 1e-2, east * 1e-2, down * 1e-2


Reader = Callable[[Any, int], Reading]
#: How the messages of a topic and type are read; fields of RTK's messages are NED and degrees.
READERS: dict[tuple[str, str], Reader] = {
    ("imu", "sensor_msgs/msg/Imu"): _imu,
    ("attitude", "geometry_msgs/msg/QuaternionStamped"): _attitude,
    ("velocity", "geometry_msgs/msg/Vector3Stamped"): _velocity_enu,
    ("gps_position", "sensor_msgs/msg/NavSatFix"): _fused_position,
    ("rtk_position", "sensor_msgs/msg/NavSatFix"): lambda m, t: RtkReading(t, _fix(m)),
    ("rtk_velocity", "geometry_msgs/msg/Vector3Stamped"): (
        lambda m, t: RtkReading(t, velocity_n=_vector(m.vector))
    ),
    ("rtk_yaw", "std_msgs/msg/Int16"): lambda m, t: RtkReading(t, yaw_deg=int(m.data)),
    ("rtk_info_position", "std_msgs/msg/UInt8"): (
        lambda m, t: RtkReading(t, position_flag=int(m.data))
    ),
    ("rtk_info_yaw", "std_msgs/msg/UInt8"): lambda m, t: RtkReading(t, yaw_flag=int(m.data)),
    ("gimbal_angle", "geometry_msgs/msg/Vector3Stamped"): _gimbal_angle,
    ("attitude_quaternion", "dji_sdk/msg/AttitudeQuaternion"): (
        lambda m, t: AttitudeReading(t, _unit(m.q0, m.q1, m.q2, m.q3))
    ),
    ("global_position", "dji_sdk/msg/GlobalPosition"): _fused_position,
    ("velocity", "dji_sdk/msg/Velocity"): (
        lambda m, t: GpsReading(t, velocity_n=_finite(m.vx, m.vy, m.vz))
    ),
    ("gimbal", "dji_sdk/msg/Gimbal"): lambda m, t: _gimbal_deg(t, m.roll, m.pitch, m.yaw),
    ("A3_GPS", "dji_sdk/msg/A3GPS"): _a3_gps,
    ("A3_RTK", "dji_sdk/msg/A3RTK"): _a3_rtk,
}
#: A topic that is read only together with ``attitude_quaternion``.
ACCELERATION = ("acceleration", "dji_sdk/msg/Acceleration")


class OlderImu:
    """Combine acceleration and rate of one packet, which come on two topics.

    Both have the same stamp. The acceleration is in the unit that DJI Assistant 2 is set to.
    """

    def __init__(self) -> None:
        self._rates: OrderedDict[int, tuple[Vector, Quaternion]] = OrderedDict()
        self._accelerations: OrderedDict[int, Vector] = OrderedDict()

    def attitude_quaternion(self, message: Any, stamp_ns: int) -> list[ImuReading]:
        """Take the rate (rad/s, FRD) and the attitude."""
        q_nb = _unit(message.q0, message.q1, message.q2, message.q3)
        self._rates[stamp_ns] = _finite(message.wx, message.wy, message.wz), q_nb
        return self._paired(stamp_ns)

    def acceleration(self, message: Any, stamp_ns: int) -> list[ImuReading]:
        """Take the acceleration (FRD)."""
        self._accelerations[stamp_ns] = _finite(message.ax, message.ay, message.az)
        return self._paired(stamp_ns)

    def _paired(self, stamp_ns: int) -> list[ImuReading]:
        if stamp_ns not in self._rates or stamp_ns not in self._accelerations:
            for waiting in (self._rates, self._accelerations):
                while len(waiting) > _WAITING:
                    waiting.popitem(last=False)
            return []
        (rate, q_nb), force = self._rates.pop(stamp_ns), self._accelerations.pop(stamp_ns)
        unknown = AccelerationUnit.UNKNOWN
        return [ImuReading(stamp_ns, ImuOrigin.MESSAGE, force, unknown, rate, q_nb)]


def _gimbal_deg(stamp_ns: int, roll: float, pitch: float, yaw: float) -> GimbalReading:
    angles = _finite(roll, pitch, yaw)
    if max(map(abs, angles)) > _LARGEST_ANGLE_DEG:
        raise MessageError(f"no angles of a gimbal: {roll:g}, {pitch:g}, {yaw:g} deg")
    return GimbalReading(stamp_ns, *map(math.radians, angles))


def _fix(message: Any) -> GeodeticPlace:
    return _place_deg(message.latitude, message.longitude, message.altitude)


def _place_deg(latitude_deg: float, longitude_deg: float, height_m: float) -> GeodeticPlace:
    latitude, longitude, height = _finite(latitude_deg, longitude_deg, height_m)
    if abs(latitude) > 90 or abs(longitude) > 180:
        raise MessageError(f"no place on the earth: {latitude:g}, {longitude:g} deg")
    if max(abs(latitude), abs(longitude)) < _NO_PLACE_DEG:
        raise MessageError("no position yet: 0, 0 deg")
    return GeodeticPlace(math.radians(latitude), math.radians(longitude), height)


def _vector(xyz: Any) -> Vector:
    return _finite(xyz.x, xyz.y, xyz.z)


def _finite(x: float, y: float, z: float) -> Vector:
    if not math.isfinite(x + y + z):
        raise MessageError(f"not finite: {x:g}, {y:g}, {z:g}")
    return float(x), float(y), float(z)


def _unit(w: float, x: float, y: float, z: float) -> Quaternion:
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1) <= _LENGTH_TOLERANCE:
        raise MessageError(f"no attitude: a quaternion of length {length:g}")
    return float(w), float(x), float(y), float(z)
