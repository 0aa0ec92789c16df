"""Convert readings of the RTK receiver and of the ordinary GPS to samples, each epoch once.

Flags and stated accuracies become status and covariance; heights above the sea become ellipsoidal.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from math import isclose
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from tirgeo_ros.core.config import AircraftConfig, DjiConfig
from tirgeo_ros.core.config.dji_parameters import DjiRtkConfig
from tirgeo_ros.core.config.filter_parameters import GpsConfig
from tirgeo_ros.core.streams.sanity_checks import LARGEST_HEIGHT_M
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.dji.interpret.imu_samples import Sequence
from tirgeo_ros.dji.sources.readings import GeodeticPlace, GpsReading, RtkReading, Vector

#: Half of the receiver's 200 ms. A part that changes within this of an epoch's first change, and
#: has not changed with it, belongs to the same epoch: the parts may come in separate messages, or
#: one by one in the fields of a polled message.
_TOGETHER_NS = 100_000_000
#: Two sources that compute a value in another order of operations differ in the last digits. A
#: receiver's noise is far above this (1e-12 rad is 6 um).
_ROUNDING = 1e-12

Value = tuple[float, ...]


class ReceiverEpochs:
    """Find what is new in readings; ``place`` is the leading part.

    RTK and GPS measure five times a second whatever rate is requested, and repeat the same values
    in between under new stamps. A reading has no epoch number, so epochs are recognised by a
    change of values.
    """

    def __init__(self) -> None:
        self.begun_ns: int | None = None  # when the newest epoch was first received
        self._number = 0
        self._values: dict[str, Value] = {}
        self._changed: set[str] = set()
        self._new_in: dict[str, int] = {}  # part to the epoch in which it was new
        self._place_before: Value | None = None

    def is_late(self, stamp_ns: int, place: Value | None) -> bool:
        """Return whether a place belongs to the epoch before, delayed by a slower source."""
        if place is None or self.begun_ns is None or _same(place, self._values.get("place")):
            return False
        recent = abs(stamp_ns - self.begun_ns) < _TOGETHER_NS
        return recent and _same(place, self._place_before)

    def news(self, stamp_ns: int, parts: Mapping[str, Value]) -> set[str]:
        """Return the parts that are new: their value has changed, or their epoch.

        The value alone is not enough (a yaw in whole degrees stays the same for long): a part that
        comes with or after a change of another part belongs to a new epoch, and is new once.
        """
        changed = {part for part in parts if not _same(parts[part], self._values.get(part))}
        if changed:
            together = self.begun_ns is not None and 0 <= stamp_ns - self.begun_ns < _TOGETHER_NS
            if together and not changed & self._changed:
                self._changed |= changed
            else:  # another epoch begins
                self._number += 1
                self.begun_ns, self._changed = stamp_ns, changed
            if "place" in changed:
                self._place_before = self._values.get("place")
            self._values.update(parts)
        new_in = self._new_in
        fresh = {part for part in parts if part in changed or new_in.get(part) != self._number}
        new_in.update(dict.fromkeys(fresh, self._number))
        return fresh


def _same(value: Value, other: Value | None) -> bool:
    if value == other:
        return True
    return other is not None and all(
        isclose(a, b, rel_tol=0, abs_tol=_ROUNDING) for a, b in zip(value, other, strict=True)
    )


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
        samples: list[PositionSample | VelocitySample] = []
        if place is not None and "place" in fresh:
            self._place, self._place_ns = place, stamp_ns
            samples.append(self._position(stamp_ns, place, quality))
        # A fix that becomes worse is published at once with the place that is still sent. One that
        # gets better waits for the next place: this one was measured without it.
        recent = abs(stamp_ns - self._seen_ns) <= _SILENT_NS
        if not samples and self._place and quality.status < self._status and recent:
            self._count("status_fell")
            moved_m = self._speed_m_s * max(stamp_ns - self._place_ns, 0) * 1e-9
            north, east, down = (value + moved_m**2 for value in quality.position_variance)
            moved = quality._replace(position_variance=(north, east, down))
            samples.append(self._position(stamp_ns, self._place, moved))
        if velocity_n is not None and "velocity" in fresh:
            samples += self._velocity(stamp_ns, velocity_n, quality)
        return fresh, samples

    def _count(self, what: str) -> None:
        self._counts[f"{self._name}_{what}"] += 1

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
        covariance_n = np.diag((quality.velocity_variance,) * 3)
        stamp_ns, source = self._velocities.after(stamp_ns), self._velocity_source
        return [VelocitySample(stamp_ns, source, np.array(velocity_n), covariance_n)]


def _is_place(place: GeodeticPlace) -> bool:
    """Return whether the place is on the earth; false for a NaN."""
    latitude, longitude, height = abs(place[0]), abs(place[1]), abs(place[2])
    within = latitude <= math.pi / 2 and longitude <= math.pi and height < LARGEST_HEIGHT_M
    return within and (latitude > _NO_PLACE_RAD or longitude > _NO_PLACE_RAD)


#: The receiver's status number of a narrow-lane integer solution (NovAtel's position types).
FIXED_FLAG = 50
#: Flags; status; horizontal and vertical sigma (m); velocity sigma relative to a fixed solution's.
#: Wrong integers of the wide lane are 0.86 m apart, and their carrier noise is a few times the
#: narrow lane's. A float solution has settled to some decimetres. Code is good to a metre with
#: corrections, to some metres without. Velocities come from Doppler and need no integers: they get
#: worse with the signals alone.
_CLASSES = (
    ((FIXED_FLAG,), FixStatus.FIXED, (0.0, 0.0), 1.0),
    ((48, 49), FixStatus.FLOAT, (0.2, 0.4), 1.0),
    ((32, 33, 34), FixStatus.FLOAT, (0.5, 1.0), 2.0),
    ((17, 18, 20), FixStatus.FLOAT, (1.0, 2.0), 4.0),
    ((16, 19), FixStatus.SINGLE, (2.5, 5.0), 4.0),
)


#: Direction of the baseline of DJI's kit from the nose: first antenna left, second right.
_KIT_DEG = 90.0
NOT_SET = (
    "aircraft.second_antenna_m is not set: RTK yaw is taken as from DJI's kit, with the first "
    "antenna left and the second right; set aircraft.rtk_antenna_m and aircraft.second_antenna_m"
)


def baseline_deg(aircraft: AircraftConfig) -> float:
    """Return the direction from the first antenna to the second, from the nose, clockwise.

    DJI's kit where there is no second place. Raises ConfigError where the two give no heading.
    """
    known_deg = aircraft.baseline_deg
    return _KIT_DEG if known_deg is None else known_deg


class RtkInterpreter(Receiver[RtkReading]):
    """Convert the RTK receiver's readings to samples.

    RTK yaw is the azimuth of the line from the first antenna to the second. Its angle from the
    nose follows from the positions of the two; ``core.checks.heading_checks`` compares the result
    with the autopilot's heading.

    If a reading lacks a flag, the newest one is used for up to 1.5 s; after that there is no fix.
    Counted in addition to what ``Receiver`` counts: ``rtk_yaw_not_fixed``, headings dropped
    because of their flag.
    """

    def __init__(self, config: DjiConfig, undulation_m: float, counts: Counter[str]) -> None:
        super().__init__("rtk", config.rtk.delay_s, undulation_m, counts)
        self._offset_deg = baseline_deg(config.aircraft)
        self.configure(config)
        self._position_flag: Held[int] = Held()
        self._yaw_flag: Held[int] = Held()
        self._headings = Sequence()

    def configure(self, config: DjiConfig) -> None:
        """Take sigmas and delay, also others in flight."""
        self._delay_ns = round(config.rtk.delay_s * 1e9)
        self._heading_variance = math.radians(config.heading.sigma_deg) ** 2
        self._qualities = _qualities(config.rtk)

    def take(self, reading: RtkReading) -> list[Any]:
        """Return the samples of what is new in a reading."""
        stamp_ns, yaw_deg = reading.stamp_ns - self._delay_ns, reading.yaw_deg
        yaw: dict[str, Value] = {} if yaw_deg is None else {"yaw": (float(yaw_deg),)}
        fresh, samples = self._taken(stamp_ns, reading, yaw)
        if yaw_deg is not None and "yaw" in fresh:
            samples += self._heading(stamp_ns, yaw_deg)
        return samples

    def _hear(self, stamp_ns: int, reading: RtkReading) -> None:
        self._position_flag.hear(stamp_ns, reading.position_flag)
        self._yaw_flag.hear(stamp_ns, reading.yaw_flag)

    def _quality(self, stamp_ns: int) -> Quality:
        flag = self._position_flag.at(stamp_ns)
        return NO_FIX if flag is None else self._qualities.get(flag, NO_FIX)

    def _heading(self, stamp_ns: int, yaw_deg: float) -> list[HeadingSample]:
        if self._yaw_flag.at(stamp_ns) != FIXED_FLAG:
            self._count("yaw_not_fixed")
            return []
        heading_rad = math.radians((yaw_deg - self._offset_deg) % 360.0)
        stamp_ns = self._headings.after(stamp_ns)
        return [HeadingSample(stamp_ns, heading_rad, self._heading_variance)]

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return the newest flags of position and yaw."""
        flags = {"rtk_flag": self._position_flag.newest, "rtk_yaw_flag": self._yaw_flag.newest}
        return {name: str(flag) for name, flag in flags.items()}


