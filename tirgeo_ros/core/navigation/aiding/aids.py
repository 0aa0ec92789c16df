"""List the aids of the filter, and the sources that each method uses."""

from __future__ import annotations

from collections.abc import Mapping

from tirgeo_ros.core.navigation.aiding.aid import Aid
from tirgeo_ros.core.navigation.aiding.autopilot_heading import AutopilotHeadingAid
from tirgeo_ros.core.navigation.aiding.barometer import BarometerAid
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import HeadingAid
from tirgeo_ros.core.navigation.aiding.gnss_position import GpsPositionAid, RtkPositionAid
from tirgeo_ros.core.navigation.aiding.gnss_velocity import GpsVelocityAid, RtkVelocityAid
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
