"""Convert messages of the wrapper from before REP 103 (3.1.9, 3.2) to readings: NED and FRD.

They have types of their own. ``A3_RTK`` and ``A3_GPS`` have no header and come with each packet of
the aircraft, whether it has new values or not. The yaw of ``A3_RTK`` counts from south by the
comment in its definition, from north by DJI's later documents; in either case the direction of the
antennas is a parameter that is checked against the attitude. Other definitions of the same types,
of versions in between, lack fields that are read here; their messages are refused.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from tirgeo_ros.dji.sources.readings import (
    AccelerationUnit,
    AttitudeReading,
    GimbalReading,
    GpsReading,
    ImuOrigin,
    ImuReading,
    Quaternion,
    Reading,
    RtkReading,
    Vector,
)
from tirgeo_ros.dji.sources.ros1_messages import (
    finite,
    fused_position,
    gimbal_deg,
    place_deg,
    unit,
)

#: Acceleration and attitude of one packet come within this many messages of each other.
_WAITING = 20


def attitude_quaternion(message: Any, stamp_ns: int) -> AttitudeReading:
    """Convert ``attitude_quaternion``: FRD to NED."""
    return AttitudeReading(stamp_ns, unit(message.q0, message.q1, message.q2, message.q3))


def global_position(message: Any, stamp_ns: int) -> GpsReading:
    """Convert ``global_position``: degrees; fused, with barometric height."""
    where = place_deg(message.latitude, message.longitude, message.altitude)
    return fused_position(where, stamp_ns)


def velocity(message: Any, stamp_ns: int) -> GpsReading:
    """Convert ``velocity``: north, east, down."""
    return GpsReading(stamp_ns, velocity_n=finite(message.vx, message.vy, message.vz))


def gimbal(message: Any, stamp_ns: int) -> GimbalReading:
    """Convert ``gimbal``: degrees in level axes."""
    return gimbal_deg(stamp_ns, roll=message.roll, pitch=message.pitch, yaw=message.yaw)


def a3_gps(message: Any, stamp_ns: int) -> GpsReading:
    """Convert ``A3_GPS``: 1e-7 deg, mm above the sea, cm/s north, east, down."""
    height_m = message.height_above_sea * 1e-3
    where = place_deg(message.latitude * 1e-7, message.longitude * 1e-7, height_m)
    return GpsReading(stamp_ns, where, _velocity(message))


def a3_rtk(message: Any, stamp_ns: int) -> RtkReading:
    """Convert ``A3_RTK``: deg, m above the sea, cm/s north, east, down, whole degrees."""
    return RtkReading(
        stamp_ns,
        place_deg(message.latitude_RTK, message.longitude_RTK, message.height_above_sea_RTK),
        int(message.position_flag),
        _velocity(message),
        int(message.yaw),
        int(message.yaw_flag),
    )


def _velocity(message: Any) -> Vector:
    north, east, down = finite(
        message.velocity_north, message.velocity_east, message.velocity_ground
    )
    return north * 1e-2, east * 1e-2, down * 1e-2


#: Topic, type, and how its messages are read.
TOPICS: dict[str, tuple[str, Callable[[Any, int], Reading]]] = {
    "attitude_quaternion": ("dji_sdk/msg/AttitudeQuaternion", attitude_quaternion),
    "global_position": ("dji_sdk/msg/GlobalPosition", global_position),
    "velocity": ("dji_sdk/msg/Velocity", velocity),
    "gimbal": ("dji_sdk/msg/Gimbal", gimbal),
    "A3_GPS": ("dji_sdk/msg/A3GPS", a3_gps),
    "A3_RTK": ("dji_sdk/msg/A3RTK", a3_rtk),
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
        q_nb = unit(message.q0, message.q1, message.q2, message.q3)
        self._rates[stamp_ns] = finite(message.wx, message.wy, message.wz), q_nb
        return self._paired(stamp_ns)

    def acceleration(self, message: Any, stamp_ns: int) -> list[ImuReading]:
        """Take the acceleration (FRD)."""
        self._accelerations[stamp_ns] = finite(message.ax, message.ay, message.az)
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
