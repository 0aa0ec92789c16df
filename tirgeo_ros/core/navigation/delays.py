"""From the stamps that sensors give to the times at which they measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.types.measurements import Source

#: Measurements may be ahead of the IMU by this, however little delay is allowed for.
_LEAST_HOLD_S = 0.2


class Delays(NamedTuple):
    """Stamp less time of measurement, in nanoseconds; negative where stamps are early."""

    imu_ns: int
    aid_ns: Mapping[Source, int]

    @classmethod
    def from_config(cls, config: EkfConfig) -> Delays:
        """As the parameters have them; headings without a delay of their own have the RTK's."""
        rtk_s, heading_s, gps_s = config.rtk.delay_s, config.heading.delay_s, config.gps.delay_s
        seconds = {
            Source.RTK_POSITION: rtk_s,
            Source.RTK_VELOCITY: rtk_s + config.rtk.velocity_delay_s,
            Source.RTK_HEADING: rtk_s if math.isnan(heading_s) else heading_s,
            Source.GPS_POSITION: gps_s,
            Source.GPS_VELOCITY: gps_s,
        }
        aid_ns = {source: round(delay_s * 1e9) for source, delay_s in seconds.items()}
        return cls(round(config.imu.delay_s * 1e9), aid_ns)

    @property
    def ahead_ns(self) -> int:
        """By how much the delays bring a measurement before the IMU samples of its arrival."""
        return max(0, self.imu_ns - min(self.aid_ns.values()))


def longest_hold_s(config: EkfConfig) -> float:
    """How far ahead of the IMU a measurement may be, to be held until the IMU reaches it."""
    return max(config.max_delay_s, _LEAST_HOLD_S) + Delays.from_config(config).ahead_ns * 1e-9
