"""Check whether a push can be what its package says: a wrong table may have the right length.

A topic is doubtful if it holds values that no aircraft could mean. The bounds are wide on purpose:
those of the physical world, or of what the protocol can express. Data that is merely bad is judged
elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from tirgeo_ros.dji.protocol.broadcast_parts import GpsPosition, HardSync
from tirgeo_ros.dji.protocol.subscription import Push

#: A unit quaternion of 32-bit numbers is off by 1e-7; the rest allows for the aircraft's sums.
QUATERNION_TOLERANCE = 1e-2

_MAX_SPEED_M_S = 150.0  # three times the speed of any of DJI's aircraft in the strongest wind
_MAX_ACCELERATION_G = 32.0  # the widest range of small accelerometers
_MAX_RATE_RAD_S = math.radians(4000)  # the widest range of small gyroscopes
_G = 9.81
_MAX_HEIGHT_M = 2e4
_MAX_ANGLE_DEG = 720.0  # however many turns an angle has counted
_MAX_LEVEL = 5


def doubtful(push: Push) -> list[str]:
    """Return the names of the topics that cannot be what the package says; usually none."""
    return [name for name, value in push.values.items() if not _can_be(name, value)]


def _can_be(name: str, value: Any) -> bool:
    bound = _BOUNDS.get(name)
    if bound is not None:
        return _within(bound, value)
    check = _CHECKS.get(name)
    return check is None or check(value)


# Every comparison is false for NaN, which no working aircraft sends.


def _within(bound: float, value: Any) -> bool:
    """Return whether a number, or all numbers of a tuple, are at most ``bound`` in size."""
    numbers = value if isinstance(value, tuple) else (value,)
    return all(abs(number) <= bound for number in numbers)


def _is_unit(q_wxyz: Sequence[float]) -> bool:
    return abs(math.hypot(*q_wxyz) - 1.0) <= QUATERNION_TOLERANCE


def _hard_sync(sync: HardSync) -> bool:
    moves = _within(_MAX_ACCELERATION_G, sync.accel_g) and _within(
        _MAX_RATE_RAD_S, sync.gyro_radps
    )
    return moves and _is_unit(sync.q_wxyz)


def _is_place(latitude_deg: float, longitude_deg: float, height_m: float) -> bool:
    # A little beyond the limits, for values that were rounded on their way through radians.
    on_earth = abs(latitude_deg) <= 90.001 and abs(longitude_deg) <= 180.001
    return on_earth and abs(height_m) <= _MAX_HEIGHT_M


def _gps_position(position: GpsPosition) -> bool:
    # It is disputed which of the two is the latitude.
    x, y, z = position.x_raw * 1e-7, position.y_raw * 1e-7, position.z_raw * 1e-3
    return _is_place(y, x, z) or _is_place(x, y, z)


def _is_date(yyyymmdd: int) -> bool:
    """Return whether it is a date, or 0 as before the satellites have sent one."""
    month, day = yyyymmdd // 100 % 100, yyyymmdd % 100
    return yyyymmdd == 0 or (yyyymmdd < 10**8 and 1 <= month <= 12 and 1 <= day <= 31)


def _is_time_of_day(hhmmss: int) -> bool:
    # 60 is a leap second.
    return hhmmss < 240000 and hhmmss // 100 % 100 < 60 and hhmmss % 100 <= 60


#: Largest size of each of a topic's numbers.
_BOUNDS = {
    "ACCELERATION_GROUND": _MAX_ACCELERATION_G * _G,
    "ACCELERATION_BODY": _MAX_ACCELERATION_G * _G,
    "ACCELERATION_RAW": _MAX_ACCELERATION_G * _G,
    "ANGULAR_RATE_FUSIONED": _MAX_RATE_RAD_S,
    "ANGULAR_RATE_RAW": _MAX_RATE_RAD_S,
    "ALTITUDE_FUSIONED": _MAX_HEIGHT_M,
    "ALTITUDE_BAROMETER": _MAX_HEIGHT_M,
    "GPS_VELOCITY": _MAX_SPEED_M_S * 100,
    "RTK_VELOCITY": _MAX_SPEED_M_S * 100,
    "RTK_YAW": _MAX_ANGLE_DEG,
    "GIMBAL_ANGLES": _MAX_ANGLE_DEG,
    "GPS_CONTROL_LEVEL": _MAX_LEVEL,
    "GPS_SIGNAL_LEVEL": _MAX_LEVEL,
}
_CHECKS: dict[str, Callable[[Any], bool]] = {
    "QUATERNION": _is_unit,
    "VELOCITY": lambda velocity: _within(_MAX_SPEED_M_S, velocity.xyz_mps),
    "GPS_FUSED": lambda fused: _is_place(
        math.degrees(fused.lat_rad), math.degrees(fused.lon_rad), fused.altitude_m
    ),
    "GPS_DATE": _is_date,
    "GPS_TIME": _is_time_of_day,
    "GPS_POSITION": _gps_position,
    "RTK_POSITION": lambda place: _is_place(place.lat_deg, place.lon_deg, place.hfsl_m),
    "BATTERY_INFO": lambda battery: battery.percentage <= 100,
    "HARD_SYNC": _hard_sync,
}
