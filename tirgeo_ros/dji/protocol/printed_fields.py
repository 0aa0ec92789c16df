"""Name the fields that ``tirgeo dump`` prints for a frame, raw values with SI values beside them.

A number that is 32 bits wide on the wire is given with the nine digits that distinguish it from
its neighbours (0.1, not 0.10000000149011612). What is computed from it uses the full value. NaN
and infinities stay as they are: the writer of JSON makes them null.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from tirgeo_ros.dji.protocol import broadcast_parts as parts
from tirgeo_ros.dji.protocol.broadcast import Broadcast, Layout
from tirgeo_ros.dji.protocol.subscription import Push

_STATUS_BITS = ("mounted", "busy", "pitch_limited", "roll_limited", "yaw_limited", "calibrating")
#: Fields that are 64 bits wide.
_DOUBLES = {"lat_rad", "lon_rad", "lat_deg", "lon_deg"}

_Convert = Callable[[Any], Any]
_Computed = tuple[str, str, _Convert]  # name, field that it is computed from, how


def _per(divisor: float) -> _Convert:
    return lambda value: value / divisor


def _bits(shift: int, mask: int = 1) -> _Convert:
    return lambda value: value >> shift & mask


def _m_s(vel_cmps: Sequence[float]) -> list[float]:
    return [x * 0.01 for x in vel_cmps]


def _computed(convert: _Convert, *names: tuple[str, str]) -> tuple[_Computed, ...]:
    return tuple((name, source, convert) for name, source in names)


def _angles(*names: str) -> tuple[str | _Computed, ...]:
    """Return the fields of three angles: degrees as packed, then radians."""
    radians = [(f"{name}_rad", f"{name}_deg") for name in names]
    return (*(f"{name}_deg" for name in names), *_computed(math.radians, *radians))


_TO_DEGREES = (("lat_deg", "lat_rad"), ("lon_deg", "lon_rad"))
_TO_RADIANS = (("lon_rad", "lon_deg"), ("lat_rad", "lat_deg"))

#: The fields of a type in their order; of a type that is not here, those of its definition.
_FIELDS: dict[type, tuple[str | _Computed, ...]] = {
    parts.Time: (
        *("time_ms", "time_ns"),
        ("time_s", "time_ms", _per(1000)),
        *("sync_time_2p5ms", "sync_tag", "sync_flag"),
    ),
    parts.Velocity: ("xyz_mps", ("health", "info", _bits(0))),
    parts.Position: (
        *("lat_rad", "lon_rad"),
        *_computed(math.degrees, *_TO_DEGREES),
        *("altitude_m", "height_m", "health"),
    ),
    parts.Gps: (
        *("date", "time", "lon_1e7", "lat_1e7", "hfsl_mm"),
        *_computed(_per(1e7), ("lon_deg", "lon_1e7"), ("lat_deg", "lat_1e7")),
        *_computed(
            lambda raw: math.radians(raw / 1e7), ("lon_rad", "lon_1e7"), ("lat_rad", "lat_1e7")
        ),
        ("hfsl_m", "hfsl_mm", _per(1000)),
        "vel_ned_cmps",
        ("vel_ned_mps", "vel_ned_cmps", _m_s),
        "detail",
    ),
    parts.GpsDetail: (
        *("hdop", "pdop", "fix", "vacc_mm", "hacc_mm", "sacc_cmps"),
        *_computed(_per(1000), ("vacc_m", "vacc_mm"), ("hacc_m", "hacc_mm")),
        ("sacc_mps", "sacc_cmps", _per(100)),
        *("used_gps", "used_glonass", "nsv", "counter"),
    ),
    parts.Rtk: (
        *("date", "time", "lon_deg", "lat_deg"),
        *_computed(math.radians, *_TO_RADIANS),
        *("hfsl_m", "vel_cmps"),
        ("vel_mps", "vel_cmps", _m_s),
        "yaw_deg",
        ("yaw_rad", "yaw_deg", math.radians),
        *("pos_flag", "yaw_flag"),
    ),
    parts.Gimbal: (
        *_angles("roll", "pitch", "yaw"),
        ("pitch_limit", "limits", _bits(0)),
        ("roll_limit", "limits", _bits(1)),
        ("yaw_limit", "limits", _bits(2)),
    ),
    parts.GimbalAngles: _angles("pitch", "roll", "yaw"),
    parts.Battery: (
        *parts.Battery._fields,
        ("voltage_v", "voltage_mv", _per(1000)),
        ("current_a", "current_ma", _per(1000)),
    ),
    parts.Device: (
        "control_mode",
        ("device_status", "bits", _bits(0, 7)),
        ("flight_status", "bits", _bits(3)),
        ("vrc_status", "bits", _bits(4)),
    ),
    parts.GpsFused: (
        *("lon_rad", "lat_rad"),
        *_computed(math.degrees, *reversed(_TO_DEGREES)),
        *("altitude_m", "satellites"),
    ),
    parts.GpsPosition: (
        *parts.GpsPosition._fields,
        ("order_packed", "x_raw", lambda _: "x=lon,y=lat"),
    ),
    parts.HardSync: (
        *("time2p5ms", "time1ns", "reset_time2p5ms"),
        ("index", "tag", int),
        *("flag", "q_wxyz", "accel_g", "gyro_radps"),
    ),
}

#: Topics whose meaning does not follow from their type.
_TOPICS: dict[str, _Convert] = {
    "GPS_VELOCITY": lambda v: {"cmps": _printed(v), "mps": _m_s(v)},
    "RTK_VELOCITY": lambda v: {"cmps": _printed(v), "mps": _m_s(v)},
    "RTK_YAW": lambda deg: {"deg": deg, "rad": math.radians(deg)},
    "GIMBAL_STATUS": lambda bits: (
        {"bits": bits} | {name: bits >> i & 1 for i, name in enumerate(_STATUS_BITS)}
    ),
    "HOME_POINT_INFO": list,  # 64 bits wide
}


def broadcast_fields(broadcast: Broadcast) -> dict[str, Any]:
    """Return the fields of a broadcast, a key for each part that is present."""
    present = zip(Broadcast._fields[1:], broadcast[1:], strict=True)
    fields = {name: _printed(part) for name, part in present if part is not None}
    if broadcast.velocity is not None and broadcast.layout is not Layout.MODERN:
        fields["velocity"]["sensor_id"] = broadcast.velocity.info >> 1 & 0xF
    return fields


def push_fields(push: Push) -> dict[str, Any]:
    """Return the fields of a push: the time of its sending, if it has one, and its topics."""
    fields: dict[str, Any] = {}
    if push.time_ms is not None:
        time_s = push.time_ms / 1000
        fields["timestamp"] = {"time_ms": push.time_ms, "time_ns": push.time_ns, "time_s": time_s}
    topics = push.values.items()
    return fields | {name: _TOPICS.get(name, _printed)(value) for name, value in topics}


def _printed(value: Any, name: str = "") -> Any:
    """Return a part as JSON holds it; fields that a layout lacks are left out."""
    if hasattr(value, "_fields"):
        fields = (_named(value, field) for field in _FIELDS.get(type(value), value._fields))
        return {name: printed for name, printed in fields if printed is not None}
    if isinstance(value, tuple):
        return [_printed(number) for number in value]
    is_single = isinstance(value, float) and name not in _DOUBLES
    return float(f"{value:.9g}") if is_single else value


def _named(part: Any, field: str | _Computed) -> tuple[str, Any]:
    if isinstance(field, str):
        return field, _printed(getattr(part, field), field)
    name, source, convert = field
    raw = getattr(part, source)
    return name, None if raw is None else convert(raw)
