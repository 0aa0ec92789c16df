# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Convert a flight's samples to the parts of the aircraft's messages, in their units."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from typing import Any, NamedTuple

from tirgeo_ros.core.config import AircraftConfig, SimulatedAircraftConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
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
from tirgeo_ros.dji.interpret.gnss_samples import FIXED_FLAG, baseline_deg
from tirgeo_ros.dji.interpret.imu_samples import G_M_S2
from tirgeo_ros.dji.protocol import rtk_gps_imu_broadcast as parts

#: NovAtel's numbers, which DJI uses: narrow-lane integer, narrow-lane float, single point, none.
_POSITION_FLAGS = {
    FixStatus.FIXED: FIXED_FLAG,
    FixStatus.FLOAT: 34,
    FixStatus.SINGLE: 16,
    FixStatus.NONE: 0,
}
#: A receiver that has been silent for longer than this has no solution.
_SILENT_NS = 1_000_000_000
#: The dates in the aircraft's messages are in its maker's time zone.
_GMT8 = timezone(timedelta(hours=8))
_U32 = 0xFFFFFFFF
#: Values that no flight records: in the air, position mode; sticks at rest; a lasting battery.
_STATUS = parts.Status(2, 6, 0, 0)
_RC = parts.Rc(0, 0, 0, 0, 8000, -4545)
_BATTERY = parts.Battery(5700, 24_600, -28_000, 80)
_NOTHING_NEAR = parts.RelativePosition(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
_GIMBAL_WELL = 0x7801  # mounted; escs, drone data


class Receivers:
    """Hold the newest data of each receiver."""

    def __init__(self, config: SimulatedAircraftConfig, places: AircraftConfig) -> None:
        self.undulation_m = config.geoid_undulation_m
        self.baseline_deg = baseline_deg(places)
        self.newest: dict[Source, Any] = {}
        self.gps_epochs = 0
        self._first_height_m: float | None = None

    def take(self, sample: PositionSample | VelocitySample | HeadingSample) -> None:
        """Take a receiver's new epoch."""
        self.newest[sample.source] = sample
        self.gps_epochs += sample.source is Source.GPS_POSITION

    def above_start_m(self, height_m: float) -> float:
        """Return a height above the sea as the height above the first one."""
        self._first_height_m = height_m if self._first_height_m is None else self._first_height_m
        return height_m - self._first_height_m

    def degrees(self, position: PositionSample | None) -> tuple[float, float, float]:
        """Return longitude (deg), latitude (deg) and height above the sea (m)."""
        if position is None or position.status is FixStatus.NONE:
            return 0.0, 0.0, 0.0
        lon_deg = math.degrees(position.longitude_rad)
        lon_deg = lon_deg if abs(lon_deg) <= 180 else math.remainder(lon_deg, 360)
        return lon_deg, math.degrees(position.latitude_rad), position.height_m - self.undulation_m


def _ned_cm_s(velocity: VelocitySample | None) -> parts.Vector:
    return (0.0, 0.0, 0.0) if velocity is None else _numbers(100 * velocity.velocity_n)


def _sigmas(sample: PositionSample | VelocitySample | None) -> tuple[float, float]:
    """Return the sigmas: horizontal (rms of the two axes), vertical; zero without a sample."""
    if sample is None:
        return 0.0, 0.0
    north, east, down = sample.covariance_n.diagonal().tolist()
    return math.sqrt(max(0.0, north + east) / 2), math.sqrt(max(0.0, down))


def _date_and_time(now_ns: int, position: PositionSample | None) -> tuple[int, int]:
    """Return the position's (else the current) date and time as numbers yyyymmdd and hhmmss."""
    stamp_ns = now_ns if position is None else position.stamp_ns
    at = datetime.fromtimestamp(stamp_ns // 1_000_000_000, _GMT8)
    return int(f"{at:%Y%m%d}"), int(f"{at:%H%M%S}")


def _numbers(v: Array) -> Any:
    """Return a vector or quaternion as a tuple."""
    return tuple(v.tolist())


class Instant(NamedTuple):
    """Hold the aircraft's state at one instant, and return it in the units of the messages.

    The data of a silent receiver has the flags of no solution, and zeros.
    """

    time_ns: int  # of the aircraft's clock
    since_ns: int  # since the aircraft was switched on
    imu: ImuSample
    gimbal: parts.Gimbal | None
    receivers: Receivers

    @property
    def counters(self) -> tuple[int, int, int, int]:
        """Return its clock in ms and remaining ns; in ticks of 2.5 ms and remaining ns."""
        ms, rest_ns = divmod(self.time_ns, 1_000_000)
        ticks, tick_rest_ns = divmod(self.time_ns, LONG_TICK_NS)
        return ms & _U32, rest_ns, ticks & _U32, tick_rest_ns

    @property
    def quaternion(self) -> Any:
        """Return the attitude as wxyz, None if it is not known."""
        q_nb = self.imu.autopilot_q_nb
        return None if q_nb is None else _numbers(q_nb)

    def over_ground(self, v_b: Array, up: int) -> Any:
        """Return a vector over ground, its third axis down (``up`` = 1) or up (-1)."""
        q = self.imu.autopilot_q_nb
        return None if q is None else _numbers(matrix_from_quat(q) @ v_b * (1, 1, up))

    def _recent(self, *sources: Source) -> Any:
        """Return the sample of the first source that is not silent; None if all are silent."""
        newest = filter(None, map(self.receivers.newest.get, sources))
        earliest_ns = self.imu.stamp_ns - _SILENT_NS
        return next((sample for sample in newest if sample.stamp_ns >= earliest_ns), None)

    @property
    def rtk(self) -> parts.Rtk:
        """Return the RTK data.

        Its yaw is the azimuth from the first antenna to the second in whole degrees, -180 to 179.
        Recorded headings that were computed from whole degrees give the same degrees if the
        antenna positions are the same; if not, they are rounded again, always by the same amount.
        """
        position = self._recent(Source.RTK_POSITION)
        velocity = self._recent(Source.RTK_VELOCITY)
        heading = self._recent(Source.RTK_HEADING)
        yaw_deg = yaw_flag = 0
        if heading is not None:
            heading_deg = math.degrees(heading.heading_rad)
            yaw_deg = (round(heading_deg + self.receivers.baseline_deg) + 180) % 360 - 180
            yaw_flag = FIXED_FLAG
        flag = 0 if position is None else _POSITION_FLAGS[position.status]
        when, place = _date_and_time(self.imu.stamp_ns, position), self.receivers.degrees(position)
        return parts.Rtk(*when, *place, _ned_cm_s(velocity), yaw_deg, flag, yaw_flag)

    @property
    def gps(self) -> parts.Gps:
        """Return the ordinary receiver's data."""
        position = self._recent(Source.GPS_POSITION)
        velocity = self._recent(Source.GPS_VELOCITY)
        fixed = position is not None and position.status is not FixStatus.NONE
        (horizontal_m, vertical_m), (speed_m_s, _) = _sigmas(position), _sigmas(velocity)
        accuracies = vertical_m * 1e3, horizontal_m * 1e3, speed_m_s * 1e2
        satellites, dilution = (9 * fixed, 5 * fixed, 14 * fixed), (90.0, 150.0)
        epoch = self.receivers.gps_epochs & 0xFFFF
        detail = parts.GpsDetail(*dilution, 3.0 * fixed, *accuracies, *satellites, epoch)
        lon_deg, lat_deg, height_m = self.receivers.degrees(position)
        place = round(lon_deg * 1e7), round(lat_deg * 1e7), round(height_m * 1e3)
        when = _date_and_time(self.imu.stamp_ns, position)
        return parts.Gps(*when, *place, _ned_cm_s(velocity), detail)

    @property
    def position(self) -> parts.Position:
        """Return the fused position: the receiver's, with heights above the sea and the start."""
        best = self._recent(Source.RTK_POSITION, Source.GPS_POSITION)
        if best is None or best.status is FixStatus.NONE:  # its position may be anything
            return parts.Position(0.0, 0.0, 0.0, 0.0, 0)
        height_m = best.height_m - self.receivers.undulation_m
        above_m = self.receivers.above_start_m(height_m)
        return parts.Position(best.latitude_rad, best.longitude_rad, height_m, above_m, 5)

    @property
    def velocity(self) -> parts.Velocity:
        """Return the fused velocity: the receiver's, north, east, up (m/s)."""
        best = self._recent(Source.RTK_VELOCITY, Source.GPS_VELOCITY)
        if best is None:
            return parts.Velocity((0.0, 0.0, 0.0), 0)
        north, east, down = best.velocity_n.tolist()
        return parts.Velocity((north, east, -down), 1)


def _time(i: Instant) -> parts.Time:
    ms, rest_ns, ticks, _ = i.counters
    return parts.Time(ms, rest_ns, ticks, 0, 0)


def _hard_sync(i: Instant) -> parts.HardSync | None:
    if i.quaternion is None:
        return None
    ticks_here = i.since_ns // LONG_TICK_NS & _U32
    inertial = i.quaternion, _numbers(i.imu.specific_force_b / G_M_S2)
    return parts.HardSync(
        *i.counters[2:], ticks_here, 0, 0, *inertial, _numbers(i.imu.angular_rate_b)
    )


def _gps_fused(i: Instant) -> parts.GpsFused:
    place, detail = i.position, i.gps.detail
    satellites = detail.nsv if detail else 0
    return parts.GpsFused(place.lon_rad, place.lat_rad, place.altitude_m, satellites)


_Make = Callable[[Instant], Any]

#: Name in ``Broadcast``, usual rate (Hz), and the function that makes the part.
PARTS: dict[str, tuple[int, _Make]] = {
    "time": (400, _time),
    "quaternion_wxyz": (400, lambda i: i.quaternion),
    "acceleration_as_packed": (400, lambda i: _numbers(i.imu.specific_force_b / G_M_S2)),
    "velocity": (50, lambda i: i.velocity),
    "angular_rate_radps": (400, lambda i: _numbers(i.imu.angular_rate_b)),
    "position": (50, lambda i: i.position),
    "relative_position": (50, lambda _: _NOTHING_NEAR),
    "gps": (50, lambda i: i.gps),
    "rtk": (50, lambda i: i.rtk),
    "mag": (10, lambda _: (210, -480, 1310)),
    "rc": (50, lambda _: _RC),
    "gimbal": (50, lambda i: i.gimbal),
    "status": (50, lambda _: _STATUS),
    "battery": (10, lambda _: _BATTERY),
    "device": (10, lambda _: parts.Device(6, 0)),
}
TOPICS: dict[str, _Make] = {
    "QUATERNION": lambda i: i.quaternion,
    "ACCELERATION_GROUND": lambda i: i.over_ground(i.imu.specific_force_b, -1),
    "ACCELERATION_BODY": lambda i: _numbers(i.imu.specific_force_b * (1, 1, -1)),
    "ACCELERATION_RAW": lambda i: _numbers(i.imu.specific_force_b),
    "VELOCITY": lambda i: i.velocity,
    "ANGULAR_RATE_FUSIONED": lambda i: i.over_ground(i.imu.angular_rate_b, 1),
    "ANGULAR_RATE_RAW": lambda i: _numbers(i.imu.angular_rate_b),
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
    "GPS_CONTROL_LEVEL": lambda _: 5,
}
