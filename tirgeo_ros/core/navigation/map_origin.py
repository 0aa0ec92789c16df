"""Set the origin of the frame ``map``: as configured, or at the first good position."""

from __future__ import annotations

import math

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding.state_estimate import Aiding
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.streams.sanity_checks import LARGEST_HEIGHT_M
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict


class MapOrigin:
    """Hold the tangent plane of ``map``; once set, it stays.

    Raises ConfigError for an origin that is not on earth.
    """

    def __init__(self, config: EkfConfig, position_source: Source) -> None:
        """Read the configured origin; without one ``position_source`` will set it."""
        self.plane = _plane_at(*config.origin_lat_lon_h) if config.origin_lat_lon_h else None
        self._source = position_source
        gps = position_source is Source.GPS_POSITION
        self._least_status = FixStatus.SINGLE if gps else FixStatus.FLOAT

    def see(self, sample: Aiding, verdict: Verdict) -> None:
        """Set the origin to the first good position: RTK from float on, GPS from single on."""
        if self.plane is not None or not isinstance(sample, PositionSample):
            return
        if sample.source is not self._source or sample.status < self._least_status:
            return
        if verdict.outcome in {Outcome.USED, Outcome.WAITING}:
            self.plane = TangentPlane(sample.latitude_rad, sample.longitude_rad, sample.height_m)

    def start_at(self, state: NavState) -> None:
        """Set the origin to the filter's first position, where no measured one has set it."""
        if self.plane is None:
            self.plane = TangentPlane(state.latitude_rad, state.longitude_rad, state.height_m)


def _plane_at(latitude_deg: float, longitude_deg: float, height_m: float) -> TangentPlane:
    if abs(latitude_deg) > 90 or abs(longitude_deg) > 180:
        raise ConfigError(
            f"parameter origin_lat_lon_h: {latitude_deg:g}, {longitude_deg:g} deg is no latitude "
            "and longitude"
        )
    if abs(height_m) >= LARGEST_HEIGHT_M:
        raise ConfigError(f"parameter origin_lat_lon_h: {height_m:g} m is no height on earth")
    return TangentPlane(math.radians(latitude_deg), math.radians(longitude_deg), height_m)
