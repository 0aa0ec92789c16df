"""Read the topics of DJI's ROS 1 wrapper: messages of a bag in, readings out.

Time. A reading has its message's stamp: the time when the wrapper received it or, with
``align_time``, the aircraft's clock as the wrapper placed it. A message without a header, or with
a stamp of 0 (the gimbal's in the first versions), gets the time when it was recorded, which is
later by some milliseconds. RTK's yaw and flags, which have no header, belong to the position that
was recorded at the same time and get its stamp. An IMU that is stamped in bursts (the serial
port's, at 400 Hz) gets the stamps of its steady rate below them. The age of a value when the
aircraft sent it is a parameter (``rtk.delay_s``, ``delay``), which the interpretation subtracts.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cache
from itertools import pairwise
from statistics import fmean, median
from typing import Any, NamedTuple

from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.dji.clocks.steady_stamps import SteadyStamps
from tirgeo_ros.dji.sources.readings import ImuReading, Reading, RtkReading
from tirgeo_ros.dji.sources.ros1_messages import (
    ACCELERATION,
    FUSED_HEIGHT_SIGMA_M,
    READERS,
    OlderImu,
)
from tirgeo_ros.dji.sources.ros1_rtk_epochs import Arrived, RtkEpochs
from tirgeo_ros.dji.sources.ros1_stamp_delays import StampLags, clock_shift_ns

#: The possible names of the wrapper's node.
WRAPPERS = ("dji_sdk", "dji_osdk_ros")

#: A stamp this far from the time of the record belongs to an unrelated clock.
_ASTRAY_NS = 5_000_000_000
#: The wrapper multiplies g by this factor. With broadcast it does so even if the aircraft is set
#: to send m/s2; a specific force that stays above 5 g shows that.
_WRAPPER_GRAVITY, _TWICE_M_S2 = 9.801, 50.0
#: A stream has bursts if half of its steps are off by half. Stamps in whole milliseconds at 400 Hz
#: are off by a fifth, and lost messages are few.
_BURST_SHARE, _BURST_NUMBER = 0.5, 20

#: Number of stamps that decides of which clock they are.
_SURVEYED = 400

#: What each topic becomes.
FEEDS: dict[str, tuple[str, ...]] = {
    "imu": ("imu/data",),
    "attitude": ("gimbal/joint_states",),
    "velocity": ("gps/vel",),
    "gps_position": ("gps/fix",),
    "rtk_position": ("rtk/fix",),
    "rtk_velocity": ("rtk/vel",),
    "rtk_yaw": ("rtk/heading",),
    "rtk_info_position": ("rtk/fix", "rtk/vel"),
    "rtk_info_yaw": ("rtk/heading",),
    "gimbal_angle": ("gimbal/attitude", "gimbal/joint_states"),
    "attitude_quaternion": ("imu/data", "gimbal/joint_states"),
    "acceleration": ("imu/data",),
    "global_position": ("gps/fix",),
    "gimbal": ("gimbal/attitude", "gimbal/joint_states"),
    "A3_GPS": ("gps/fix", "gps/vel"),
    "A3_RTK": ("rtk/fix", "rtk/vel", "rtk/heading"),
}
#: What an import should have: at least one topic of each group.
NEEDED: tuple[tuple[str, ...], ...] = (
    ("imu", "acceleration"),
    ("rtk_position", "A3_RTK"),
    ("rtk_yaw", "A3_RTK"),
    ("gimbal_angle", "gimbal"),
)
_RECEIVER, _FUSED = "A3_GPS", {"global_position", "velocity"}
_BAROMETRIC = {"gps_position", "global_position"}


@cache
def types_of(name: str) -> tuple[str, ...]:
    """Return the types that a topic may have, by its name in the wrapper; none if not read."""
    return tuple(typename for topic, typename in (*READERS, ACCELERATION) if topic == name)


def used(names: Collection[str]) -> set[str]:
    """Return those of a bag's topics that are read.

    If the receiver's own position is present, the fused one is not read. The newer wrapper's
    ``velocity`` is the only one that it has; it has no ``A3_GPS``.
    """
    known = {name for name in names if name in FEEDS}
    return known - _FUSED if _RECEIVER in known else known


def notes_of(name: str) -> list[str]:
    """Return notes for people on values of a topic that are easily misunderstood."""
    if name not in _BAROMETRIC:
        return []
    told = "its height is a barometer's and its accuracy is not told"
    sigma_m = f"{FUSED_HEIGHT_SIGMA_M:g} m"
    return [f"{name}: {told}: gps/fix has a standard deviation of {sigma_m} in height"]


class Ros1Setup(NamedTuple):
    """Hold what has to be known of a bag before its messages are read."""

    shift_ns: int = 0  # the recorder's clock minus that of the stamps
    gravity: float = 1.0  # factor by which accelerations of ``imu`` are too large
    bursts: bool = False  # ``imu`` is stamped in bursts


class Ros1Survey:
    """Find a bag's ``Ros1Setup`` from its first messages, however many."""

    def __init__(self) -> None:
        self._lags_ns: list[int] = []
        self._forces_m_s2: list[float] = []
        self._imu_ns: list[int] = []

    @property
    def is_full(self) -> bool:
        """Return whether it has seen enough."""
        return len(self._lags_ns) >= _SURVEYED

    def add(self, name: str, message: Any, record_ns: int) -> None:
        """Take a message of one of the wrapper's topics."""
        stamp_ns = _header_ns(message)
        if stamp_ns:
            self._lags_ns.append(record_ns - stamp_ns)
        if name == "imu":
            self._imu_ns.append(stamp_ns)
            force = message.linear_acceleration
            self._forces_m_s2.append(math.hypot(force.x, force.y, force.z))

    @property
    def setup(self) -> Ros1Setup:
        """Return what was found."""
        sizes = [size for size in self._forces_m_s2 if math.isfinite(size)]
        twice = bool(sizes) and median(sizes) > _TWICE_M_S2
        gravity = _WRAPPER_GRAVITY if twice else 1.0
        return Ros1Setup(clock_shift_ns(self._lags_ns), gravity, self._has_bursts)

    @property
    def _has_bursts(self) -> bool:
        """Return whether the IMU's steps are far from their mean; aligned stamps have whole ms."""
        steps_ns = [after - before for before, after in pairwise(self._imu_ns)]
        if len(steps_ns) < _BURST_NUMBER:
            return False
        mean_ns = fmean(steps_ns)
        far = sum(abs(step_ns - mean_ns) > _BURST_SHARE * mean_ns for step_ns in steps_ns)
        return far > _BURST_SHARE * len(steps_ns)


