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
"""Convert readings of the RTK receiver and of the ordinary GPS to samples, each epoch once.

Flags and stated accuracies become status and covariance. Heights above the sea become ellipsoidal.
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

T = TypeVar("T")
R = TypeVar("R", GpsReading, RtkReading)
Value = tuple[float, ...]
_Sigmas = tuple[float | None, float | None, float | None]  # horizontal, down (m), velocity (m/s)

# Epochs and how long values are valid.

#: Half of the receiver's period of 200 ms. A part that changes within this time after the epoch's
#: first change belongs to the same epoch, unless it has changed in that epoch already: the parts
#: may come in separate messages, or one by one in the fields of a polled message.
_TOGETHER_NS = 100_000_000
#: Two sources that compute a value in different orders of operations differ in the last digits. A
#: receiver's noise is far above this (1e-12 rad is 6 um).
_ROUNDING = 1e-12
#: A flag that came in a message of its own is valid this long: seven epochs of the receiver, or
#: one and a half periods of a source that sends one message a second.
_VALID_NS = 1_500_000_000
#: A place that was last received longer ago than this, five epochs, is not published again.
_SILENT_NS = 1_000_000_000

# Limits of places and velocities.

#: A place nearer to 0, 0 than this (0.6 m) means no place.
_NO_PLACE_RAD = 1e-7
#: The core's limit: no aircraft is faster.
_LARGEST_SPEED_M_S = 1e3
#: Sigma of a place without known accuracy: no weight, but finite in sums.
UNKNOWN_SIGMA_M = 1e5

# The RTK receiver.

#: The receiver's status number of a narrow-lane integer solution (NovAtel's position types).
FIXED_FLAG = 50
#: Flags; status; horizontal and vertical sigma (m); factor on the fixed solution's velocity sigma.
#: Wrong integers of the wide lane are 0.86 m apart, and their carrier noise is a few times the
#: narrow lane's. A float solution has settled to some decimetres. Code positions are good to a
#: metre with corrections, to some metres without. Velocities come from Doppler and need no
#: integers: they get worse only with the signals.
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
    "aircraft.second_antenna_m is not set: RTK yaw is used as that of DJI's kit, with the first "
    "antenna left and the second right; set aircraft.rtk_antenna_m and aircraft.second_antenna_m"
)

# The ordinary GPS.

#: Kinds of fix: 2D, 3D, GPS and dead reckoning. All others (none, dead reckoning, time) are none.
_FIX_2D, _FIX_3D, _FIX_GPS_DR = 2, 3, 4
#: The receiver assumes the height of a 2D fix: its error may be as large as a mountain.
_SIGMA_2D_DOWN_M = 1000.0
#: Horizontal sigma of a 2D fix without a stated accuracy; covers the effect of a wrong height.
_SIGMA_2D_M = 10.0
_USUAL_SIGMA_M = GpsConfig().position_sigma_m
_NOT_STATED: _Sigmas = (None, None, None)


class ReceiverEpochs:
    """Find the parts of readings (place, velocity, yaw) that are new.

    RTK and GPS measure five times a second whatever rate is requested, and repeat the same values
    in between under new stamps. A reading has no epoch number, so epochs are recognised by a
    change of values. Late readings are recognised by the part ``place``.
    """

    def __init__(self) -> None:
        self.begun_ns: int | None = None  # when the newest epoch was first received
        self._number = 0
        self._values: dict[str, Value] = {}
        self._changed: set[str] = set()
        self._new_in: dict[str, int] = {}  # by part: the epoch in which it was new
        self._place_before: Value | None = None

    def is_late(self, stamp_ns: int, place: Value | None) -> bool:
        """Return whether a place is that of the previous epoch, delayed by a slower source."""
        if place is None or self.begun_ns is None or _same(place, self._values.get("place")):
            return False
        recent = abs(stamp_ns - self.begun_ns) < _TOGETHER_NS
        return recent and _same(place, self._place_before)

    def news(self, stamp_ns: int, parts: Mapping[str, Value]) -> set[str]:
        """Return the parts that are new: with a changed value, or for the first time in an epoch.

        The value alone is not enough: a yaw in whole degrees stays the same for long.
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


