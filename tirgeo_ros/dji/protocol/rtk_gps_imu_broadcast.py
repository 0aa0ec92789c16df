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
"""Decode and encode the broadcast push (set 02, id 00): RTK, GPS, IMU, gimbal and more.

A broadcast is a mask, followed by the parts of which the mask has a bit; pushes of the
subscription have such parts too. A part is a number, a tuple or a named tuple. The fields of named
tuples have the order of the bytes, and their names contain the units. Axes are the aircraft's
(FRD, NED, or north-east-up if a part says so). A field that a layout lacks is None.

There are two layouts. The frame does not contain its layout, but its length identifies it. For the
same mask, no length fits both unless the parts have the same bytes and the same meaning. So a
frame is decoded in the layout whose length fits, the newer first; if none fits, it is refused.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from functools import lru_cache
from typing import Any, NamedTuple

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w, x, y, z


class Time(NamedTuple):
    """Hold the aircraft's clock at the frame, since power-up, and the sync pulse's stamp."""

    time_ms: int
    time_ns: int
    sync_time_2p5ms: int | None = None  # None in the old layouts
    sync_tag: int | None = None  # None in the old layouts
    sync_flag: int = 0  # 1 at the pulse


class Velocity(NamedTuple):
    """Hold the velocity over ground: north, east, up (not NED)."""

    xyz_mps: Vector
    info: int = 0  # bit 0: GPS is used; bits 1-4: the sensor, only in old layouts


class Position(NamedTuple):
    """Hold the fused position; its altitude is barometric, not ellipsoidal."""

    lat_rad: float
    lon_rad: float
    altitude_m: float
    height_m: float
    health: int


class RelativePosition(NamedTuple):
    """Hold distances to obstacles, and bits of health in the same order."""

    down_m: float
    front_m: float
    right_m: float
    back_m: float
    left_m: float
    up_m: float
    health_bits: int


class GpsDetail(NamedTuple):
    """Hold details of the GPS receiver's solution."""

    hdop: float
    pdop: float
    fix: float  # 0 none, 1 dead reckoning, 2 2D, 3 3D, 4 GPS and DR, 5 time only
    vacc_mm: float
    hacc_mm: float
    sacc_cmps: float
    used_gps: int
    used_glonass: int
    nsv: int
    counter: int


class Gps(NamedTuple):
    """Hold the ordinary GPS's data; longitude comes first."""

    date: int  # yyyymmdd
    time: int  # hhmmss
    lon_1e7: int  # deg
    lat_1e7: int  # deg
    hfsl_mm: int  # height above mean sea level
    vel_ned_cmps: Vector
    detail: GpsDetail | None = None  # None in the old layouts


class Rtk(NamedTuple):
    """Hold the RTK receiver's data; longitude comes first."""

    date: int  # yyyymmdd
    time: int  # hhmmss
    lon_deg: float
    lat_deg: float
    hfsl_m: float  # height above mean sea level
    vel_cmps: Vector  # NED
    yaw_deg: int  # azimuth of the antennas' baseline
    pos_flag: int
    yaw_flag: int


class Rc(NamedTuple):
    """Hold the remote control's sticks and switches, +-10000."""

    roll: int
    pitch: int
    yaw: int
    throttle: int
    mode: int
    gear: int


class Gimbal(NamedTuple):
    """Hold the gimbal's angles as broadcast; the subscription has another order."""

    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    limits: int = 0  # bits: pitch, roll, yaw at the end of its axis


class Status(NamedTuple):
    """Hold the flight state (0 stopped, 1 on the ground, 2 in the air) and more in new layouts."""

    flight: int
    mode: int | None = None
    gear: int | None = None
    error: int | None = None


class Battery(NamedTuple):
    """Hold the battery's data; the old layouts have only the percentage."""

    capacity_mah: int | None
    voltage_mv: int | None
    current_ma: int | None
    percentage: int


class Device(NamedTuple):
    """Hold the device that controls the aircraft."""

    control_mode: int
    bits: int  # 0-2: 0 remote control, 1 app, 2 serial (4 on M300); 3: serial; 4: virtual RC


