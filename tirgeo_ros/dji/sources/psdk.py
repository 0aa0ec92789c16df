# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Read the topics of psdk_ros2 (M300, M350): convert messages and their times to readings.

psdk_ros2 stamps a message when its node receives it. For streams of a steady rate the jitter is
removed from that stamp. Messages of a receiver keep their stamps: their delay is a parameter, and
the jitter does no harm.

The content of some topics differs from their type or frame: see the table. Not read:
``home_point`` (radians in fields of degrees), ``angular_rate_*``, ``acceleration_*`` (``imu`` has
both, of one instant), ``rtk_connection_status`` (the flags contain more), fused positions and
velocities (of uncertain height, and correlated in time). Values that are not finite are passed on.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

from tirgeo_ros.core.frames.rotations import quat_turned_both
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

#: psdk_ros2 multiplies the aircraft's g by this factor, which is removed here: the value of g is
#: defined once for all sources (standard gravity is 0.07 % more).
_PSDK_GRAVITY = 9.8
#: The right angle that psdk_ros2 uses between east and north: 0.012 deg too large.
_PSDK_QUARTER_TURN = 1.571

# Types of several topics.

_FIX, _TWIST = "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/TwistStamped"
_QUATERNION, _VECTOR = "geometry_msgs/msg/QuaternionStamped", "geometry_msgs/msg/Vector3Stamped"
_FLAG = "std_msgs/msg/UInt8"


def _vector(xyz: Any) -> Vector:
    return xyz.x, xyz.y, xyz.z


def _q_nb(flu_to_enu: Any) -> Quaternion:
    q = flu_to_enu
    return quat_turned_both(q.w, q.x, q.y, q.z)


def _imu(stamp_ns: int, message: Any) -> ImuReading:
    """Convert attitude (FLU to ENU), rate (rad/s) and specific force (9.8 m/s2 per g)."""
    p, q, r = _vector(message.angular_velocity)
    x, y, z = (force / _PSDK_GRAVITY for force in _vector(message.linear_acceleration))
    q_nb, unit = _q_nb(message.orientation), AccelerationUnit.G
    return ImuReading(stamp_ns, ImuOrigin.MESSAGE, (x, -y, -z), unit, (p, -q, -r), q_nb)


def _gimbal(stamp_ns: int, message: Any) -> GimbalReading:
    """Convert roll to the right, pitch down, yaw anticlockwise from east (rad).

    The angles are absolute, although their frame is the gimbal's base.
    """
    x, y, z = _vector(message.vector)
    yaw = (_PSDK_QUARTER_TURN - z + math.pi) % math.tau - math.pi
    return GimbalReading(stamp_ns, x, -y, yaw)


def _place(fix: Any) -> GeodeticPlace:
    """Convert latitude, longitude (deg) and height above the sea (m)."""
    return GeodeticPlace(math.radians(fix.latitude), math.radians(fix.longitude), fix.altitude)


def _gps_details(stamp_ns: int, details: Any) -> GpsReading:
    """Convert fix, and horizontal, vertical (mm) and speed accuracy (cm/s)."""
    return GpsReading(
        stamp_ns,
        fix=int(details.fix_state) if math.isfinite(details.fix_state) else 0,
        horizontal_sigma_m=details.horizontal_accuracy * 1e-3,
        vertical_sigma_m=details.vertical_accuracy * 1e-3,
        velocity_sigma_m_s=details.speed_accuracy * 1e-2,
    )


#: The topics that are read: their types, and the functions that convert a stamp and a message.
#: Velocities are NED (m/s), whatever their frames are. ``rtk_yaw`` is an int16 (deg) that comes as
#: uint16.
PSDK_TOPICS: dict[str, tuple[str, Callable[[int, Any], Reading]]] = {
    "attitude": (_QUATERNION, lambda t, m: AttitudeReading(t, _q_nb(m.quaternion))),
    "imu": ("sensor_msgs/msg/Imu", _imu),
    "gimbal_angles": (_VECTOR, _gimbal),
    "gps_position": (_FIX, lambda t, m: GpsReading(t, _place(m))),
    "gps_velocity": (_TWIST, lambda t, m: GpsReading(t, velocity_n=_vector(m.twist.linear))),
    "gps_details": ("psdk_interfaces/msg/GPSDetails", _gps_details),
    "rtk_position": (_FIX, lambda t, m: RtkReading(t, _place(m))),
    "rtk_velocity": (_TWIST, lambda t, m: RtkReading(t, velocity_n=_vector(m.twist.linear))),
    "rtk_yaw": (
        "psdk_interfaces/msg/RTKYaw",
        lambda t, m: RtkReading(t, yaw_deg=(m.yaw + 0x8000) % 0x10000 - 0x8000),
    ),
    "rtk_position_info": (_FLAG, lambda t, m: RtkReading(t, position_flag=m.data)),
    "rtk_yaw_info": (_FLAG, lambda t, m: RtkReading(t, yaw_flag=m.data)),
}


class PsdkDecoder:
    """Convert the topics' messages to readings, which have the stamp of the header.

    ``take`` and ``due`` return the readings that are complete. Call ``due`` regularly for the
    readings that wait. Stamps and arrivals are of one clock. Counted: ``unstamped`` messages.
    """

    def __init__(self) -> None:
        self._steady = {topic: SteadyStamps() for topic in ("imu", "attitude", "gimbal_angles")}
        self._rtk = RtkEpochs()
        self.counts: Counter[str] = Counter()

    def take(self, topic: str, message: Any, stamp_ns: int, arrival_ns: int) -> list[Reading]:
        """Take a message of a topic, its header's stamp (0: none), and its arrival."""
        if not stamp_ns:
            stamp_ns = arrival_ns
            if not topic.endswith("_info"):  # flags have no header
                self.counts["unstamped"] += 1
        if topic in self._steady:
            stamp_ns = self._steady[topic].stamp_ns(stamp_ns)
        _, read = PSDK_TOPICS[topic]
        reading = read(stamp_ns, message)
        if isinstance(reading, RtkReading):
            return [arrived.reading for arrived in self._rtk.take(reading, arrival_ns)]
        return [reading]

    def due(self, now_ns: int) -> list[Reading]:
        """Return the readings that have waited long enough; call this every 10 ms."""
        return [arrived.reading for arrived in self._rtk.due(now_ns)]