class Quality(NamedTuple):
    """Hold status and variances of a satellite solution."""

    status: FixStatus
    position_variance: tuple[float, float, float]  # north, east, down, m2; zeros: not known
    velocity_variance: float  # of each axis, (m/s)2; zero: not known


NO_FIX = Quality(FixStatus.NONE, (UNKNOWN_SIGMA_M**2,) * 3, UNKNOWN_SIGMA_M**2)


class NewestValue(Generic[T]):
    """Hold the newest value of a field that some messages lack."""

    def __init__(self) -> None:
        self.newest: T | None = None
        self._stamp_ns = 0

    def take(self, stamp_ns: int, value: T | None) -> None:
        """Take the value of a message; ignore None."""
        if value is not None:
            self.newest, self._stamp_ns = value, stamp_ns

    def at(self, stamp_ns: int) -> T | None:
        """Return the newest value; None if its stamp is too far from this instant."""
        return self.newest if abs(stamp_ns - self._stamp_ns) <= _VALID_NS else None


class Receiver(Generic[R]):
    """Convert a receiver's readings to samples, each measurement once.

    Counted, each after ``name``: ``_repeated`` (readings with nothing new), ``_late`` (readings of
    the previous epoch, from a slower source), ``_position_refused``, ``_velocity_refused`` (not
    finite, out of range or 0, 0), ``_velocity_without_fix`` and ``_status_fell`` (a place that was
    published again because its fix is worse now).
    """

    def __init__(self, name: str, undulation_m: float, counts: Counter[str]) -> None:
        """Take ``name`` (rtk or gps) and ``undulation_m``, which is added to heights."""
        self._name = name
        self._delay_ns = 0  # set by ``configure``
        self._position_source = Source[f"{name.upper()}_POSITION"]
        self._velocity_source = Source[f"{name.upper()}_VELOCITY"]
        self._undulation_m = undulation_m
        self._counts = counts
        self._epochs = ReceiverEpochs()
        self._positions, self._velocities = Sequence(), Sequence()
        self._place: GeodeticPlace | None = None  # the newest published place
        self._place_ns = 0  # when that place was new
        self._received_ns = 0  # when a place was last received
        self._status = FixStatus.NONE  # published with the newest place
        self._speed_m_s = 0.0

    def _take_quality(self, stamp_ns: int, reading: R) -> None:
        """Store the flags or accuracies that a reading states."""
        raise NotImplementedError

    def _quality(self, stamp_ns: int) -> Quality:
        """Return the quality of the solution at an instant."""
        raise NotImplementedError

    def take(self, reading: R) -> list[Any]:
        """Return the samples of the new parts of a reading."""
        return self._convert(reading.stamp_ns - self._delay_ns, reading, {})[1]

    def _convert(
        self, stamp_ns: int, reading: R, others: dict[str, Value]
    ) -> tuple[set[str], list[Any]]:
        """Return the names of the new parts, and the samples of new position and velocity.

        ``others``: the reading's other parts. Both results are empty for a late reading.
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
        self._take_quality(stamp_ns, reading)
        parts = dict(others)
        if place is not None:
            parts["place"] = place
            self._received_ns = stamp_ns
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
        # A worse status is published at once, with the newest place. A better status waits for the
        # next place: the newest place was measured before it.
        recent = abs(stamp_ns - self._received_ns) <= _SILENT_NS
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


def baseline_deg(aircraft: AircraftConfig) -> float:
    """Return the direction from the first antenna to the second, from the nose, clockwise (deg).

    It is that of DJI's kit if the second antenna's position is not set. Raises ConfigError if the
    two positions give no heading.
    """
    direction_deg = aircraft.baseline_deg
    return _KIT_DEG if direction_deg is None else direction_deg


class RtkInterpreter(Receiver[RtkReading]):
    """Convert the RTK receiver's readings to samples.

    RTK yaw is the azimuth of the line from the first antenna to the second. The angle of this line
    from the nose follows from the positions of both antennas; ``core.checks.heading_checks``
    compares the heading with the autopilot's.

    If a reading lacks a flag, the newest flag is used for up to 1.5 s; after that there is no fix.
    Counted in addition to the counts of ``Receiver``: ``rtk_yaw_not_fixed``, headings that were
    dropped because of their flag.
    """

    def __init__(self, config: DjiConfig, undulation_m: float, counts: Counter[str]) -> None:
        super().__init__("rtk", undulation_m, counts)
        self._offset_deg = baseline_deg(config.aircraft)
        self.configure(config)
        self._position_flag: NewestValue[int] = NewestValue()
        self._yaw_flag: NewestValue[int] = NewestValue()
        self._headings = Sequence()

    def configure(self, config: DjiConfig) -> None:
        """Take sigmas and delay, at the start or changed in flight."""
        self._delay_ns = round(config.rtk.delay_s * 1e9)
        self._heading_variance = math.radians(config.heading.sigma_deg) ** 2
        self._qualities = _qualities(config.rtk)

    def take(self, reading: RtkReading) -> list[Any]:
        """Return the samples of the new parts of a reading."""
        stamp_ns, yaw_deg = reading.stamp_ns - self._delay_ns, reading.yaw_deg
        yaw: dict[str, Value] = {} if yaw_deg is None else {"yaw": (float(yaw_deg),)}
        fresh, samples = self._convert(stamp_ns, reading, yaw)
        if yaw_deg is not None and "yaw" in fresh:
            samples += self._heading(stamp_ns, yaw_deg)
        return samples

    def _take_quality(self, stamp_ns: int, reading: RtkReading) -> None:
        self._position_flag.take(stamp_ns, reading.position_flag)
        self._yaw_flag.take(stamp_ns, reading.yaw_flag)

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
    """Return the quality of each flag that means a fix.

    Its sigmas are at least those of a fixed solution.
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


