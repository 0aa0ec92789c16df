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
"""Read the topics of DJI's ROS 1 wrapper: convert messages of a bag to readings.

Time. A reading has its message's stamp: the time when the wrapper received it or, with
``align_time``, the aircraft's clock as the wrapper converted it. A message without a header, or
with a stamp of 0 (the gimbal's in the first versions), gets the time when it was recorded, which
is later by some milliseconds. RTK's yaw and flags have no header: they belong to the position that
was recorded at the same time, and get its stamp. An IMU that is stamped in bursts (on the serial
port, at 400 Hz) gets stamps of a steady rate, on the line below its own. Parameters give the age
of a value when the aircraft sent it (``rtk.delay_s``, ``delay``); the interpretation subtracts it.

The content of some messages differs from their type or frame: RTK's velocity is north, east, down;
the order of the gimbal's angles depends on the wrapper's settings; heights are above the sea, or
barometric. Not read: ``acceleration_ground_fused``, ``angular_velocity_fused`` (in an uncertain
frame; ``imu`` has both raw), ``local_position`` (on a sphere), ``height_above_takeoff`` (from a
sonar), ``gps_health`` (0 until a home point is set), ``trigger_time`` (stamp and time reversed),
``rtk_connection_status`` (the flags contain more). Each function that reads a topic takes a
message (any object with the fields of its definition) and the stamp for its reading; it raises
MessageError for invalid values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise
from statistics import fmean, median
from typing import Any, NamedTuple

from tirgeo_ros.core.frames.rotations import quat_turned_both
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.dji.clocks.steady_stamps import SteadyStamps
from tirgeo_ros.dji.sources.readings import (
    AccelerationUnit,
    Arrived,
    AttitudeReading,
    GeodeticPlace,
    GimbalReading,
    GpsReading,
    ImuOrigin,
    ImuReading,
    Reading,
    RtkEpochs,
    RtkReading,
    Vector,
)

_FIX, _VECTOR = "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/Vector3Stamped"
_FLAG, _YAW = "std_msgs/msg/UInt8", "std_msgs/msg/Int16"
#: The topics that an import should have.
NEEDED = ("imu", "rtk_position", "rtk_yaw", "gimbal_angle")
#: The possible names of the wrapper's node.
WRAPPERS = ("dji_sdk", "dji_osdk_ros")

# Values of a message.

#: Sigma of the fused position's height: it is barometric, with measured errors of over 100 m.
FUSED_HEIGHT_SIGMA_M = 100.0
_ABSENT = -1.0  # first entry of a covariance whose value is absent (sensor_msgs/Imu)
_LENGTH_TOLERANCE = 0.01  # of a unit quaternion; rounding alone makes 1e-7
_NO_PLACE_DEG = 1e-6  # a place nearer to 0, 0 means no place
_LARGEST_ANGLE_DEG = 720.0  # a gimbal's angle is within a turn; more is another unit or no angle
_GROUND_FRAME = "ground_ENU"

# The setup of a bag.

#: A stamp further than this from the time of recording belongs to an unrelated clock.
_ASTRAY_NS = 5_000_000_000
#: No recorder is later than this: a larger difference shows that an older bag was recorded again.
_OTHER_CLOCK_NS = 1_000_000_000
#: The wrapper multiplies g by this factor. With broadcast it does so even if the aircraft is set
#: to send m/s2; a specific force that stays above 5 g shows that.
_WRAPPER_GRAVITY, _TWICE_M_S2 = 9.801, 50.0
#: A stream has bursts if half of its steps differ from their mean by more than half of it. With
#: stamps in whole milliseconds at 400 Hz they differ by a fifth, and lost messages are few.
_BURST_SHARE, _BURST_NUMBER = 0.5, 20
#: Number of stamps from which their clock is found.
_SURVEYED = 400


def _imu(message: Any, stamp_ns: int) -> ImuReading:
    """Convert ``imu``: specific force (m/s2) and rate (rad/s) in FLU, attitude FLU to ENU.

    An invalid attitude is passed on, since the rest of the message may be valid. The
    interpretation counts it.
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

    The order is pitch, roll, yaw with subscription, which leaves the frame empty. It is roll,
    pitch, yaw with broadcast, whose frame is ground_ENU.
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


_Topic = tuple[str, tuple[str, ...], Callable[[Any, int], Reading]]

#: The topics that are read, by their names in the wrapper: type, topics of tirgeo that get the
#: data, and converter. RTK's are in NED and degrees.
TOPICS: dict[str, _Topic] = {
    "imu": ("sensor_msgs/msg/Imu", ("imu/data",), _imu),
    "attitude": ("geometry_msgs/msg/QuaternionStamped", ("gimbal/joint_states",), _attitude),
    "velocity": (_VECTOR, ("gps/vel",), _velocity_enu),
    "gps_position": (
        _FIX,
        ("gps/fix",),
        lambda m, t: GpsReading(t, _place(m), vertical_sigma_m=FUSED_HEIGHT_SIGMA_M),
    ),
    "rtk_position": (_FIX, ("rtk/fix",), lambda m, t: RtkReading(t, _place(m))),
    "rtk_velocity": (
        _VECTOR,
        ("rtk/vel",),
        lambda m, t: RtkReading(t, velocity_n=_vector(m.vector)),
    ),
    "rtk_yaw": (_YAW, ("rtk/heading",), lambda m, t: RtkReading(t, yaw_deg=int(m.data))),
    "rtk_info_position": (
        _FLAG,
        ("rtk/fix", "rtk/vel"),
        lambda m, t: RtkReading(t, position_flag=int(m.data)),
    ),
    "rtk_info_yaw": (_FLAG, ("rtk/heading",), lambda m, t: RtkReading(t, yaw_flag=int(m.data))),
    "gimbal_angle": (_VECTOR, ("gimbal/attitude", "gimbal/joint_states"), _gimbal_angle),
}


