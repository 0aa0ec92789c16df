"""Readings of the ordinary GPS: its kind of fix to status, its accuracy to covariance."""

from __future__ import annotations

import math
from collections import Counter

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.config.aiding import GpsConfig
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, VelocitySample
from tirgeo_ros.dji.interpret.receiver import Held, Receiver
from tirgeo_ros.dji.interpret.receiver_epochs import Value
from tirgeo_ros.dji.interpret.rtk_status import NO_FIX, UNKNOWN_SIGMA_M, Quality
from tirgeo_ros.dji.sources.readings import GpsReading

_FIX_2D, _FIX_3D, _FIX_GPS_DR = 2, 3, 4
FIX_NAMES = {
    0: "none",
    1: "dead reckoning",
    _FIX_2D: "2D",
    _FIX_3D: "3D",
    _FIX_GPS_DR: "GPS and dead reckoning",
    5: "time only",
}
#: The height of a 2D fix is an assumed one: as far off as mountains are high.
_SIGMA_2D_DOWN_M = 1000.0
#: Of the place of a 2D fix whose accuracy is not told: what a wrong height does to it too.
_SIGMA_2D_M = 10.0

_USUAL_SIGMA_M = GpsConfig().position_sigma_m

_Sigmas = tuple[float | None, float | None, float | None]  # across, down (m), velocity (m/s)
_NOT_TOLD: _Sigmas = (None, None, None)


class GpsMeaning:
    """The ordinary GPS's readings to samples.

    3D fixes (with dead reckoning or without) are single; so are 2D ones, with a height that says
    nothing; all others are no fix. What a reading lacks of fix and accuracy is the newest for
    1.5 s. A road that has never told the kind of fix has none to tell: its places are single.
    Where no accuracy is told the covariance is zero: not known, and the filter has its own. Where
    only that across or down is told, the other is the filter's default.
    """

    def __init__(self, config: DjiConfig, undulation_m: float, counts: Counter[str]) -> None:
        self._receiver = Receiver("gps", undulation_m, counts)
        self._delay_ns = round(config.delay.gps_s * 1e9)
        self._fix: Held[int] = Held()
        self._sigmas: Held[_Sigmas] = Held()

    def take(self, reading: GpsReading) -> list[PositionSample | VelocitySample]:
        """The samples of what is new in a reading."""
        receiver, stamp_ns = self._receiver, reading.stamp_ns - self._delay_ns
        place = receiver.usable_place(reading.place)
        if receiver.is_late(stamp_ns, place):
            return []
        velocity_n = receiver.usable_velocity(reading.velocity_n)
        self._hear(stamp_ns, reading)
        parts: dict[str, Value | None] = {"place": place, "velocity": velocity_n}
        there = {part: value for part, value in parts.items() if value is not None}
        fresh = receiver.news(stamp_ns, there)
        return receiver.samples(stamp_ns, fresh, place, velocity_n, self._quality(stamp_ns))

    def _hear(self, stamp_ns: int, reading: GpsReading) -> None:
        self._fix.hear(stamp_ns, reading.fix)
        sigmas = (
            _known(reading.horizontal_sigma_m),
            _known(reading.vertical_sigma_m),
            _known(reading.velocity_sigma_m_s),
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

    def diagnostics(self, now_ns: int) -> dict[str, str]:
        """The kind of fix in words, the age of the newest epoch, whether it is frozen."""
        epoch_ns, fix = self._receiver.epoch_ns, self._fix.newest
        if epoch_ns is None and fix is None:
            return {}
        found = {"gps_fix": "not told" if fix is None else FIX_NAMES.get(fix, f"unknown {fix}")}
        if epoch_ns is not None:
            found["gps_age_s"] = f"{(now_ns - self._delay_ns - epoch_ns) * 1e-9:.2f}"
            found["gps_frozen"] = "yes" if self._receiver.frozen else "no"
        return found


def _known(sigma: float | None) -> float | None:
    """None for what a receiver says when it does not know: zero, NaN."""
    return min(sigma, UNKNOWN_SIGMA_M) if sigma is not None and 0 < sigma < math.inf else None
