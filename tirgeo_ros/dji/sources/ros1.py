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
from collections.abc import Iterable
from itertools import pairwise
from statistics import fmean, median
from typing import Any, NamedTuple

from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.dji.clocks.steady_stamps import SteadyStamps
from tirgeo_ros.dji.sources.readings import ImuReading, Reading, RtkReading
from tirgeo_ros.dji.sources.ros1_messages import TOPICS
from tirgeo_ros.dji.sources.rtk_epochs import Arrived, RtkEpochs

#: The possible names of the wrapper's node.
WRAPPERS = ("dji_sdk", "dji_osdk_ros")

#: A stamp this far from the time of the record belongs to an unrelated clock.
_ASTRAY_NS = 5_000_000_000
#: No recorder is that late: a bag was recorded again while an older one was played.
_OTHER_CLOCK_NS = 1_000_000_000
#: The wrapper multiplies g by this factor. With broadcast it does so even if the aircraft is set
#: to send m/s2; a specific force that stays above 5 g shows that.
_WRAPPER_GRAVITY, _TWICE_M_S2 = 9.801, 50.0
#: A stream has bursts if half of its steps are off by half. Stamps in whole milliseconds at 400 Hz
#: are off by a fifth, and lost messages are few.
_BURST_SHARE, _BURST_NUMBER = 0.5, 20
#: Number of stamps that decides of which clock they are.
_SURVEYED = 400


class Ros1Setup(NamedTuple):
    """Hold what has to be known of a bag before its messages are read."""

    shift_ns: int = 0  # the recorder's clock minus that of the stamps
    gravity: float = 1.0  # factor by which accelerations of ``imu`` are too large
    bursts: bool = False  # ``imu`` is stamped in bursts


def survey(messages: Iterable[tuple[str, Any, int]]) -> Ros1Setup:
    """Return the setup by a bag's first messages: name in the wrapper, message, record time."""
    lags_ns: list[int] = []
    forces_m_s2: list[float] = []
    imu_ns: list[int] = []
    for name, message, record_ns in messages:
        try:
            stamp_ns = _header_ns(message)
            force = message.linear_acceleration if name == "imu" else None
            size = None if force is None else math.hypot(force.x, force.y, force.z)
        except AttributeError:
            continue  # of another definition: counted when it is read again
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
    return Ros1Setup(
        lag_ns if abs(lag_ns) > _OTHER_CLOCK_NS else 0,
        _WRAPPER_GRAVITY if twice else 1.0,
        _has_bursts([after - before for before, after in pairwise(imu_ns)]),
    )


def _has_bursts(steps_ns: list[int]) -> bool:
    """Return whether the IMU's steps are far from their mean; aligned stamps have whole ms."""
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
        self._steady = SteadyStamps() if setup.bursts else None

    def arrival_ns(self, record_ns: int) -> int:
        """Return when a message was recorded, by the clock of the stamps."""
        return record_ns - self._setup.shift_ns

    def take(self, name: str, message: Any, record_ns: int) -> list[Arrived]:
        """Return the readings that a message gives, and those that waited for it.

        ``name`` is the topic's without the wrapper's. Raises MessageError for an invalid message:
        count it and continue.
        """
        arrival_ns = self.arrival_ns(record_ns)
        try:
            reading = self._read(name, message, arrival_ns)
        except AttributeError as error:
            raise MessageError(f"its definition has no {error.name}") from None
        if isinstance(reading, RtkReading):
            return self._epochs.take(reading, arrival_ns)
        return [*self._epochs.due(arrival_ns), Arrived(arrival_ns, reading)]

    def flush(self) -> list[Arrived]:
        """Return the readings that waited, at the end of a bag."""
        return self._epochs.flush()

    @property
    def warnings(self) -> list[str]:
        """Return what a person should know of the bag."""
        found = []
        if self._setup.shift_ns:
            found.append(
                f"the stamps are {self._setup.shift_ns * 1e-9:.3f} s before the times "
                "of recording (a bag recorded again?); the stamps are used"
            )
        if self._setup.gravity != 1.0:
            found.append(
                "imu has gravity multiplied in twice (broadcast, with m/s2 set in DJI Assistant "
                f"2): its acceleration was divided by {_WRAPPER_GRAVITY}"
            )
        if self._steady is not None:
            found.append("imu is stamped in bursts: stamps of its steady rate are used instead")
        return found

    def _read(self, name: str, message: Any, arrival_ns: int) -> Reading:
        stamp_ns = _header_ns(message) or arrival_ns
        if abs(arrival_ns - stamp_ns) > _ASTRAY_NS:
            off_s = (stamp_ns - arrival_ns) * 1e-9
            raise MessageError(f"stamped {off_s:+.0f} s from when it was recorded")
        if name == "imu" and self._steady is not None and stamp_ns != arrival_ns:
            stamp_ns = self._steady.stamp_ns(stamp_ns)
        reading = TOPICS[name].read(message, stamp_ns)
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
