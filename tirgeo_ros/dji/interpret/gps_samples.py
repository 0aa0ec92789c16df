"""Convert readings of the ordinary GPS: fix type to status, accuracy to covariance."""

from __future__ import annotations

import math
from collections import Counter

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.config.filter_aiding import GpsConfig
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.dji.interpret.receiver import NO_FIX, UNKNOWN_SIGMA_M, Held, Quality, Receiver
from tirgeo_ros.dji.sources.readings import GpsReading

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


def _known(sigma: float | None) -> float | None:
    """Return the sigma, limited; None for the values that mean unknown: zero, NaN, infinity."""
    return min(sigma, UNKNOWN_SIGMA_M) if sigma is not None and 0 < sigma < math.inf else None
