"""Store the accuracy that the receivers report; a poor one is no reason to call the state lost."""

from __future__ import annotations

import math

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source

#: Bound over reported sigma: a state with a position of some sigma may drift by about as much.
_DRIFT_RATIO = 1.5


class ReportedAccuracy:
    """Hold the receivers' reported variances; give the state's bounds and a message."""

    def __init__(self, config: EkfConfig) -> None:
        self._bound_m = config.trust.lost_position_sigma_m
        self.least_m2 = self._bound_m**2  # smaller variances are within the bounds
        self._variances: dict[Source, tuple[float, float, float]] = {}  # NED, m2

    def hear(self, sample: PositionSample) -> None:
        """Take a position; it counts where it has a fix and a covariance."""
        north, east, down = sample.covariance_n.diagonal().tolist()
        if sample.status >= FixStatus.SINGLE and min(north, east, down) > 0:
            self._variances[sample.source] = north, east, down

    def bounds_m2(self) -> tuple[float, ...]:
        """Return the variances (3,) NED, m2, beyond which a state is lost."""
        most = [max(axis, default=0.0) for axis in zip(*self._variances.values(), strict=True)]
        least_m2 = self.least_m2
        return tuple(max(least_m2, _DRIFT_RATIO**2 * axis) for axis in most) or (least_m2,) * 3

    def text(self) -> str:
        """Return what is poor about the ordinary GPS, or an empty string."""
        variances = self._variances.get(Source.GPS_POSITION)
        if variances is None:
            return ""
        across, down = math.sqrt(max(variances[:2])), math.sqrt(variances[2])
        told = [f"{across:.0f} m"] if across > self._bound_m else []
        told += [f"{down:.0f} m in height"] if down > self._bound_m else []
        return f"gps/fix has a sigma of {', '.join(told)}" if told else ""
