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
"""Define the aircraft's readings before their interpretation: one record for all sources.

A source (the serial link, a capture, the topics of psdk_ros2, a bag of dji_sdk) converts axes,
units and order of the fields to the form defined here. ``dji.interpret`` then uses knowledge of
the aircraft: flags, heights above sea level, the antennas' direction, repeated values. Vectors are
tuples, since there are hundreds a second.
"""

from __future__ import annotations

from enum import Enum
from typing import Any, NamedTuple

#: Half of RTK's period of 200 ms: a later part is nearer to the next epoch.
_HALF_EPOCH_NS = 100_000_000

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w, x, y, z


class AccelerationUnit(Enum):
    """List the units of an acceleration, as far as its source states them."""

    G = "g"
    M_S2 = "m/s2"
    UNKNOWN = "unknown"  # the broadcast's: as set in DJI Assistant 2


class ImuOrigin(Enum):
    """List the aircraft's streams of IMU readings; the better ones come first."""

    HARD_SYNC = "hard_sync"
    SUBSCRIPTION = "subscription"
    BROADCAST = "broadcast"
    MESSAGE = "message"  # a ROS message


class ImuReading(NamedTuple):
    """Hold specific force and rate of one instant, and the attitude if the message has one."""

    stamp_ns: int
    origin: ImuOrigin
    acceleration_b: Vector  # FRD, specific force in ``unit``: (0, 0, -1 g) at rest
    unit: AccelerationUnit
    angular_rate_b: Vector  # FRD, rad/s
    q_nb: Quaternion | None  # FRD to NED


class AttitudeReading(NamedTuple):
    """Hold the aircraft's attitude."""

    stamp_ns: int
    q_nb: Quaternion  # FRD to NED


class GeodeticPlace(NamedTuple):
    """Hold the position of an antenna."""

    latitude_rad: float
    longitude_rad: float
    height_msl_m: float  # above mean sea level


class GpsReading(NamedTuple):
    """Hold data of the ordinary GPS; parts that the message lacks are None."""

    stamp_ns: int
    place: GeodeticPlace | None = None
    velocity_n: Vector | None = None  # NED, m/s
    fix: int | None = None  # 0 none, 1 dead reckoning, 2 2D, 3 3D, 4 GPS and DR, 5 time only
    horizontal_sigma_m: float | None = None
    vertical_sigma_m: float | None = None
    velocity_sigma_m_s: float | None = None


class RtkReading(NamedTuple):
    """Hold data of one epoch of the RTK receiver; parts that the message lacks are None."""

    stamp_ns: int
    place: GeodeticPlace | None = None
    position_flag: int | None = None  # NovAtel's numbers; 50 = narrow-lane integer
    velocity_n: Vector | None = None  # NED, m/s
    yaw_deg: int | None = None  # azimuth of the antennas' baseline, not limited to one turn
    yaw_flag: int | None = None


class GimbalReading(NamedTuple):
    """Hold the gimbal's angles: yaw, then pitch, then roll, from level axes."""

    stamp_ns: int
    roll_rad: float  # right side down
    pitch_rad: float  # camera up
    yaw_rad: float  # clockwise, from north (or from the nose: ``gimbal_reference``)


Reading = ImuReading | AttitudeReading | GpsReading | RtkReading | GimbalReading


class Arrived(NamedTuple):
    """Hold a reading and the time when the last of its messages arrived."""

    arrival_ns: int
    reading: Reading


class RtkEpochs:
    """Combine the five topics on which DJI's ROS wrappers publish one RTK epoch.

    The wrappers publish position, velocity, yaw and the two flags within milliseconds, in any
    order. Flags (in ROS 1 also the yaw) have no header: only their time of arrival shows their
    epoch. A value that did not wait for its flag would get the flag of the previous epoch, and
    would be taken for fixed although the fix has just been lost.

    An epoch ends with its fifth part, or before the first part of the next epoch: a part that it
    already has, or a part that comes more than half an epoch after its first. Its stamp is that of
    the position, else of the velocity (both have headers), else of the first part.
    """

    def __init__(self) -> None:
        self._begun_ns = self._arrival_ns = self._stamp_ns = 0
        self._parts: dict[str, Any] = {}

    def take(self, part: RtkReading, arrival_ns: int) -> list[Arrived]:
        """Take the content of one message; return the epochs that it ends."""
        values = {name: value for name, value in part._asdict().items() if value is not None}
        stamp_ns = values.pop("stamp_ns")
        done = self.due(arrival_ns)
        if not values.keys().isdisjoint(self._parts):
            done = self.flush()
        if not self._parts:
            self._begun_ns, self._stamp_ns = arrival_ns, stamp_ns
        if "place" in values or ("velocity_n" in values and "place" not in self._parts):
            self._stamp_ns = stamp_ns
        self._parts |= values
        self._arrival_ns = arrival_ns
        is_whole = len(self._parts) == len(RtkReading._fields) - 1
        return [*done, *self.flush()] if is_whole else done

    def due(self, now_ns: int) -> list[Arrived]:
        """Return the epoch if no more parts of it can come."""
        is_over = self._parts and not 0 <= now_ns - self._begun_ns <= _HALF_EPOCH_NS
        return self.flush() if is_over else []

    def flush(self) -> list[Arrived]:
        """Return the epoch with the parts that have come."""
        parts, self._parts = self._parts, {}
        return [Arrived(self._arrival_ns, RtkReading(self._stamp_ns, **parts))] if parts else []