class GpsInterpreter(Receiver[GpsReading]):
    """Convert the ordinary GPS's readings to samples.

    3D fixes (with dead reckoning or without) have the status SINGLE. So have 2D fixes, with a
    sigma that makes their height irrelevant. All other kinds are no fix. If a reading lacks fix
    type or accuracy, the newest value is used for up to 1.5 s. If a source has never sent the fix
    type, its positions are SINGLE. If no accuracy is stated, the covariance is zero, which means
    unknown: the filter then uses its default. If only the horizontal or only the vertical accuracy
    is stated, the other is the filter's default.
    """

    def __init__(self, config: DjiConfig, undulation_m: float, counts: Counter[str]) -> None:
        super().__init__("gps", undulation_m, counts)
        self.configure(config)
        self._fix: NewestValue[int] = NewestValue()
        self._sigmas: NewestValue[_Sigmas] = NewestValue()

    def configure(self, config: DjiConfig) -> None:
        """Take the delay, at the start or changed in flight."""
        self._delay_ns = round(config.delay.gps_s * 1e9)

    def _take_quality(self, stamp_ns: int, reading: GpsReading) -> None:
        self._fix.take(stamp_ns, reading.fix)
        sigmas = (
            _stated(reading.horizontal_sigma_m),
            _stated(reading.vertical_sigma_m),
            _stated(reading.velocity_sigma_m_s),
        )
        self._sigmas.take(stamp_ns, None if sigmas == _NOT_STATED else sigmas)

    def _quality(self, stamp_ns: int) -> Quality:
        fix = _FIX_3D if self._fix.newest is None else self._fix.at(stamp_ns)
        if fix not in {_FIX_2D, _FIX_3D, _FIX_GPS_DR}:
            return NO_FIX
        horizontal, vertical, speed = self._sigmas.at(stamp_ns) or _NOT_STATED
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
