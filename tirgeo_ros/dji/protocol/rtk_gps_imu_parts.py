"""Define the parts of a broadcast or a subscription push, in the aircraft's own units.

Every part is a plain number, a tuple or a named tuple whose fields are named as the aircraft packs
them: the unit is in the name, the order is that of the bytes. Axes are the aircraft's (FRD, NED,
or north-east-up where a part says so). A field that a layout lacks is None.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
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
    """Hold the velocity over ground: north, east, up (z is not NED's)."""

    xyz_mps: Vector
    info: int = 0  # bit 0: GPS is used; bits 1-4: the sensor, in old layouts alone


class Position(NamedTuple):
    """Hold the fused position; its altitude is barometric, not the ellipsoid's."""

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
    """Hold the battery's data; the old layouts have the percentage alone."""

    capacity_mah: int | None
    voltage_mv: int | None
    current_ma: int | None
    percentage: int


class Device(NamedTuple):
    """Hold who controls the aircraft."""

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
    """Convert between bytes and the parts (name, ``struct`` form, maker from its numbers).

    ``head`` is the form of the numbers before the parts, with the byte order.
    """

    def __init__(self, head: str, parts: Iterable[Sequence[Any]]) -> None:
        at = _numbers(head)
        self._parts: list[tuple[str, int, int, Make]] = []  # with first and last + 1 number
        for name, form, make in parts:
            head, start, at = head + form, at, at + _numbers(f"<{form}")
            self._parts.append((name, start, at, make))
        self._struct = struct.Struct(head)
        self._unpack = self._struct.unpack
        self.size = self._struct.size

    def unpack(self, value: bytes) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Return all numbers, those of the head first, and the parts by name."""
        numbers = self._unpack(value)
        return numbers, {
            name: make(numbers[start:stop]) for name, start, stop, make in self._parts
        }

    def pack(self, head: Sequence[int | None], values: Mapping[str, Any]) -> bytes:
        """Return the bytes. Raises struct.error for what does not fit."""
        parts = [number for name, *_ in self._parts for number in _flat(values.get(name))]
        return self._struct.pack(*head, *parts)


def _numbers(form: str) -> int:
    return len(struct.unpack(form, bytes(struct.calcsize(form))))


def _flat(part: Any) -> list[Any]:
    """Return the numbers of a part in the order of their bytes, without None."""
    if isinstance(part, tuple):
        return [number for item in part for number in _flat(item)]
    return [] if part is None else [part]
