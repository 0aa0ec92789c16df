"""Simulate the aircraft's two satellite receivers, whose data is repeated between their epochs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import datetime, timedelta, timezone
from typing import TypeVar

from tirgeo_ros.core.config import AircraftConfig, SimulatedAircraftConfig
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.dji.interpret.rtk_samples import baseline_deg
from tirgeo_ros.dji.protocol.broadcast_parts import Gps, GpsDetail, Position, Rtk, Vector, Velocity

S = TypeVar("S", PositionSample, VelocitySample)

#: NovAtel's numbers, which DJI uses: narrow-lane integer, narrow-lane float, single point, none.
_POSITION_FLAGS: Mapping[FixStatus, int] = {
    FixStatus.FIXED: 50,
    FixStatus.FLOAT: 34,
    FixStatus.SINGLE: 16,
    FixStatus.NONE: 0,
}
_YAW_FIXED = 50
_FIX_3D = 3.0
#: A receiver that has been silent for longer has no solution.
_SILENT_NS = 1_000_000_000
#: The dates in the aircraft's messages are in its maker's time zone.
_GMT8 = timezone(timedelta(hours=8))
#: Values that no flight records and nobody here reads.
_HDOP, _PDOP, _USED_GPS, _USED_GLONASS = 90.0, 150.0, 9, 5
_GOOD_HEALTH = 5


class Satellites:
    """Hold the newest data of each receiver, and return it in the units of the messages.

    Where a receiver is silent, its data has the flags of no solution, and zeros.
    """

    def __init__(self, config: SimulatedAircraftConfig, places: AircraftConfig) -> None:
        self._undulation_m = config.geoid_undulation_m
        self._baseline_deg = baseline_deg(places)
        self._positions: dict[Source, PositionSample] = {}
        self._velocities: dict[Source, VelocitySample] = {}
        self._heading: HeadingSample | None = None
        self._gps_epochs = 0
        self._first_height_m: float | None = None

    def take(self, sample: PositionSample | VelocitySample | HeadingSample) -> None:
        """Take a receiver's new epoch."""
        if isinstance(sample, HeadingSample):
            self._heading = sample
        elif isinstance(sample, VelocitySample):
            self._velocities[sample.source] = sample
        else:
            self._gps_epochs += sample.source is Source.GPS_POSITION
            self._positions[sample.source] = sample

    def rtk(self, now_ns: int) -> Rtk:
        """Return the RTK data.

        Its yaw is the azimuth from the first antenna to the second in whole degrees, -180 to 179.
        Headings that were made of whole degrees with the same antenna positions give those
        degrees; with other positions they are rounded a second time, by the same amount each time.
        """
        position = _recent(now_ns, self._positions, Source.RTK_POSITION)
        yaw_deg = yaw_flag = 0
        if self._heading is not None and now_ns - self._heading.stamp_ns <= _SILENT_NS:
            heading_deg = math.degrees(self._heading.heading_rad)
            yaw_deg = (round(heading_deg + self._baseline_deg) + 180) % 360 - 180
            yaw_flag = _YAW_FIXED
        return Rtk(
            *_date_and_time(now_ns if position is None else position.stamp_ns),
            *self._degrees(position),
            _cm_s(_recent(now_ns, self._velocities, Source.RTK_VELOCITY)),
            yaw_deg,
            0 if position is None else _POSITION_FLAGS[position.status],
            yaw_flag,
        )

    def gps(self, now_ns: int) -> Gps:
        """Return the ordinary receiver's data."""
        position = _recent(now_ns, self._positions, Source.GPS_POSITION)
        velocity = _recent(now_ns, self._velocities, Source.GPS_VELOCITY)
        lon_deg, lat_deg, height_m = self._degrees(position)
        fixed = position is not None and position.status is not FixStatus.NONE
        horizontal_m, vertical_m = _sigmas(None if position is None else position.covariance_n)
        speed_m_s, _ = _sigmas(None if velocity is None else velocity.covariance_n)
        detail = GpsDetail(
            _HDOP,
            _PDOP,
            _FIX_3D if fixed else 0.0,
            vertical_m * 1e3,
            horizontal_m * 1e3,
            speed_m_s * 1e2,
            _USED_GPS * fixed,
            _USED_GLONASS * fixed,
            (_USED_GPS + _USED_GLONASS) * fixed,
            self._gps_epochs & 0xFFFF,
        )
        return Gps(
            *_date_and_time(now_ns if position is None else position.stamp_ns),
            round(lon_deg * 1e7),
            round(lat_deg * 1e7),
            round(height_m * 1e3),
            _cm_s(velocity),
            detail,
        )

    def position(self, now_ns: int) -> Position:
        """Return the fused position: the receiver's, heights above the sea and the start."""
        best = _recent(now_ns, self._positions, Source.RTK_POSITION, Source.GPS_POSITION)
        if best is None or best.status is FixStatus.NONE:  # which may have any position
            return Position(0.0, 0.0, 0.0, 0.0, 0)
        height_m = best.height_m - self._undulation_m
        self._first_height_m = height_m if self._first_height_m is None else self._first_height_m
        above_m = height_m - self._first_height_m
        return Position(best.latitude_rad, best.longitude_rad, height_m, above_m, _GOOD_HEALTH)

    def velocity(self, now_ns: int) -> Velocity:
        """Return the fused velocity: the receiver's, north, east, up (m/s)."""
        best = _recent(now_ns, self._velocities, Source.RTK_VELOCITY, Source.GPS_VELOCITY)
        if best is None:
            return Velocity((0.0, 0.0, 0.0), 0)
        north, east, down = best.velocity_n.tolist()
        return Velocity((north, east, -down), 1)

    def _degrees(self, position: PositionSample | None) -> tuple[float, float, float]:
        """Return longitude (deg), latitude (deg) and height above the sea (m)."""
        if position is None or position.status is FixStatus.NONE:
            return 0.0, 0.0, 0.0
        lon_deg = math.degrees(position.longitude_rad)
        return (
            lon_deg if abs(lon_deg) <= 180 else math.remainder(lon_deg, 360),
            math.degrees(position.latitude_rad),
            position.height_m - self._undulation_m,
        )


def _recent(now_ns: int, samples: Mapping[Source, S], *sources: Source) -> S | None:
    """Return the sample of the first of these sources that is not silent."""
    found = (samples[source] for source in sources if source in samples)
    return next((sample for sample in found if now_ns - sample.stamp_ns <= _SILENT_NS), None)


def _cm_s(velocity: VelocitySample | None) -> Vector:
    """Return the velocity as NED in cm/s."""
    if velocity is None:
        return 0.0, 0.0, 0.0
    north, east, down = (100 * velocity.velocity_n).tolist()
    return north, east, down


def _sigmas(covariance_n: Array | None) -> tuple[float, float]:
    """Return the sigmas: horizontal (rms of the two axes), vertical; zero without covariance."""
    if covariance_n is None:
        return 0.0, 0.0
    north, east, down = covariance_n.diagonal().tolist()
    return math.sqrt(max(0.0, north + east) / 2), math.sqrt(max(0.0, down))


def _date_and_time(stamp_ns: int) -> tuple[int, int]:
    """Return date and time as the numbers yyyymmdd and hhmmss."""
    at = datetime.fromtimestamp(stamp_ns // 1_000_000_000, _GMT8)
    date = at.year * 10_000 + at.month * 100 + at.day
    return date, at.hour * 10_000 + at.minute * 100 + at.second