def _qualities(config: DjiRtkConfig) -> dict[int, Quality]:
    """Return the flags that are a fix, each with its quality.

    No flag's sigmas are smaller than those of the fixed one.
    """
    qualities = {}
    for flags, status, sigmas_m, factor in _CLASSES:
        horizontal, vertical = (
            max(pair) ** 2 for pair in zip(sigmas_m, config.fixed_sigma_m, strict=True)
        )
        velocity_variance = (factor * config.velocity_sigma_m_s) ** 2
        quality = Quality(status, (horizontal, horizontal, vertical), velocity_variance)
        qualities.update(dict.fromkeys(flags, quality))
    return qualities


#: Kinds of fix: 2D, 3D, GPS and dead reckoning; others (none, dead reckoning, time only) are none.
_FIX_2D, _FIX_3D, _FIX_GPS_DR = 2, 3, 4
#: The height of a 2D fix is assumed by the receiver: its error may be as large as a mountain.
_SIGMA_2D_DOWN_M = 1000.0
#: Horizontal sigma of a 2D fix without a stated accuracy; it includes the effect of a wrong
#: height.
_SIGMA_2D_M = 10.0

_USUAL_SIGMA_M = GpsConfig().position_sigma_m

_Sigmas = tuple[float | None, float | None, float | None]  # horizontal, down (m), velocity (m/s)
_NOT_TOLD: _Sigmas = (None, None, None)