class GpsFused(NamedTuple):
    """Hold the fused position as subscribed; longitude first, altitude barometric."""

    lon_rad: float
    lat_rad: float
    altitude_m: float
    satellites: int


class GpsPosition(NamedTuple):
    """Hold the GPS position as subscribed: longitude and latitude in 1e-7 deg, mm MSL."""

    x_raw: int
    y_raw: int
    z_raw: int


class RtkPosition(NamedTuple):
    """Hold the RTK position as subscribed."""

    lon_deg: float
    lat_deg: float
    hfsl_m: float


class GimbalAngles(NamedTuple):
    """Hold the gimbal's angles as subscribed: pitch first."""

    pitch_deg: float
    roll_deg: float
    yaw_deg: float


class HardSync(NamedTuple):
    """Hold attitude (FRD to NED), specific force and rate (FRD) of one tick of 2.5 ms."""

    time2p5ms: int
    time1ns: int  # since that tick
    reset_time2p5ms: int  # ticks since the sync began
    tag: int  # number of the pulse
    flag: int  # 1 at the pulse
    q_wxyz: Quaternion
    accel_g: Vector
    gyro_radps: Vector


Make = Callable[[tuple[Any, ...]], Any]


class PackedFields:
    """Convert between bytes and parts.

    ``head`` is the ``struct`` form of the numbers before the parts, with the byte order. A part is
    given by its name, its form, and the function that makes it from its numbers.
    """

    def __init__(self, head: str, parts: Iterable[Sequence[Any]]) -> None:
        at = _numbers(head)
        self._parts: list[tuple[str, int, int, Make]] = []  # with its range of numbers
        for name, form, make in parts:
            head, start, at = head + form, at, at + _numbers(f"<{form}")
            self._parts.append((name, start, at, make))
        self._struct = struct.Struct(head)
        self._unpack = self._struct.unpack
        self.size = self._struct.size

    def unpack(self, value: bytes) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Return all numbers, the head's first, and the parts by name."""
        numbers = self._unpack(value)
        return numbers, {
            name: make(numbers[start:stop]) for name, start, stop, make in self._parts
        }

    def pack(self, head: Sequence[int | None], values: Mapping[str, Any]) -> bytes:
        """Return the bytes. Raises struct.error for values that do not fit."""
        parts = [number for name, *_ in self._parts for number in _flat(values.get(name))]
        return self._struct.pack(*head, *parts)


def _numbers(form: str) -> int:
    return len(struct.unpack(form, bytes(struct.calcsize(form))))


def _flat(part: Any) -> list[Any]:
    """Return the numbers of a part in the order of their bytes, without None."""
    if isinstance(part, tuple):
        return [number for item in part for number in _flat(item)]
    return [] if part is None else [part]


class Layout(Enum):
    """List the layouts, by the firmware that packs them."""

    MODERN = "a3_osdk33"  # A3, N3, M600 with a firmware of 2017 or later (3.2.41 and so on)
    LEGACY = "a3_osdk31"  # M600 with 3.2.15.62, A3 with 3.1


class Broadcast(NamedTuple):
    """Hold one broadcast in the aircraft's own units.

    An absent part is None. Axes: ``quaternion_wxyz`` turns body FRD into ground NED.
    ``acceleration_as_packed`` is in g or m/s2, in the axes that DJI Assistant is set to (raw: g,
    FRD).
    """

    layout: Layout = Layout.MODERN
    time: Time | None = None
    quaternion_wxyz: Quaternion | None = None
    acceleration_as_packed: Vector | None = None
    velocity: Velocity | None = None
    angular_rate_radps: Vector | None = None
    position: Position | None = None
    relative_position: RelativePosition | None = None  # shares the bit of ``position``
    gps: Gps | None = None
    rtk: Rtk | None = None
    mag: tuple[int, int, int] | None = None
    rc: Rc | None = None
    gimbal: Gimbal | None = None
    status: Status | None = None
    battery: Battery | None = None
    device: Device | None = None
    compass: int | None = None

    @property
    def mask(self) -> int:
        """Return the frame's mask: a bit for each part that is present."""
        bits = _LAYOUTS[self.layout]
        return sum({1 << bit for bit, name, *_ in bits if getattr(self, name) is not None})


