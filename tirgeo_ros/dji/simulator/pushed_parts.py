"""Build the parts of a broadcast and the topics of a push from the aircraft's state."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from datetime import datetime, timedelta, timezone
from functools import cached_property
from typing import Any, TypeVar

from tirgeo_ros.core.config import AircraftConfig, SimulatedAircraftConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat, slerp
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.dji.clocks.aircraft_clock import LONG_TICK_NS
from tirgeo_ros.dji.interpret.imu_samples import G_M_S2
from tirgeo_ros.dji.interpret.receiver import baseline_deg
from tirgeo_ros.dji.protocol import broadcast_parts as parts
from tirgeo_ros.dji.protocol.broadcast import Broadcast, Layout
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
    newest = (samples[source] for source in sources if source in samples)
    return next((sample for sample in newest if now_ns - sample.stamp_ns <= _SILENT_NS), None)


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


#: Values that no flight records: in the air, position mode; sticks at rest; a lasting battery.
_STATUS = parts.Status(2, 6, 0, 0)
_RC = parts.Rc(0, 0, 0, 0, 8000, -4545)
_BATTERY = parts.Battery(5700, 24_600, -28_000, 80)
_DEVICE = parts.Device(6, 0)
_MAG = (210, -480, 1310)
_NOTHING_NEAR = parts.RelativePosition(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
_LEVEL_FIVE = 5
_GIMBAL_WELL = 0x7801  # mounted; escs, drone data
_U32 = 0xFFFFFFFF


class Instant:
    """Hold the aircraft's state at one instant, in the units of its messages.

    ``time_ns``: of its clock; ``since_ns``: since it was switched on here.
    """

    def __init__(
        self,
        time_ns: int,
        since_ns: int,
        imu: ImuSample,
        gimbal: parts.Gimbal | None,
        satellites: Satellites,
    ) -> None:
        self.ms, self.rest_ns = time_ns // 1_000_000 & _U32, time_ns % 1_000_000
        self.ticks, self.tick_rest_ns = (
            time_ns // LONG_TICK_NS & _U32,
            time_ns % LONG_TICK_NS,
        )
        self.ticks_here = since_ns // LONG_TICK_NS & _U32
        self.q_nb = imu.autopilot_q_nb
        self.force_b, self.rate_b = imu.specific_force_b, imu.angular_rate_b
        self.gimbal = gimbal
        self._now_ns, self._satellites = imu.stamp_ns, satellites

    @cached_property
    def rtk(self) -> parts.Rtk:
        """Return the RTK receiver's data."""
        return self._satellites.rtk(self._now_ns)

    @cached_property
    def gps(self) -> parts.Gps:
        """Return the ordinary receiver's data."""
        return self._satellites.gps(self._now_ns)

    @cached_property
    def position(self) -> parts.Position:
        """Return the fused position."""
        return self._satellites.position(self._now_ns)

    @cached_property
    def velocity(self) -> parts.Velocity:
        """Return the fused velocity."""
        return self._satellites.velocity(self._now_ns)

    @property
    def quaternion(self) -> Any:
        """Return the attitude as wxyz, None if it is not known."""
        return None if self.q_nb is None else _numbers(self.q_nb)

    def over_ground(self, v_b: Array, up: int) -> Any:
        """Return a vector over ground, its third axis down (``up`` = 1) or up (-1)."""
        q = self.q_nb
        return None if q is None else _numbers(matrix_from_quat(q) @ v_b * (1, 1, up))


def between(before: ImuSample, after: ImuSample, stamp_ns: int) -> ImuSample:
    """Interpolate the inertial values linearly between two samples."""
    if stamp_ns == after.stamp_ns:
        return after
    fraction = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    q, p = before.autopilot_q_nb, after.autopilot_q_nb
    return ImuSample(
        stamp_ns,
        before.specific_force_b + fraction * (after.specific_force_b - before.specific_force_b),
        before.angular_rate_b + fraction * (after.angular_rate_b - before.angular_rate_b),
        None if q is None or p is None else slerp(q, p, fraction),
    )


def broadcast_of(instant: Instant, layout: Layout, due: Collection[int]) -> Broadcast:
    """Return the broadcast of an instant with the parts whose bits of the mask are due."""
    modern = layout is Layout.MODERN
    parts = {
        name: make(instant)
        for bit, name, make in _PARTS
        if bit in due and (modern or name not in {"relative_position", "compass"})
    }
    return Broadcast(layout, **(parts if modern else {n: _old(part) for n, part in parts.items()}))


def _old(part: Any) -> Any:
    """Return a part in the form of the old layout."""
    if isinstance(part, parts.Time):
        return parts.Time(part.time_ms, part.time_ns, None, None, part.sync_flag)
    if isinstance(part, parts.Status):
        return parts.Status(part.flight)
    if isinstance(part, parts.Battery):
        return parts.Battery(None, None, None, part.percentage)
    return part._replace(detail=None) if isinstance(part, parts.Gps) else part


