"""Set the origin of the frame ``map``: as configured, or at the first good position."""

from __future__ import annotations

import math

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.streams.sanity_checks import LARGEST_HEIGHT_M
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.measurements import FixStatus, NavigationInput, PositionSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict


class MapOrigin:
    """Hold the tangent plane of ``map``; once set, it stays.

    Without a configured origin ``source`` will set it. Raises ConfigError for an origin that is
    not on earth.
    """

    def __init__(self, config: EkfConfig, source: Source) -> None:
        self.plane: TangentPlane | None = None
        self._source = source
        gps = source is Source.GPS_POSITION
        self._least_status = FixStatus.SINGLE if gps else FixStatus.FLOAT
        if config.origin_lat_lon_h:
            lat, lon, height_m = config.origin_lat_lon_h
            wrong = "" if abs(height_m) < LARGEST_HEIGHT_M else f"{height_m:g} m is no height"
            if abs(lat) > 90 or abs(lon) > 180:
                wrong = f"{lat:g}, {lon:g} deg is not a latitude and longitude"
            if wrong:
                raise ConfigError(f"parameter origin_lat_lon_h: {wrong} on earth")
            self.plane = TangentPlane(math.radians(lat), math.radians(lon), height_m)

    def see(self, sample: NavigationInput, verdict: Verdict) -> None:
        """Set the origin to the first good position: RTK from float on, GPS from single on."""
        if not isinstance(sample, PositionSample) or sample.source is not self._source:
            return
        accepted = verdict.outcome in {Outcome.USED, Outcome.WAITING}
        if accepted and sample.status >= self._least_status:
            self.start_at(sample)

    def start_at(self, place: NavState | PositionSample) -> None:
        """Set the origin to a place, where none is set."""
        if self.plane is None:
            self.plane = TangentPlane(place.latitude_rad, place.longitude_rad, place.height_m)
