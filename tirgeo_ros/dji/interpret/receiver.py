"""Convert what RTK and ordinary GPS have in common: places, velocities, and their repeats."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from tirgeo_ros.core.streams.sanity_checks import LARGEST_HEIGHT_M
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source, VelocitySample
from tirgeo_ros.dji.interpret.imu_samples import Sequence
from tirgeo_ros.dji.interpret.receiver_epochs import ReceiverEpochs, Value
from tirgeo_ros.dji.sources.readings import GeodeticPlace, GpsReading, RtkReading, Vector

#: A flag that came in a message of its own is valid this long: seven epochs of the receiver, and
#: one and a half messages of a source that passes one in a second.
HOLD_NS = 1_500_000_000
#: A place that was received this long ago, five epochs, is not published again.
_SILENT_NS = 1_000_000_000
#: A place nearer to 0, 0 than this (0.6 m) means no place.
_NO_PLACE_RAD = 1e-7
#: The core's limit: no aircraft is faster.
_LARGEST_SPEED_M_S = 1e3

T = TypeVar("T")


class Quality(NamedTuple):
    """Hold status and variances of a satellite solution."""

    status: FixStatus
    position_variance: tuple[float, float, float]  # north, east, down, m2; zeros: not known
    velocity_variance: float  # of each axis, (m/s)2; zero: not known


#: Sigma of a place of which nothing is known: no weight, but finite in sums.
UNKNOWN_SIGMA_M = 1e5

NO_FIX = Quality(FixStatus.NONE, (UNKNOWN_SIGMA_M**2,) * 3, UNKNOWN_SIGMA_M**2)


class Held(Generic[T]):
    """Hold the newest value of a field that need not be in every message."""

    def __init__(self) -> None:
        self.newest: T | None = None
        self._stamp_ns = 0

    def hear(self, stamp_ns: int, value: T | None) -> None:
        """Take the value of a message, unless it is None."""
        if value is not None:
            self.newest, self._stamp_ns = value, stamp_ns

    def at(self, stamp_ns: int) -> T | None:
        """Return the newest value; None if it is too old for this instant, or of another clock."""
        return self.newest if abs(stamp_ns - self._stamp_ns) <= HOLD_NS else None


R = TypeVar("R", GpsReading, RtkReading)


class Receiver(Generic[R]):
    """Convert a receiver's readings to samples, each measurement once.

    Counted under ``name``: ``_repeated`` (readings without anything new), ``_late`` (of the epoch
    before, from a slower source), ``_position_refused``, ``_velocity_refused`` (not finite, out of
    range or 0, 0), ``_velocity_without_fix`` and ``_status_fell`` (a place published again because
    its fix is worse now).
    """

    def __init__(
        self, name: str, delay_s: float, undulation_m: float, counts: Counter[str]
    ) -> None:
        """Take ``name``, rtk or gps, and ``undulation_m``, which is added to heights."""
        self._name = name
        self._delay_ns = round(delay_s * 1e9)
        self._position_source = Source[f"{name.upper()}_POSITION"]
        self._velocity_source = Source[f"{name.upper()}_VELOCITY"]
        self._undulation_m = undulation_m
        self._counts = counts
        self._epochs = ReceiverEpochs()
        self._positions, self._velocities = Sequence(), Sequence()
        self._place: GeodeticPlace | None = None  # the newest one that was published
        self._place_ns = 0  # when it was new
        self._seen_ns = 0  # when it was last received
        self._status = FixStatus.NONE  # with which it was published
        self._speed_m_s = 0.0

    def _hear(self, stamp_ns: int, reading: R) -> None:
        """Take what a reading says of its quality."""
        raise NotImplementedError

    def _quality(self, stamp_ns: int) -> Quality:
        """Return the quality of what is measured at an instant."""
        raise NotImplementedError

    def take(self, reading: R) -> list[Any]:
        """Return the samples of what is new in a reading."""
        return self._taken(reading.stamp_ns - self._delay_ns, reading, {})[1]

    def _taken(
        self, stamp_ns: int, reading: R, others: dict[str, Value]
    ) -> tuple[set[str], list[Any]]:
        """Return which parts are new, ``others`` included, and the samples of position, velocity.

        Both are empty for a reading of the epoch before the newest.
        """
        place, velocity_n = reading.place, reading.velocity_n
        if place is not None and not _is_place(place):
            self._count("position_refused")
            place = None
        if self._epochs.is_late(stamp_ns, place):
            self._count("late")
            return set(), []
        if velocity_n is not None and not all(abs(v) < _LARGEST_SPEED_M_S for v in velocity_n):
            self._count("velocity_refused")
            velocity_n = None
        self._hear(stamp_ns, reading)
        parts = dict(others)
        if place is not None:
            parts["place"] = place
            self._seen_ns = stamp_ns
        if velocity_n is not None:
            parts["velocity"] = velocity_n
            self._speed_m_s = math.hypot(*velocity_n)
        fresh = self._epochs.news(stamp_ns, parts)
        if parts and not fresh:
            self._count("repeated")
        quality = self._quality(stamp_ns)
        found: list[PositionSample | VelocitySample] = []
        if place is not None and "place" in fresh:
            self._place, self._place_ns = place, stamp_ns
            found.append(self._position(stamp_ns, place, quality))
        elif self._place is not None and self._fell(stamp_ns, quality.status):
            self._count("status_fell")
            found.append(self._position(stamp_ns, self._place, self._moved(stamp_ns, quality)))
        if velocity_n is not None and "velocity" in fresh:
            found += self._velocity(stamp_ns, velocity_n, quality)
        return fresh, found

    def _count(self, what: str) -> None:
        self._counts[f"{self._name}_{what}"] += 1

    def _fell(self, stamp_ns: int, status: FixStatus) -> bool:
        """Return whether the fix is worse than when the place, which is still sent, was published.

        A fix that becomes better waits for the next place: this one was measured without it.
        """
        return status < self._status and abs(stamp_ns - self._seen_ns) <= _SILENT_NS

    def _moved(self, stamp_ns: int, quality: Quality) -> Quality:
        """Return the quality with the aircraft's possible motion since the place was new."""
        moved_m = self._speed_m_s * max(stamp_ns - self._place_ns, 0) * 1e-9
        north, east, down = (value + moved_m**2 for value in quality.position_variance)
        return quality._replace(position_variance=(north, east, down))

    def _position(self, stamp_ns: int, place: GeodeticPlace, quality: Quality) -> PositionSample:
        self._status = quality.status
        return PositionSample(
            self._positions.after(stamp_ns),
            self._position_source,
            quality.status,
            place.latitude_rad,
            place.longitude_rad,
            place.height_msl_m + self._undulation_m,
            np.diag(quality.position_variance),
        )

    def _velocity(
        self, stamp_ns: int, velocity_n: Vector, quality: Quality
    ) -> list[VelocitySample]:
        if quality.status < FixStatus.SINGLE:
            self._count("velocity_without_fix")
            return []
        covariance = np.diag((quality.velocity_variance,) * 3)
        stamp_ns = self._velocities.after(stamp_ns)
        velocity = np.array(velocity_n)
        return [VelocitySample(stamp_ns, self._velocity_source, velocity, covariance)]


def _is_place(place: GeodeticPlace) -> bool:
    """Return whether the place is on the earth; false for a NaN."""
    latitude, longitude, height = abs(place[0]), abs(place[1]), abs(place[2])
    within = latitude <= math.pi / 2 and longitude <= math.pi and height < LARGEST_HEIGHT_M
    return within and (latitude > _NO_PLACE_RAD or longitude > _NO_PLACE_RAD)