def topic_values(instant: Instant, names: tuple[str, ...]) -> dict[str, Any] | None:
    """Return the values of a package's topics; None where one of them is not known yet."""
    values = {name: _TOPICS[name](instant) for name in names}
    return None if any(value is None for value in values.values()) else values


def _numbers(v: Array) -> Any:
    """Return a vector or quaternion as a tuple."""
    return tuple(v.tolist())


def _hard_sync(i: Instant) -> parts.HardSync | None:
    if i.q_nb is None:
        return None
    force_g, rate = _numbers(i.force_b / G_M_S2), _numbers(i.rate_b)
    return parts.HardSync(i.ticks, i.tick_rest_ns, i.ticks_here, 0, 0, i.quaternion, force_g, rate)


def _gps_fused(i: Instant) -> parts.GpsFused:
    satellites = i.gps.detail.nsv if i.gps.detail else 0
    return parts.GpsFused(
        i.position.lon_rad, i.position.lat_rad, i.position.altitude_m, satellites
    )


_Make = Callable[[Instant], Any]

#: Bit of the mask, name in ``Broadcast``, and how the part is made.
_PARTS: tuple[tuple[int, str, _Make], ...] = (
    (0, "time", lambda i: parts.Time(i.ms, i.rest_ns, i.ticks, 0, 0)),
    (1, "quaternion_wxyz", lambda i: i.quaternion),
    (2, "acceleration_as_packed", lambda i: _numbers(i.force_b / G_M_S2)),
    (3, "velocity", lambda i: i.velocity),
    (4, "angular_rate_radps", lambda i: _numbers(i.rate_b)),
    (5, "position", lambda i: i.position),
    (5, "relative_position", lambda _: _NOTHING_NEAR),
    (6, "gps", lambda i: i.gps),
    (7, "rtk", lambda i: i.rtk),
    (8, "mag", lambda _: _MAG),
    (9, "rc", lambda _: _RC),
    (10, "gimbal", lambda i: i.gimbal),
    (11, "status", lambda _: _STATUS),
    (12, "battery", lambda _: _BATTERY),
    (13, "device", lambda _: _DEVICE),
    (14, "compass", lambda _: 0),
)

_TOPICS: dict[str, _Make] = {
    "QUATERNION": lambda i: i.quaternion,
    "ACCELERATION_GROUND": lambda i: i.over_ground(i.force_b, -1),
    "ACCELERATION_BODY": lambda i: _numbers(i.force_b * (1, 1, -1)),
    "ACCELERATION_RAW": lambda i: _numbers(i.force_b),
    "VELOCITY": lambda i: i.velocity,
    "ANGULAR_RATE_FUSIONED": lambda i: i.over_ground(i.rate_b, 1),
    "ANGULAR_RATE_RAW": lambda i: _numbers(i.rate_b),
    "ALTITUDE_FUSIONED": lambda i: i.position.altitude_m,
    "HEIGHT_FUSION": lambda i: i.position.height_m,
    "GPS_FUSED": _gps_fused,
    "GPS_DATE": lambda i: i.gps.date,
    "GPS_TIME": lambda i: i.gps.time,
    "GPS_POSITION": lambda i: parts.GpsPosition(i.gps.lon_1e7, i.gps.lat_1e7, i.gps.hfsl_mm),
    "GPS_VELOCITY": lambda i: i.gps.vel_ned_cmps,
    "GPS_DETAILS": lambda i: i.gps.detail,
    "RTK_POSITION": lambda i: parts.RtkPosition(i.rtk.lon_deg, i.rtk.lat_deg, i.rtk.hfsl_m),
    "RTK_VELOCITY": lambda i: i.rtk.vel_cmps,
    "RTK_YAW": lambda i: i.rtk.yaw_deg,
    "RTK_POSITION_INFO": lambda i: i.rtk.pos_flag,
    "RTK_YAW_INFO": lambda i: i.rtk.yaw_flag,
    "RC": lambda _: _RC,
    "GIMBAL_ANGLES": lambda i: i.gimbal and parts.GimbalAngles(*(i.gimbal[k] for k in (1, 0, 2))),
    "GIMBAL_STATUS": lambda _: _GIMBAL_WELL,
    "STATUS_FLIGHT": lambda _: _STATUS.flight,
    "STATUS_DISPLAYMODE": lambda _: _STATUS.mode,
    "BATTERY_INFO": lambda _: _BATTERY,
    "HARD_SYNC": _hard_sync,
    "GPS_CONTROL_LEVEL": lambda _: _LEVEL_FIVE,
}

#: Topics that can be subscribed to; firmware 3.2.41 lacks some that others have.
TOLD_TOPICS = frozenset(_TOPICS)
