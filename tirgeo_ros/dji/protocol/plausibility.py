"""Check whether a push can be what its package says: a wrong table may have the right length.

A topic is doubtful if it holds values that no aircraft could mean. The bounds are wide on purpose:
those of the physical world, or of what the protocol can express. Data that is merely bad is judged
elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from tirgeo_ros.dji.protocol.broadcast_parts import (
    Battery,
    GimbalAngles,
    GpsFused,
    GpsPosition,
    HardSync,
    RtkPosition,
    Velocity,
)
from tirgeo_ros.dji.protocol.subscription import Push

#: A unit quaternion of 32-bit numbers is off by 1e-7; the rest allows for the aircraft's sums.
QUATERNION_TOLERANCE = 1e-2

_MAX_SPEED_M_S = 150.0  # three times the speed of any of DJI's aircraft in the strongest wind
_MAX_ACCELERATION_G = 32.0  # the widest range of small accelerometers
_MAX_RATE_RAD_S = math.radians(4000)  # the widest range of small gyroscopes
_G = 9.81
_MAX_HEIGHT_M = 2e4
_MAX_ANGLE_DEG = 720.0  # however many turns an angle has counted
_MAX_PERCENT = 100
_MAX_LEVEL = 5


def doubtful(push: Push) -> list[str]:
    """Return the names of the topics that cannot be what the package says; usually none."""
    return [
        name
        for name, value in push.values.items()
        if (can_be := _CHECKS.get(name)) is not None and not can_be(value)
    ]


# Every comparison is false for NaN, which no working aircraft sends.


def _quaternion(q_wxyz: Sequence[float]) -> bool:
    w, x, y, z = q_wxyz
    return abs(math.sqrt(w * w + x * x + y * y + z * z) - 1.0) <= QUATERNION_TOLERANCE


def _within(bound: float) -> Callable[[Any], bool]:
    """Return a check that a number, or all numbers of a tuple, are at most ``bound`` in size."""

    def check(value: Any) -> bool:
        numbers = value if isinstance(value, tuple) else (value,)
        return all(abs(number) <= bound for number in numbers)

    return check


_rate = _within(_MAX_RATE_RAD_S)
_acceleration_g = _within(_MAX_ACCELERATION_G)
_acceleration = _within(_MAX_ACCELERATION_G * _G)
_speed = _within(_MAX_SPEED_M_S)
_speed_cmps = _within(_MAX_SPEED_M_S * 100)
_height = _within(_MAX_HEIGHT_M)
_level = _within(_MAX_LEVEL)


def _velocity(velocity: Velocity) -> bool:
    return _speed(velocity.xyz_mps)


def _hard_sync(sync: HardSync) -> bool:
    return _quaternion(sync.q_wxyz) and _acceleration_g(sync.accel_g) and _rate(sync.gyro_radps)


def _on_earth(latitude_deg: float, longitude_deg: float) -> bool:
    # A little beyond the limits, for values that were rounded on their way through radians.
    return abs(latitude_deg) <= 90.001 and abs(longitude_deg) <= 180.001


def _gps_fused(fused: GpsFused) -> bool:
    place = _on_earth(math.degrees(fused.lat_rad), math.degrees(fused.lon_rad))
    return place and _height(fused.altitude_m)


def _gps_position(position: GpsPosition) -> bool:
    # It is disputed which of the two is the latitude.
    x, y = position.x_raw * 1e-7, position.y_raw * 1e-7
    return (_on_earth(y, x) or _on_earth(x, y)) and _height(position.z_raw * 1e-3)


def _rtk_position(position: RtkPosition) -> bool:
    return _on_earth(position.lat_deg, position.lon_deg) and _height(position.hfsl_m)


def _date(yyyymmdd: int) -> bool:
    """Return whether it is a date, or 0 as before the satellites have sent one."""
    month, day = yyyymmdd // 100 % 100, yyyymmdd % 100
    return yyyymmdd == 0 or (yyyymmdd < 10**8 and 1 <= month <= 12 and 1 <= day <= 31)


def _time_of_day(hhmmss: int) -> bool:
    # 60 is a leap second.
    return hhmmss < 240000 and hhmmss // 100 % 100 < 60 and hhmmss % 100 <= 60


def _gimbal_angles(angles: GimbalAngles) -> bool:
    return all(abs(angle) <= _MAX_ANGLE_DEG for angle in angles)


def _battery(battery: Battery) -> bool:
    return battery.percentage <= _MAX_PERCENT


_CHECKS: dict[str, Callable[[Any], bool]] = {
    "QUATERNION": _quaternion,
    "ACCELERATION_GROUND": _acceleration,
    "ACCELERATION_BODY": _acceleration,
    "ACCELERATION_RAW": _acceleration,
    "VELOCITY": _velocity,
    "ANGULAR_RATE_FUSIONED": _rate,
    "ANGULAR_RATE_RAW": _rate,
    "ALTITUDE_FUSIONED": _height,
    "ALTITUDE_BAROMETER": _height,
    "GPS_FUSED": _gps_fused,
    "GPS_DATE": _date,
    "GPS_TIME": _time_of_day,
    "GPS_POSITION": _gps_position,
    "GPS_VELOCITY": _speed_cmps,
    "RTK_POSITION": _rtk_position,
    "RTK_VELOCITY": _speed_cmps,
    "RTK_YAW": _within(_MAX_ANGLE_DEG),
    "GIMBAL_ANGLES": _gimbal_angles,
    "BATTERY_INFO": _battery,
    "HARD_SYNC": _hard_sync,
    "GPS_CONTROL_LEVEL": _level,
    "GPS_SIGNAL_LEVEL": _level,
}