class GpsInterpreter(Receiver[GpsReading]):
    """Convert the ordinary GPS's readings to samples.

    3D fixes (with dead reckoning or without) are single. So are 2D fixes, with a sigma that makes
    their height irrelevant. All others are no fix. If a reading lacks fix type or accuracy, the
    newest one is used for up to 1.5 s. A source that has never sent the fix type cannot send it:
    its positions are single. Where no accuracy is stated the covariance is zero, which means
    unknown; the filter then uses its own. Where only the horizontal or only the vertical one is
    stated, the other is the filter's default.
    """

    def __init__(self, config: DjiConfig, undulation_m: float, counts: Counter[str]) -> None:
        super().__init__("gps", config.delay.gps_s, undulation_m, counts)
        self._fix: Held[int] = Held()
        self._sigmas: Held[_Sigmas] = Held()

    def configure(self, config: DjiConfig) -> None:
        """Take the delay, also another one in flight."""
        self._delay_ns = round(config.delay.gps_s * 1e9)

    def _hear(self, stamp_ns: int, reading: GpsReading) -> None:
        self._fix.hear(stamp_ns, reading.fix)
        sigmas = (
            _stated(reading.horizontal_sigma_m),
            _stated(reading.vertical_sigma_m),
            _stated(reading.velocity_sigma_m_s),
        )
        self._sigmas.hear(stamp_ns, None if sigmas == _NOT_TOLD else sigmas)

    def _quality(self, stamp_ns: int) -> Quality:
        fix = _FIX_3D if self._fix.newest is None else self._fix.at(stamp_ns)
        if fix not in {_FIX_2D, _FIX_3D, _FIX_GPS_DR}:
            return NO_FIX
        horizontal, vertical, speed = self._sigmas.at(stamp_ns) or _NOT_TOLD
        if fix == _FIX_2D:
            horizontal = horizontal or _SIGMA_2D_M
            vertical = max(vertical or 0.0, _SIGMA_2D_DOWN_M)
        variance = (0.0, 0.0, 0.0)
        if horizontal is not None or vertical is not None:
            north, east, down = _USUAL_SIGMA_M
            sigmas = (horizontal or north, horizontal or east, vertical or down)
            variance = (sigmas[0] ** 2, sigmas[1] ** 2, sigmas[2] ** 2)
        return Quality(FixStatus.SINGLE, variance, (speed or 0.0) ** 2)


def _stated(sigma: float | None) -> float | None:
    """Return the sigma, limited; None for the values that mean unknown: zero, NaN, infinity."""
    return min(sigma, UNKNOWN_SIGMA_M) if sigma is not None and 0 < sigma < math.inf else None
