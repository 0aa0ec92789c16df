"""Define the topics of the subscription: number, rate, bytes and meaning of each.

Names, numbers and structures are those of DJI's Onboard SDK 3.9; the values are of
``dji.protocol.broadcast_parts``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from tirgeo_ros.dji.protocol import broadcast_parts as parts
from tirgeo_ros.dji.protocol.packed_fields import Make


class Topic(NamedTuple):
    """Hold one topic.

    ``make`` converts its numbers to a type of ``dji.protocol.broadcast_parts``.
    """

    name: str
    uid: int
    max_hz: int | None  # None where it is not documented
    form: str  # as in ``struct``, without its byte order
    make: Make


def _number(v: tuple[Any, ...]) -> Any:
    return v[0]


#: Every topic that can be read. Vectors are tuples, single numbers are plain.
TOPICS = (
    Topic("QUATERNION", 0xA493281F, 200, "4f", tuple),  # w, x, y, z; FRD to NED
    Topic("ACCELERATION_GROUND", 0x8696C85B, 200, "3f", tuple),  # m/s2, north-east-up
    Topic("ACCELERATION_BODY", 0xBB17D5FE, 200, "3f", tuple),  # m/s2, forward-right-up
    Topic("ACCELERATION_RAW", 0xC3503A6E, 400, "3f", tuple),  # m/s2, FRD
    Topic(
        "VELOCITY", 0x18FB271D, 200, "3fB", lambda v: parts.Velocity(v[:3], v[3])
    ),  # north-east-up
    Topic("ANGULAR_RATE_FUSIONED", 0x3599C4BE, 200, "3f", tuple),  # rad/s, its axes are disputed
    Topic("ANGULAR_RATE_RAW", 0x700389EE, 400, "3f", tuple),  # rad/s, FRD
    Topic("ALTITUDE_FUSIONED", 0x11E9C81A, 200, "f", _number),  # m, by pressure
    Topic("ALTITUDE_BAROMETER", 0x27396A39, 200, "f", _number),  # m
    Topic("HEIGHT_FUSION", 0x87CF419D, 100, "f", _number),  # m above what is below
    Topic("GPS_FUSED", 0x4B19A8C7, 50, "2dfH", parts.GpsFused._make),
    Topic("GPS_DATE", 0x598F79BC, 5, "I", _number),  # yyyymmdd
    Topic("GPS_TIME", 0xD48912C9, 5, "I", _number),  # hhmmss
    Topic("GPS_POSITION", 0x0C949E94, 5, "3i", parts.GpsPosition._make),
    Topic("GPS_VELOCITY", 0x7AC7EB80, 5, "3f", tuple),  # cm/s, NED
    Topic("GPS_DETAILS", 0x81FED54E, 5, "6f2I2H", parts.GpsDetail._make),
    Topic("RTK_POSITION", 0x1DF9A6B6, 5, "2df", parts.RtkPosition._make),
    Topic("RTK_VELOCITY", 0x763D13C3, 5, "3f", tuple),  # cm/s, NED
    Topic("RTK_YAW", 0xF45D73FD, 5, "h", _number),  # deg, azimuth of the antennas' baseline
    Topic("RTK_POSITION_INFO", 0xDA4A57B5, 5, "B", _number),
    Topic("RTK_YAW_INFO", 0xCB72B9E3, 5, "B", _number),
    Topic("COMPASS", 0xDF3D72B7, 100, "3h", tuple),
    Topic("RC", 0x739F7FE4, 50, "6h", parts.Rc._make),
    Topic("GIMBAL_ANGLES", 0x01F71678, 50, "3f", parts.GimbalAngles._make),
    Topic("GIMBAL_STATUS", 0x8B6CD45C, 50, "I", _number),  # bits
    Topic("GIMBAL_CONTROL_MODE", 0x326A446D, 50, "B", _number),
    Topic("STATUS_FLIGHT", 0x20CFB02A, 50, "B", _number),
    Topic("STATUS_DISPLAYMODE", 0x1A67D6A1, 50, "B", _number),
    Topic("BATTERY_INFO", 0x69779DD9, 50, "I2iB", parts.Battery._make),
    Topic(
        "HARD_SYNC",
        0xECBEF06D,
        400,
        "3IHB4f3f3f",
        lambda v: parts.HardSync._make((*v[:5], v[5:9], v[9:12], v[12:])),
    ),
    Topic("GPS_CONTROL_LEVEL", 0xE30B17B0, 50, "B", _number),
    Topic("GPS_SIGNAL_LEVEL", 0xA6A0395F, 50, "B", _number),
    Topic("RTK_CONNECT_STATUS", 0x6F349326, 50, "H", _number),  # bit 0
    Topic("HEIGHT_HOMEPOINT", 0x252C164B, 1, "f", _number),  # m
    Topic("HOME_POINT_SET_STATUS", 0xB5C2211F, None, "B", _number),
    Topic("HOME_POINT_INFO", 0xBFE4B520, None, "2d", tuple),  # latitude and longitude, rad
    Topic("STATUS_LANDINGGEAR", 0x772D6E22, 50, "B", _number),
    Topic("STATUS_MOTOR_START_ERROR", 0x3A41E909, 50, "H", _number),
    Topic("CONTROL_DEVICE", 0x667BA86A, 50, "2B", parts.Device._make),
    Topic("RC_FULL_RAW_DATA", 0x16EC4D0E, None, "22h", tuple),
    Topic("RC_WITH_FLAG_DATA", 0xFE04CFCD, None, "4fB", tuple),
    Topic("ESC_DATA", 0xAAA0F589, None, "2hHhH" * 8, tuple),  # of each motor
    Topic("FLIGHT_ANOMALY", 0x0A624B4B, None, "I", _number),  # bits
    Topic("POSITION_VO", 0xD3462697, None, "3fB", tuple),  # m, NED of its own start; health
    Topic("AVOID_DATA", 0xF6405DAA, None, "6fB", parts.RelativePosition._make),
)

BY_NAME = {topic.name: topic for topic in TOPICS}
BY_UID = {topic.uid: topic for topic in TOPICS}
