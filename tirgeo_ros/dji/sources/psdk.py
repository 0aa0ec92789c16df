"""Read the topics of psdk_ros2 (M300, M350): values in with their times, readings out.

psdk_ros2 stamps a message when its node receives it. For streams of a steady rate the jitter is
removed from that stamp. A receiver's messages keep it: their delay is a parameter, and the jitter
does no harm.

Some of its topics are not what their type or frame says; ``READERS`` states the axes of the input.
Not read: ``home_point`` (radians in fields of degrees), ``angular_rate_*``, ``acceleration_*``
(``imu`` has both, of one instant), ``rtk_connection_status`` (the flags say more), fused positions
and velocities (of uncertain height, and correlated in time). Nothing is judged: values that are
not finite are passed on.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

from tirgeo_ros.core.frames.axes import quat_turned_both
from tirgeo_ros.dji.clocks.steady_stamps import SteadyStamps
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
    RtkEpochs,
    RtkReading,
    Vector,
)

#: psdk_ros2 multiplies the aircraft's g by this factor. It is removed here: the value of g is
#: defined once for all sources (standard gravity is 0.07 % more).
_PSDK_GRAVITY = 9.8
#: The right angle that psdk_ros2 uses between east and north: 0.012 deg too large.
_PSDK_QUARTER_TURN = 1.571


def _imu(stamp_ns: int, values: tuple[Quaternion, Vector, Vector]) -> ImuReading:
    """Convert attitude FLU to ENU, rate (rad/s), specific force, 9.8 m/s2 to the g."""
    q_wxyz, (p, q, r), force_flu = values
    x, y, z = (force / _PSDK_GRAVITY for force in force_flu)
    q_nb, unit = quat_turned_both(*q_wxyz), AccelerationUnit.G
    return ImuReading(stamp_ns, ImuOrigin.MESSAGE, (x, -y, -z), unit, (p, -q, -r), q_nb)


def _gimbal(stamp_ns: int, angles_rad: Vector) -> GimbalReading:
    """Convert roll to the right, pitch down, yaw anticlockwise from east (rad).

    They are absolute, although their frame is the gimbal's base.
    """
    x, y, z = angles_rad
    yaw = (_PSDK_QUARTER_TURN - z + math.pi) % math.tau - math.pi
    return GimbalReading(stamp_ns, x, -y, yaw)


def _place(degrees_and_height: Vector) -> GeodeticPlace:
    """Convert latitude, longitude (deg) and height above the sea (m)."""
    latitude, longitude, height_msl_m = degrees_and_height
    return GeodeticPlace(math.radians(latitude), math.radians(longitude), height_msl_m)


def _gps_details(stamp_ns: int, values: tuple[float, Vector]) -> GpsReading:
    """Convert fix, and horizontal, vertical (mm) and speed accuracy (cm/s)."""
    fix, (horizontal_mm, vertical_mm, speed_cm_s) = values
    return GpsReading(
        stamp_ns,
        fix=int(fix) if math.isfinite(fix) else 0,
        horizontal_sigma_m=horizontal_mm * 1e-3,
        vertical_sigma_m=vertical_mm * 1e-3,
        velocity_sigma_m_s=speed_cm_s * 1e-2,
    )


#: How the values of a topic become a reading with this stamp. ``attitude`` is wxyz, FLU to ENU;
#: ``gps_velocity`` and ``rtk_velocity`` are NED, whatever their frames say (m/s).
READERS: dict[str, Callable[[int, Any], Reading]] = {
    "attitude": lambda stamp_ns, q_wxyz: AttitudeReading(stamp_ns, quat_turned_both(*q_wxyz)),
    "imu": _imu,
    "gimbal_angles": _gimbal,
    "gps_position": lambda stamp_ns, values: GpsReading(stamp_ns, _place(values)),
    "gps_velocity": lambda stamp_ns, ned_m_s: GpsReading(stamp_ns, velocity_n=ned_m_s),
    "gps_details": _gps_details,
    "rtk_position": lambda stamp_ns, values: RtkReading(stamp_ns, _place(values)),
    "rtk_velocity": lambda stamp_ns, ned_m_s: RtkReading(stamp_ns, velocity_n=ned_m_s),
    # an int16 (deg) that comes as uint16
    "rtk_yaw": lambda stamp_ns, yaw: RtkReading(
        stamp_ns, yaw_deg=(yaw + 0x8000) % 0x10000 - 0x8000
    ),
    "rtk_position_info": lambda stamp_ns, flag: RtkReading(stamp_ns, position_flag=flag),
    "rtk_yaw_info": lambda stamp_ns, flag: RtkReading(stamp_ns, yaw_flag=flag),
}


class PsdkDecoder:
    """Convert the topics' values to readings, which have the stamp of the header.

    ``take`` and ``due`` return the readings that are complete; ``due`` must be called for those
    that wait. Stamps and arrivals are of one clock. Counted: ``unstamped`` messages.
    """

    def __init__(self) -> None:
        self._steady = {topic: SteadyStamps() for topic in ("imu", "attitude", "gimbal_angles")}
        self._rtk = RtkEpochs()
        self.counts: Counter[str] = Counter()

    def take(self, topic: str, values: Any, stamp_ns: int, arrival_ns: int) -> list[Reading]:
        """Take a message: its values (``READERS``), its header's stamp (0: none), its arrival."""
        if not stamp_ns:
            stamp_ns = arrival_ns
            if not topic.endswith("_info"):  # flags have no header
                self.counts["unstamped"] += 1
        if topic in self._steady:
            stamp_ns = self._steady[topic].stamp_ns(stamp_ns)
        reading = READERS[topic](stamp_ns, values)
        if isinstance(reading, RtkReading):
            return [arrived.reading for arrived in self._rtk.take(reading, arrival_ns)]
        return [reading]

    def due(self, now_ns: int) -> list[Reading]:
        """Return the readings that have waited long enough; to be called every 10 ms."""
        return [arrived.reading for arrived in self._rtk.due(now_ns)]
