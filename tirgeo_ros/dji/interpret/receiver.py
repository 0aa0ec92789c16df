"""Convert what RTK and ordinary GPS have in common: places, velocities, and their repeats."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from typing import Generic, TypeVar

import numpy as np

from tirgeo_ros.core.streams.sanity_checks import LARGEST_HEIGHT_M
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source, VelocitySample
from tirgeo_ros.dji.interpret.receiver_epochs import ReceiverEpochs, Value
from tirgeo_ros.dji.interpret.rtk_status import Quality
from tirgeo_ros.dji.interpret.sequence_stamps import Sequence
from tirgeo_ros.dji.sources.readings import GeodeticPlace, Vector

#: A flag that came in a message of its own is valid this long: seven epochs of the receiver, and
#: one and a half messages of a source that passes one in a second.
HOLD_NS = 1_500_000_000
#: A receiver that repeats the same values for longer is frozen: five epochs.
_FROZEN_NS = 1_000_000_000
#: A place nearer to 0, 0 than this (0.6 m) means no place.
_NO_PLACE_RAD = 1e-7


#: The core's limit: no aircraft is faster.
_LARGEST_SPEED_M_S = 1e3

T = TypeVar("T")


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


class Receiver:
    """Convert a receiver's places and velocities to samples, each measurement once.

    Counted under ``name``: ``_repeated`` (readings without anything new), ``_late`` (of the epoch
    before, from a slower source), ``_position_refused``, ``_velocity_refused`` (not finite, out of
    range or 0, 0), ``_velocity_without_fix``, ``_status_fell`` (a place published again because
    its fix is worse now) and ``_frozen`` (times that it repeated the same for over a second).
    """

    def __init__(self, name: str, undulation_m: float, counts: Counter[str]) -> None:
        """Take ``name``, rtk or gps, and ``undulation_m``, which is added to heights."""
        self._name = name
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
        self._frozen = False

    @property
    def epoch_ns(self) -> int | None:
        """Return when the newest measurement was first received."""
        return self._epochs.begun_ns

    @property
    def frozen(self) -> bool:
        """Return whether it has repeated the same for over a second, where it sends anything."""
        return self._frozen

    def usable_place(self, place: GeodeticPlace | None) -> GeodeticPlace | None:
        """Return the place; None if it is invalid, which is counted."""
        if place is None or _is_place(place):
            return place
        self._counts[f"{self._name}_position_refused"] += 1
        return None

    def usable_velocity(self, velocity_n: Vector | None) -> Vector | None:
        """Return the velocity; None if it is invalid, which is counted."""
        if velocity_n is None or all(abs(v) < _LARGEST_SPEED_M_S for v in velocity_n):
            return velocity_n
        self._counts[f"{self._name}_velocity_refused"] += 1
        return None

    def is_late(self, stamp_ns: int, place: GeodeticPlace | None) -> bool:
        """Return whether a reading is of the epoch before the newest; count it if so."""
        late = self._epochs.is_late(stamp_ns, place)
        self._counts[f"{self._name}_late"] += late
        return late

    def news(self, stamp_ns: int, parts: dict[str, Value]) -> set[str]:
        """Return the parts that are new; count readings without any, and freezing."""
        fresh = self._epochs.news(stamp_ns, parts)
        if "place" in parts:
            self._seen_ns = stamp_ns
        if fresh:
            self._frozen = False
        elif parts:
            self._counts[f"{self._name}_repeated"] += 1
            self._check_freezing(stamp_ns)
        return fresh

    def _check_freezing(self, stamp_ns: int) -> None:
        begun_ns = self._epochs.begun_ns
        # a receiver without a fix has nothing new to send
        without_fix = self._status is FixStatus.NONE
        if begun_ns is None or without_fix or self._frozen or stamp_ns - begun_ns <= _FROZEN_NS:
            return
        self._frozen = True
        self._counts[f"{self._name}_frozen"] += 1

    def samples(
        self,
        stamp_ns: int,
        fresh: Iterable[str],
        place: GeodeticPlace | None,
        velocity_n: Vector | None,
        quality: Quality,
    ) -> list[PositionSample | VelocitySample]:
        """Return the samples of the parts in ``fresh``.

        Repeat a place whose fix has become worse.
        """
        found: list[PositionSample | VelocitySample] = []
        if velocity_n is not None:
            self._speed_m_s = math.hypot(*velocity_n)
        if place is not None and "place" in fresh:
            self._place, self._place_ns = place, stamp_ns
            found.append(self._position(stamp_ns, place, quality))
        elif self._fell(stamp_ns, quality.status) and self._place is not None:
            self._counts[f"{self._name}_status_fell"] += 1
            found.append(self._position(stamp_ns, self._place, self._moved(stamp_ns, quality)))
        if velocity_n is not None and "velocity" in fresh:
            found += self._velocity(stamp_ns, velocity_n, quality)
        return found

    def _fell(self, stamp_ns: int, status: FixStatus) -> bool:
        """Return whether the fix is worse than when the place, which is still sent, was published.

        A fix that becomes better waits for the next place: this one was measured without it.
        """
        return status < self._status and abs(stamp_ns - self._seen_ns) <= _FROZEN_NS

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
            self._counts[f"{self._name}_velocity_without_fix"] += 1
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
