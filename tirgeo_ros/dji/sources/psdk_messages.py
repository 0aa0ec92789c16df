"""Convert what psdk_ros2 (M300, M350) sends to readings or parts of them: plain numbers in.

Some of its topics are not what their type or frame says; the names here state the axes of the
input. Not read: ``home_point`` (radians in fields of degrees), ``angular_rate_*``,
``acceleration_*`` (``imu`` has both, of one instant), ``rtk_connection_status`` (the flags say
more). Nothing is judged: values that are not finite are passed on.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from tirgeo_ros.core.frames.axes import quat_turned_both
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

#: psdk_ros2 multiplies the aircraft's g by this factor. It is removed here: the value of g is
#: defined once for all sources (standard gravity is 0.07 % more).
_PSDK_GRAVITY = 9.8
#: The right angle that psdk_ros2 uses between east and north: 0.012 deg too large.
_PSDK_QUARTER_TURN = 1.571
#: The single-precision pi with which psdk_ros2 makes degrees: 0.16 m of latitude at 52 deg.
_PSDK_PI: float = struct.unpack("<f", struct.pack("<f", math.pi))[0]
#: One document calls the fused height ellipsoidal, another barometric, and it was found to be more
#: than 100 m off. So it gets a large sigma.
_FUSED_HEIGHT_SIGMA_M = 200.0


def attitude(stamp_ns: int, q_wxyz: Quaternion) -> AttitudeReading:
    """Convert ``attitude``: FLU to ENU."""
    return AttitudeReading(stamp_ns, quat_turned_both(*q_wxyz))


def imu(stamp_ns: int, q_wxyz: Quaternion, rate_flu: Vector, force_flu: Vector) -> ImuReading:
    """Convert ``imu``: attitude FLU to ENU, rate (rad/s), specific force, 9.8 m/s2 to the g."""
    p, q, r = rate_flu
    x, y, z = (force / _PSDK_GRAVITY for force in force_flu)
    q_nb = quat_turned_both(*q_wxyz)
    return ImuReading(
        stamp_ns, ImuOrigin.MESSAGE, (x, -y, -z), AccelerationUnit.G, (p, -q, -r), q_nb
    )


def gimbal(stamp_ns: int, angles_rad: Vector) -> GimbalReading:
    """Convert ``gimbal_angles``: roll to the right, pitch down, yaw anticlockwise from east (rad).

    They are absolute, although their frame is the gimbal's base.
    """
    x, y, z = angles_rad
    yaw = (_PSDK_QUARTER_TURN - z + math.pi) % math.tau - math.pi
    return GimbalReading(stamp_ns, x, -y, yaw)


def place(degrees_and_height: Vector) -> GeodeticPlace:
    """Convert ``gps_position``, ``rtk_position``: latitude, longitude (deg), height MSL (m)."""
    latitude, longitude, height_msl_m = degrees_and_height
    return GeodeticPlace(math.radians(latitude), math.radians(longitude), height_msl_m)


def fused_position(stamp_ns: int, degrees_and_height: Vector) -> GpsReading:
    """Convert ``gps_position_fused``: degrees made with another pi, and an uncertain height."""
    latitude, longitude, height = degrees_and_height
    to_rad = _PSDK_PI / 180
    where = GeodeticPlace(latitude * to_rad, longitude * to_rad, height)
    return GpsReading(stamp_ns, where, vertical_sigma_m=_FUSED_HEIGHT_SIGMA_M)


def baseline_yaw_deg(yaw: int) -> int:
    """Convert ``rtk_yaw``: an int16 that comes as uint16."""
    return yaw - 0x10000 if yaw >= 0x8000 else yaw


def gps_details(stamp_ns: int, fix: float, accuracies: Vector) -> GpsReading:
    """Convert ``gps_details``: horizontal and vertical (mm) and speed accuracy (cm/s)."""
    horizontal_mm, vertical_mm, speed_cm_s = accuracies
    return GpsReading(
        stamp_ns,
        fix=int(fix) if math.isfinite(fix) else 0,
        horizontal_sigma_m=horizontal_mm * 1e-3,
        vertical_sigma_m=vertical_mm * 1e-3,
        velocity_sigma_m_s=speed_cm_s * 1e-2,
    )


def _fused_velocity(stamp_ns: int, enu_m_s: Vector) -> GpsReading:
    """Convert ``velocity_ground_fused``, which is ENU as its frame says."""
    east, north, up = enu_m_s
    return GpsReading(stamp_ns, velocity_n=(north, east, -up))


#: How the values of a topic become a reading with this stamp. ``gps_velocity`` and
#: ``rtk_velocity`` are NED, whatever their frames say.
READERS: dict[str, Callable[[int, Any], Reading]] = {
    "attitude": attitude,
    "imu": lambda stamp_ns, values: imu(stamp_ns, *values),
    "gimbal_angles": gimbal,
    "gps_position": lambda stamp_ns, values: GpsReading(stamp_ns, place(values)),
    "gps_velocity": lambda stamp_ns, ned_m_s: GpsReading(stamp_ns, velocity_n=ned_m_s),
    "gps_details": lambda stamp_ns, values: gps_details(stamp_ns, *values),
    "gps_position_fused": fused_position,
    "velocity_ground_fused": _fused_velocity,
    "rtk_position": lambda stamp_ns, values: RtkReading(stamp_ns, place=place(values)),
    "rtk_velocity": lambda stamp_ns, ned_m_s: RtkReading(stamp_ns, velocity_n=ned_m_s),
    "rtk_yaw": lambda stamp_ns, yaw: RtkReading(stamp_ns, yaw_deg=baseline_yaw_deg(yaw)),
}