class Ros1Decoder:
    """Convert the wrapper's messages to readings, in the order in which they were recorded."""

    def __init__(self, setup: Ros1Setup = Ros1Setup()) -> None:  # noqa: B008  immutable
        self._setup = setup
        self._epochs = RtkEpochs()
        self._older = OlderImu()
        self._lags = StampLags()
        self._steady = SteadyStamps() if setup.bursts else None

    def arrival_ns(self, record_ns: int) -> int:
        """Return when a message was recorded, by the clock of the stamps."""
        return record_ns - self._setup.shift_ns

    def take(self, name: str, typename: str, message: Any, record_ns: int) -> list[Arrived]:
        """Return the readings that a message gives, and those that waited for it.

        ``name`` is the topic's without the wrapper's. Raises MessageError for an invalid message:
        count it and continue.
        """
        arrival_ns = self.arrival_ns(record_ns)
        try:
            stamp_ns = self._stamp_ns(name, message, arrival_ns)
            given = self._read(name, typename, message, stamp_ns)
        except AttributeError as error:
            raise MessageError(f"its definition has no {error.name}") from None
        found = self._epochs.due(arrival_ns)
        for reading in given:
            if isinstance(reading, RtkReading):
                found += self._epochs.take(reading, arrival_ns)
            else:
                found.append(Arrived(arrival_ns, reading))
        return found

    def flush(self) -> list[Arrived]:
        """Return the readings that waited, at the end of a bag."""
        return self._epochs.flush()

    @property
    def warnings(self) -> list[str]:
        """Return what a person should know of the bag."""
        found = []
        if self._setup.shift_ns:
            found.append(
                f"the stamps lie {self._setup.shift_ns * 1e-9:.3f} s before the times of the "
                "record (a bag recorded again?): the stamps count"
            )
        if self._setup.gravity != 1.0:
            found.append(
                "imu has gravity multiplied in twice (broadcast, with m/s2 set in DJI Assistant "
                f"2): its acceleration was divided by {_WRAPPER_GRAVITY}"
            )
        if self._steady is not None:
            found.append("imu is stamped in bursts: it has the stamps of its steady rate instead")
        return found + self._lags.warnings("imu", "gimbal_angle")

    def _stamp_ns(self, name: str, message: Any, arrival_ns: int) -> int:
        stamp_ns = _header_ns(message)
        if not stamp_ns:
            return arrival_ns
        if abs(arrival_ns - stamp_ns) > _ASTRAY_NS:
            off_s = (stamp_ns - arrival_ns) * 1e-9
            raise MessageError(f"stamped {off_s:+.0f} s from when it was recorded")
        self._lags.add(name, stamp_ns, arrival_ns)
        if name == "imu" and self._steady is not None:
            return self._steady.stamp_ns(stamp_ns)
        return stamp_ns

    def _read(self, name: str, typename: str, message: Any, stamp_ns: int) -> list[Reading]:
        if (name, typename) == ACCELERATION:
            return [*self._older.acceleration(message, stamp_ns)]
        reading = READERS[name, typename](message, stamp_ns)
        if name == "attitude_quaternion":
            return [reading, *self._older.attitude_quaternion(message, stamp_ns)]
        if isinstance(reading, ImuReading) and self._setup.gravity != 1.0:
            x, y, z = (a / self._setup.gravity for a in reading.acceleration_b)
            return [reading._replace(acceleration_b=(x, y, z))]
        return [reading]


def _header_ns(message: Any) -> int:
    """Return a message's stamp; 0 for none."""
    header = getattr(message, "header", None)
    if header is None:
        return 0
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
