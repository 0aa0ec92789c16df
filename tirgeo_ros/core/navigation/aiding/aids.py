"""List the aids of the filter. Everything that asks for one finds it here, by its source."""

from __future__ import annotations

from collections.abc import Mapping

from tirgeo_ros.core.navigation.aiding.aid import Aid
from tirgeo_ros.core.navigation.aiding.autopilot_heading import AutopilotHeadingAid
from tirgeo_ros.core.navigation.aiding.barometer import BarometerAid
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import HeadingAid
from tirgeo_ros.core.navigation.aiding.gnss_fallback import GpsPositionAid
from tirgeo_ros.core.navigation.aiding.gnss_velocity import GpsVelocityAid, RtkVelocityAid
from tirgeo_ros.core.navigation.aiding.rtk_position import RtkPositionAid
from tirgeo_ros.core.types.measurements import Source

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
    )
}
