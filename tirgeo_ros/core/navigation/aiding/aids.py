"""List the aids of the filter, the sources that each method uses, and the sensors' delays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid import Aid
from tirgeo_ros.core.navigation.aiding.autopilot_heading import AutopilotHeadingAid
from tirgeo_ros.core.navigation.aiding.barometer import BarometerAid
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import HeadingAid
from tirgeo_ros.core.navigation.aiding.gps_position import GpsPositionAid
from tirgeo_ros.core.navigation.aiding.gps_velocity import GpsVelocityAid
from tirgeo_ros.core.navigation.aiding.rtk_position import RtkPositionAid
from tirgeo_ros.core.navigation.aiding.rtk_velocity import RtkVelocityAid
from tirgeo_ros.core.navigation.aiding.set_heading import SetHeadingAid
from tirgeo_ros.core.types.measurements import Source

#: Everything that asks for an aid finds it here, by its source.
AIDS: Mapping[Source, type[Aid]] = {
    aid.source: aid
    for aid in (
        RtkPositionAid,
        RtkVelocityAid,
        HeadingAid,
        GpsPositionAid,
        GpsVelocityAid,
        BarometerAid,
        AutopilotHeadingAid,
        SetHeadingAid,
    )
}

_IMU, _EKF = Source.IMU, tuple(s for s in Source if s is not Source.AUTOPILOT_HEADING)
#: The sources that arrive as samples of their own, by method.
METHOD_SOURCES: Mapping[str, tuple[Source, ...]] = {
    "raw": (_IMU, Source.GPS_POSITION, Source.GPS_VELOCITY),
    "rtk": (_IMU, Source.RTK_POSITION, Source.RTK_VELOCITY),
    "ekf": tuple(source for source in _EKF if source is not Source.RTK_HEADING),
    "ekf_heading": _EKF,
}
#: The aids without which a filter is degraded, by method.
EXPECTED: Mapping[str, tuple[Source, ...]] = {
    "ekf": (Source.RTK_POSITION, Source.RTK_VELOCITY),
    "ekf_heading": (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING),
}
#: Measurements may be ahead of the IMU by at least this, however small ``max_delay_s`` is.
_LEAST_HOLD_S = 0.2


class Delays(NamedTuple):
    """Hold stamp minus time of measurement (ns) by sensor; negative where stamps are early."""

    imu_ns: int
    aid_ns: Mapping[Source, int]

    @classmethod
    def from_config(cls, config: EkfConfig) -> Delays:
        """Return the configured delays."""
        aid_ns = {
            source: round(aid.delay_s(config) * 1e9) for source, aid in AIDS.items() if aid.delay
        }
        return cls(round(config.imu.delay_s * 1e9), aid_ns)

    @property
    def ahead_ns(self) -> int:
        """Return how far the corrected stamp of an aid may be ahead of the IMU's on arrival.

        It is the IMU's delay less the smallest delay of an aid, and never negative. A barometer
        without a delay does not count: most aircraft have none here.
        """
        delays_ns = (ns for s, ns in self.aid_ns.items() if ns or s is not Source.BAROMETER)
        return max(0, self.imu_ns - min(delays_ns))


def longest_hold_s(config: EkfConfig) -> float:
    """Return how far ahead of the IMU (s) a measurement may be and still be held for it."""
    return max(config.max_delay_s, _LEAST_HOLD_S) + Delays.from_config(config).ahead_ns * 1e-9
