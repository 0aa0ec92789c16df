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
"""Convert bytes of the serial link to readings; the port itself is not needed."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Any, NamedTuple

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.dji.clocks.aircraft_clock import LONG_TICK_NS, AircraftClock
from tirgeo_ros.dji.clocks.steady_stamps import SteadyStamps
from tirgeo_ros.dji.link.framing import PLAIN, FrameReader, ProtocolFrame, parse_key
from tirgeo_ros.dji.protocol import rtk_gps_imu_broadcast as parts
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import decode_broadcast
from tirgeo_ros.dji.protocol.subscription import PackageTable, decode_push
from tirgeo_ros.dji.sources.readings import (
    AccelerationUnit,
    AttitudeReading,
    GeodeticPlace,
    GimbalReading,
    GpsReading,
    ImuOrigin,
    ImuReading,
    Reading,
    RtkReading,
    Vector,
)

if TYPE_CHECKING:  # a live link does not need it, nor what it imports
    from tirgeo_ros.dji.clocks.capture_clock import CaptureClock

PUSH_SET, _BROADCAST, _SUBSCRIPTION = 0x02, 0x00, 0x05
_RTK_TOPICS = {"RTK_POSITION", "RTK_VELOCITY", "RTK_YAW", "RTK_POSITION_INFO", "RTK_YAW_INFO"}
_GPS_TOPICS = {"GPS_POSITION", "GPS_VELOCITY", "GPS_DETAILS"}
_RAW_DEG = math.radians(1e-7)

#: Longer than a frame can pause on its way (1023 bytes at 230400 baud take 44 ms).
_PAUSE_S = 0.05
_BITS_A_BYTE = 10  # with start bit and stop bit


class Clocks(NamedTuple):
    """Hold a clock for each counter of the aircraft; counters may start and step separately."""

    broadcast: AircraftClock | CaptureClock  # ms
    subscription: AircraftClock | CaptureClock  # ms
    hard_sync: AircraftClock | CaptureClock  # ticks of 2.5 ms; a sync command resets it


class Telemetry:
    """Convert frames to readings; count the unreadable ones.

    Counted: ``broadcast``, ``subscription``, ``other`` frames; ``unknown_layout``: broadcasts
    whose length fits no layout; ``unknown_package``: pushes of an unknown package, or with another
    length than their package; ``untimed``: broadcasts without the aircraft's time, stamped at
    arrival; ``axes_swapped``: GPS_POSITION with the latitude first.
    """

    def __init__(self, clocks: Clocks, packages: PackageTable) -> None:
        self._clocks = clocks
        self._packages = packages
        self._steady: dict[int, SteadyStamps] = {}  # of packages without a time, by id
        # the aircraft's latitude and longitude (rad), from fields whose order is certain
        self._near: tuple[float, float] | None = None
        self.counts: Counter[str] = Counter()

    def read(self, frame: ProtocolFrame, arrival_ns: int) -> list[Reading]:
        """Return the readings of a frame received at ``arrival_ns``, in the order of use."""
        if frame.cmd_set == PUSH_SET and frame.cmd_id == _BROADCAST:
            return self._read_broadcast(frame.value, arrival_ns)
        if frame.cmd_set == PUSH_SET and frame.cmd_id == _SUBSCRIPTION:
            return self._read_push(frame.value, arrival_ns)
        self.counts["other"] += 1
        return []

    def _read_broadcast(self, value: bytes, arrival_ns: int) -> list[Reading]:
        broadcast = decode_broadcast(value)
        if broadcast is None:
            self.counts["unknown_layout"] += 1
            return []
        self.counts["broadcast"] += 1
        stamp_ns = arrival_ns
        if broadcast.time is not None:
            stamp_ns = self._clocks.broadcast.stamp_ns(broadcast.time.time_ms, arrival_ns)
        elif broadcast.mask:
            self.counts["untimed"] += 1
        origin, unit = ImuOrigin.BROADCAST, AccelerationUnit.UNKNOWN
        acceleration, rate = broadcast.acceleration_as_packed, broadcast.angular_rate_radps
        readings = _inertial(stamp_ns, origin, unit, acceleration, rate, broadcast.quaternion_wxyz)
        if broadcast.position is not None:
            self._near = broadcast.position.lat_rad, broadcast.position.lon_rad
        if broadcast.gps is not None:
            readings.append(_gps(stamp_ns, broadcast.gps))
        if broadcast.rtk is not None:
            readings.append(_rtk(stamp_ns, broadcast.rtk))
        return readings + _gimbal(stamp_ns, broadcast.gimbal)

    def _read_push(self, value: bytes, arrival_ns: int) -> list[Reading]:
        push = decode_push(value, self._packages)
        if push is None:
            self.counts["unknown_package"] += 1
            return []
        self.counts["subscription"] += 1
        if push.time_ms is None:
            steady = self._steady.setdefault(push.package.id, SteadyStamps())
            stamp_ns = steady.stamp_ns(arrival_ns)
        else:
            stamp_ns = self._clocks.subscription.stamp_ns(push.time_ms, arrival_ns)
        values = push.values
        readings: list[Reading] = []
        tick: parts.HardSync | None = values.get("HARD_SYNC")
        if tick is not None:  # not by the push's own time, which is truncated to milliseconds
            tick_ns = self._clocks.hard_sync.stamp_ns(tick.time2p5ms, arrival_ns, tick.time1ns)
            inertial = tick.accel_g, tick.gyro_radps, tick.q_wxyz
            readings += _inertial(tick_ns, ImuOrigin.HARD_SYNC, AccelerationUnit.G, *inertial)
        raw = map(values.get, ("ACCELERATION_RAW", "ANGULAR_RATE_RAW", "QUATERNION"))
        readings += _inertial(stamp_ns, ImuOrigin.SUBSCRIPTION, AccelerationUnit.M_S2, *raw)
        if (fused := values.get("GPS_FUSED")) is not None:
            self._near = fused.lat_rad, fused.lon_rad
        readings += self._satellites(stamp_ns, values)
        return readings + _gimbal(stamp_ns, values.get("GIMBAL_ANGLES"))

    def _satellites(self, stamp_ns: int, values: dict[str, Any]) -> list[Reading]:
        readings: list[Reading] = []
        if not _RTK_TOPICS.isdisjoint(values):
            position = values.get("RTK_POSITION")
            if position is not None:
                position = _place_deg(position.lat_deg, position.lon_deg, position.hfsl_m)
                self._near = position[:2]
            flag, yaw_flag = values.get("RTK_POSITION_INFO"), values.get("RTK_YAW_INFO")
            velocity, yaw = _metres(values.get("RTK_VELOCITY")), values.get("RTK_YAW")
            readings.append(RtkReading(stamp_ns, position, flag, velocity, yaw, yaw_flag))
        if not _GPS_TOPICS.isdisjoint(values):
            position = values.get("GPS_POSITION")
            place = None if position is None else self._gps_place(position)
            velocity = _metres(values.get("GPS_VELOCITY"))
            quality = _quality(values.get("GPS_DETAILS"))
            readings.append(GpsReading(stamp_ns, place, velocity, *quality))
        return readings

    def _gps_place(self, raw: parts.GpsPosition) -> GeodeticPlace:
        """Convert GPS_POSITION, longitude first unless other positions show the reverse order.

        DJI's documents disagree on the order.
        """
        lon, lat = raw.x_raw * _RAW_DEG, raw.y_raw * _RAW_DEG
        if self._near is None:
            is_swapped = abs(lat) > math.pi / 2 >= abs(lon)
        else:
            near_lat, near_lon = self._near
            as_given = abs(lat - near_lat) + abs(lon - near_lon)
            is_swapped = abs(lon - near_lat) + abs(lat - near_lon) < as_given
        if is_swapped:
            self.counts["axes_swapped"] += 1
            lat, lon = lon, lat
        return GeodeticPlace(lat, lon, raw.z_raw * 1e-3)


def _inertial(
    stamp_ns: int, origin: ImuOrigin, unit: AccelerationUnit, acceleration: Any, rate: Any, q: Any
) -> list[Reading]:
    """Return one reading of acceleration, rate and attitude, or of the attitude alone."""
    if acceleration is not None and rate is not None:
        return [ImuReading(stamp_ns, origin, acceleration, unit, rate, q)]
    return [] if q is None else [AttitudeReading(stamp_ns, q)]


def _gimbal(stamp_ns: int, angles: parts.Gimbal | parts.GimbalAngles | None) -> list[Reading]:
    if angles is None:
        return []
    degrees = angles.roll_deg, angles.pitch_deg, angles.yaw_deg
    return [GimbalReading(stamp_ns, *map(math.radians, degrees))]


def _gps(stamp_ns: int, gps: parts.Gps) -> GpsReading:
    place = GeodeticPlace(gps.lat_1e7 * _RAW_DEG, gps.lon_1e7 * _RAW_DEG, gps.hfsl_mm * 1e-3)
    return GpsReading(stamp_ns, place, _metres(gps.vel_ned_cmps), *_quality(gps.detail))


def _quality(detail: parts.GpsDetail | None) -> tuple[Any, Any, Any, Any]:
    """Return fix, and sigmas in m, m and m/s; None if they are not stated."""
    if detail is None:
        return None, None, None, None
    fix = int(detail.fix) if math.isfinite(detail.fix) else 0
    return fix, detail.hacc_mm * 1e-3, detail.vacc_mm * 1e-3, detail.sacc_cmps * 1e-2


def _rtk(stamp_ns: int, rtk: parts.Rtk) -> RtkReading:
    place = _place_deg(rtk.lat_deg, rtk.lon_deg, rtk.hfsl_m)
    velocity = _metres(rtk.vel_cmps)
    return RtkReading(stamp_ns, place, rtk.pos_flag, velocity, rtk.yaw_deg, rtk.yaw_flag)


def _place_deg(latitude_deg: float, longitude_deg: float, height_msl_m: float) -> GeodeticPlace:
    return GeodeticPlace(math.radians(latitude_deg), math.radians(longitude_deg), height_msl_m)


def _metres(cm_s: Vector | None) -> Vector | None:
    return None if cm_s is None else (cm_s[0] * 1e-2, cm_s[1] * 1e-2, cm_s[2] * 1e-2)


class SerialDecoder:
    """Convert the link's bytes to readings."""

    def __init__(self, config: DjiConfig, packages: PackageTable) -> None:
        """Build the parsers; raise DjiError for an invalid key."""
        self.frames = FrameReader(parse_key(config.key))
        self._clocks = {
            "broadcast": AircraftClock(config.clock),
            "subscription": AircraftClock(config.clock),
            "hard sync": AircraftClock(config.clock, LONG_TICK_NS),
        }
        self._telemetry = Telemetry(Clocks(*self._clocks.values()), packages)
        self._received_s: float | None = None
        self.locked = 0  # encrypted frames that were not decrypted, or with a wrong key
        self._byte_ns = round(_BITS_A_BYTE * 1e9 / config.baud)

    def take(
        self, data: bytes, arrival_ns: int, now_s: float, gathered_ns: int = 0
    ) -> list[Reading]:
        """Return the readings of these bytes, which were read at ``arrival_ns``.

        ``now_s`` is the time of a monotonic clock. The first byte arrived ``gathered_ns`` earlier,
        and the others not faster than the line's rate: so each frame gets its own arrival time.

        Call this without bytes as well, now and then: after a pause it stops waiting for the rest
        of a cut frame.
        """
        if not data:
            is_pause = self._received_s is not None and now_s - self._received_s > _PAUSE_S
            return self.rescan(arrival_ns) if is_pause else []
        self._received_s = now_s
        first_ns = arrival_ns - gathered_ns - self.frames.counts["bytes"] * self._byte_ns
        frames = self.frames.feed(data)
        ends = [first_ns + (f.offset + f.length) * self._byte_ns for f in frames]
        return self._read(frames, [min(end_ns, arrival_ns) for end_ns in ends])

    def rescan(self, arrival_ns: int) -> list[Reading]:
        """Drop a frame that was cut, as the port was lost; return the readings after it."""
        self._received_s = None
        frames = self.frames.rescan()
        return self._read(frames, [arrival_ns] * len(frames))

    def _read(self, frames: list[ProtocolFrame], arrivals: list[int]) -> list[Reading]:
        readings = []
        for frame, arrival_ns in zip(frames, arrivals, strict=True):
            # An aircraft sends only acks and pushes: data with another command set was decrypted
            # with a wrong key.
            is_command = frame.encryption != PLAIN and not frame.is_ack
            self.locked += frame.is_encrypted or (is_command and frame.cmd_set != PUSH_SET)
            readings += self._telemetry.read(frame, arrival_ns)
        return readings

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return the counts of frames and the state of each clock."""
        items = {f"frames {name}": str(n) for name, n in self.frames.counts.items()}
        items |= {f"telemetry {name}": str(n) for name, n in self._telemetry.counts.items()}
        for name, clock in self._clocks.items():
            items |= {f"{name} {key}": value for key, value in clock.diagnostics.items()}
        return items