class Ros1Setup(NamedTuple):
    """Hold the properties of a bag that must be known before its messages are read."""

    shift_ns: int = 0  # the recorder's clock minus that of the stamps
    gravity: float = 1.0  # factor by which accelerations of ``imu`` are too large
    bursts: bool = False  # ``imu`` is stamped in bursts


def survey(messages: Iterable[tuple[str, Any, int]]) -> Ros1Setup:
    """Return the setup from a bag's first messages: name in the wrapper, message, record time."""
    lags_ns: list[int] = []
    forces_m_s2: list[float] = []
    imu_ns: list[int] = []
    for name, message, record_ns in messages:
        try:
            stamp_ns = _header_ns(message)
            force = message.linear_acceleration if name == "imu" else None
            size = None if force is None else math.hypot(force.x, force.y, force.z)
        except AttributeError:
            continue  # a message of another definition: counted when it is read again
        if stamp_ns:
            lags_ns.append(record_ns - stamp_ns)
        if size is not None:
            imu_ns.append(stamp_ns)
            forces_m_s2.append(size)
        if len(lags_ns) >= _SURVEYED:
            break
    lag_ns = round(median(lags_ns)) if lags_ns else 0
    sizes = [size for size in forces_m_s2 if math.isfinite(size)]
    twice = bool(sizes) and median(sizes) > _TWICE_M_S2
    steps_ns = [after - before for before, after in pairwise(imu_ns)]
    bursts = False
    if len(steps_ns) >= _BURST_NUMBER:
        mean_ns = fmean(steps_ns)
        far = sum(abs(step_ns - mean_ns) > _BURST_SHARE * mean_ns for step_ns in steps_ns)
        bursts = far > _BURST_SHARE * len(steps_ns)
    return Ros1Setup(
        lag_ns if abs(lag_ns) > _OTHER_CLOCK_NS else 0,
        _WRAPPER_GRAVITY if twice else 1.0,
        bursts,
    )


class Ros1Decoder:
    """Convert the wrapper's messages to readings, in the order in which they were recorded."""

    def __init__(self, setup: Ros1Setup = Ros1Setup()) -> None:  # noqa: B008  immutable
        self._setup = setup
        self._epochs = RtkEpochs()
        self._steady = SteadyStamps() if setup.bursts else None

    def arrival_ns(self, record_ns: int) -> int:
        """Return when a message was recorded, by the clock of the stamps."""
        return record_ns - self._setup.shift_ns

    def take(self, name: str, message: Any, record_ns: int) -> list[Arrived]:
        """Return the readings of a message, and those that waited for it.

        ``name``: the topic's, without the wrapper's. Raises MessageError for an invalid message:
        count it and continue.
        """
        arrival_ns = self.arrival_ns(record_ns)
        try:
            reading = self._read(name, message, arrival_ns)
        except AttributeError as error:
            raise MessageError(f"its definition has no field {error.name}") from None
        if isinstance(reading, RtkReading):
            return self._epochs.take(reading, arrival_ns)
        return [*self._epochs.due(arrival_ns), Arrived(arrival_ns, reading)]

    def flush(self) -> list[Arrived]:
        """Return the readings that waited, at the end of a bag."""
        return self._epochs.flush()

    @property
    def warnings(self) -> list[str]:
        """Return notes on the bag for a person."""
        notes = []
        if self._setup.shift_ns:
            notes.append(
                f"the stamps are {self._setup.shift_ns * 1e-9:.3f} s before the times "
                "of recording (a bag recorded again?); the stamps are used"
            )
        if self._setup.gravity != 1.0:
            notes.append(
                "imu has gravity multiplied in twice (broadcast, with m/s2 set in DJI Assistant "
                f"2): its acceleration was divided by {_WRAPPER_GRAVITY}"
            )
        if self._steady is not None:
            notes.append("imu is stamped in bursts: stamps of its steady rate are used instead")
        return notes

    def _read(self, name: str, message: Any, arrival_ns: int) -> Reading:
        stamp_ns = _header_ns(message) or arrival_ns
        if abs(arrival_ns - stamp_ns) > _ASTRAY_NS:
            off_s = (stamp_ns - arrival_ns) * 1e-9
            raise MessageError(f"its stamp is {off_s:+.0f} s from its time of recording")
        if name == "imu" and self._steady is not None and stamp_ns != arrival_ns:
            stamp_ns = self._steady.stamp_ns(stamp_ns)
        *_, read = TOPICS[name]
        reading = read(message, stamp_ns)
        if isinstance(reading, ImuReading) and self._setup.gravity != 1.0:
            x, y, z = (a / self._setup.gravity for a in reading.acceleration_b)
            return reading._replace(acceleration_b=(x, y, z))
        return reading


def _header_ns(message: Any) -> int:
    """Return a message's stamp; 0 for none."""
    header = getattr(message, "header", None)
    if header is None:
        return 0
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