def _gps(v: tuple[Any, ...]) -> Gps:
    return Gps._make([*v[:5], v[5:8], GpsDetail._make(v[8:]) if v[8:] else None])


_Part = tuple[int, str, str, Make]  # bit of the mask, name in Broadcast, form, function

_MOTION: tuple[_Part, ...] = (
    (1, "quaternion_wxyz", "4f", tuple),
    (2, "acceleration_as_packed", "3f", tuple),
    (3, "velocity", "3fB", lambda v: Velocity(v[:3], v[3])),
    (4, "angular_rate_radps", "3f", tuple),
    (5, "position", "2d2fB", Position._make),
)
_MIDDLE: tuple[_Part, ...] = (
    (7, "rtk", "2I2d4fh2B", lambda v: Rtk._make((*v[:5], v[5:8], *v[8:]))),
    (8, "mag", "3h", tuple),
    (9, "rc", "6h", Rc._make),
    (10, "gimbal", "3fB", Gimbal._make),
)
_DEVICE: _Part = (13, "device", "2B", Device._make)

#: The parts in the order of their bytes, with ``struct`` forms.
_LAYOUTS: dict[Layout, tuple[_Part, ...]] = {
    Layout.MODERN: (
        (0, "time", "3IHB", Time._make),
        *_MOTION,
        (5, "relative_position", "6fB", RelativePosition._make),
        (6, "gps", "2I3i3f6f2I2H", _gps),
        *_MIDDLE,
        (11, "status", "4B", Status._make),
        (12, "battery", "I2iB", Battery._make),
        _DEVICE,
        (14, "compass", "B", lambda v: v[0]),
    ),
    Layout.LEGACY: (
        (0, "time", "2IB", lambda v: Time(v[0], v[1], None, None, v[2])),
        *_MOTION,
        (6, "gps", "2I3i3f", _gps),
        *_MIDDLE,
        (11, "status", "B", lambda v: Status(v[0])),
        (12, "battery", "B", lambda v: Battery(None, None, None, v[0])),
        _DEVICE,
    ),
}


# Up to 2**16 masks are possible in each layout; an aircraft sends a few.
@lru_cache(maxsize=256)
def _packed(layout: Layout, mask: int) -> PackedFields | None:
    """Return how the parts are packed; None where the layout does not define a bit of the mask."""
    bits = _LAYOUTS[layout]
    if mask & ~sum({1 << bit for bit, *_ in bits}):
        return None
    return PackedFields("<H", [part for bit, *part in bits if mask >> bit & 1])


@lru_cache(maxsize=256)
def _fitting(mask: int, length: int) -> tuple[Layout, PackedFields] | None:
    for layout in Layout:
        packed = _packed(layout, mask)
        if packed and packed.size == length:
            return layout, packed
    return None


def broadcast_length(layout: Layout, mask: int) -> int | None:
    """Return the length of a broadcast's value, mask included; None if the layout lacks a bit."""
    packed = _packed(layout, mask)
    return None if packed is None else packed.size


def decode_broadcast(value: bytes) -> Broadcast | None:
    """Decode a broadcast's value (without set and id); None if no layout has its length."""
    fitting = _fitting(value[0] | value[1] << 8, len(value)) if len(value) > 1 else None
    if fitting is None:
        return None
    layout, packed = fitting
    return Broadcast(layout, **packed.unpack(value)[1])


def encode_broadcast(broadcast: Broadcast) -> bytes:
    """Encode a broadcast's value; the layout must define all of its parts."""
    packed = _packed(broadcast.layout, broadcast.mask)
    assert packed is not None  # ``mask`` contains only bits of the layout
    return packed.pack([broadcast.mask], broadcast._asdict())
