"""Convert time stamps of sensors to times of measurement."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.types.measurements import Source

#: Measurements may be ahead of the IMU by at least this, however small ``max_delay_s`` is.
_LEAST_HOLD_S = 0.2


class Delays(NamedTuple):
    """Hold stamp minus time of measurement (ns) by sensor; negative where stamps are early."""

    imu_ns: int
    aid_ns: Mapping[Source, int]

    @classmethod
    def from_config(cls, config: EkfConfig) -> Delays:
        """Return the configured delays; a heading without a delay of its own takes that of RTK."""
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
        """Return how far the corrected stamp of an aid may be ahead of the IMU's on arrival.

        It is the IMU's delay less the smallest delay of an aid, and never negative.
        """
        return max(0, self.imu_ns - min(self.aid_ns.values()))


def longest_hold_s(config: EkfConfig) -> float:
    """Return how far ahead of the IMU (s) a measurement may be and still be held for it."""
    return max(config.max_delay_s, _LEAST_HOLD_S) + Delays.from_config(config).ahead_ns * 1e-9
