"""Name the fields that ``tirgeo dump`` prints for a frame, raw values with SI values beside them.

A number that is 32 bits wide on the wire is given with the nine digits that distinguish it from
its neighbours (0.1, not 0.10000000149011612). What is computed from it uses the full value. NaN
and infinities stay as they are: the writer of JSON makes them null.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from tirgeo_ros.dji.protocol.broadcast import Broadcast, Layout
from tirgeo_ros.dji.protocol.broadcast_parts import (
    Battery,
    Device,
    Gimbal,
    GimbalAngles,
    Gps,
    GpsDetail,
    GpsFused,
    GpsPosition,
    HardSync,
    Position,
    Rc,
    RelativePosition,
    Rtk,
    RtkPosition,
    Status,
    Time,
    Velocity,
)
from tirgeo_ros.dji.protocol.subscription import Push

_STATUS_BITS = ("mounted", "busy", "pitch_limited", "roll_limited", "yaw_limited", "calibrating")


def broadcast_fields(broadcast: Broadcast) -> dict[str, Any]:
    """Return the fields of a broadcast, a key for each part that is present."""
    parts = zip(Broadcast._fields[1:], broadcast[1:], strict=True)
    fields = {name: _field(part) for name, part in parts if part is not None}
    if broadcast.velocity is not None and broadcast.layout is not Layout.MODERN:
        fields["velocity"]["sensor_id"] = broadcast.velocity.sensor_id
    return fields


def push_fields(push: Push) -> dict[str, Any]:
    """Return the fields of a push: the time of its sending, if it has one, and its topics."""
    fields: dict[str, Any] = {}
    if push.time_ms is not None:
        fields["timestamp"] = {
            "time_ms": push.time_ms,
            "time_ns": push.time_ns,
            "time_s": push.time_ms / 1000,
        }
    for name, value in push.values.items():
        fields[name] = _TOPICS.get(name, _field)(value)
    return fields


def _single(number: float) -> float:
    return float(f"{number:.9g}")


def _vector(numbers: Sequence[float]) -> list[float]:
    return [_single(x) if isinstance(x, float) else x for x in numbers]


def _field(part: Any) -> Any:
    """Return a part's fields by its type; other numbers and vectors as they are."""
    made = _FIELDS.get(type(part))
    if made is not None:
        return made(part)
    if isinstance(part, tuple):
        return _vector(part)
    return _single(part) if isinstance(part, float) else part


def _time(time: Time) -> dict[str, Any]:
    fields: dict[str, Any] = {"time_ms": time.time_ms, "time_ns": time.time_ns}
    fields["time_s"] = time.time_ms / 1000
    rest = {"sync_time_2p5ms": time.sync_time_2p5ms, "sync_tag": time.sync_tag}
    return fields | _without_none(rest) | {"sync_flag": time.sync_flag}


def _velocity(velocity: Velocity) -> dict[str, Any]:
    return {"xyz_mps": _vector(velocity.xyz_mps), "health": velocity.health}


def _position(position: Position) -> dict[str, Any]:
    return {
        "lat_rad": position.lat_rad,
        "lon_rad": position.lon_rad,
        "lat_deg": math.degrees(position.lat_rad),
        "lon_deg": math.degrees(position.lon_rad),
        "altitude_m": _single(position.altitude_m),
        "height_m": _single(position.height_m),
        "health": position.health,
    }


def _named(part: Any) -> dict[str, Any]:
    """Return the fields under their names; those that the layout lacks are left out."""
    names = part._fields
    return _without_none(dict(zip(names, map(_field, part), strict=True)))


def _without_none(fields: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in fields.items() if value is not None}


def _gps(gps: Gps) -> dict[str, Any]:
    lon_deg, lat_deg = gps.lon_1e7 / 1e7, gps.lat_1e7 / 1e7
    fields = {
        "date": gps.date,
        "time": gps.time,
        "lon_1e7": gps.lon_1e7,
        "lat_1e7": gps.lat_1e7,
        "hfsl_mm": gps.hfsl_mm,
        "lon_deg": lon_deg,
        "lat_deg": lat_deg,
        "lon_rad": math.radians(lon_deg),
        "lat_rad": math.radians(lat_deg),
        "hfsl_m": gps.hfsl_mm / 1000,
        "vel_ned_cmps": _vector(gps.vel_ned_cmps),
        "vel_ned_mps": _metres(gps.vel_ned_cmps),
    }
    return fields if gps.detail is None else fields | {"detail": _gps_detail(gps.detail)}


def _metres(vel_cmps: Sequence[float]) -> list[float]:
    return [x * 0.01 for x in vel_cmps]


def _gps_detail(detail: GpsDetail) -> dict[str, Any]:
    return {
        "hdop": _single(detail.hdop),
        "pdop": _single(detail.pdop),
        "fix": _single(detail.fix),
        "vacc_mm": _single(detail.vacc_mm),
        "hacc_mm": _single(detail.hacc_mm),
        "sacc_cmps": _single(detail.sacc_cmps),
        "vacc_m": detail.vacc_mm / 1000,
        "hacc_m": detail.hacc_mm / 1000,
        "sacc_mps": detail.sacc_cmps / 100,
        "used_gps": detail.used_gps,
        "used_glonass": detail.used_glonass,
        "nsv": detail.nsv,
        "counter": detail.counter,
    }


def _rtk(rtk: Rtk) -> dict[str, Any]:
    return {
        "date": rtk.date,
        "time": rtk.time,
        "lon_deg": rtk.lon_deg,
        "lat_deg": rtk.lat_deg,
        "lon_rad": math.radians(rtk.lon_deg),
        "lat_rad": math.radians(rtk.lat_deg),
        "hfsl_m": _single(rtk.hfsl_m),
        "vel_cmps": _vector(rtk.vel_cmps),
        "vel_mps": _metres(rtk.vel_cmps),
        "yaw_deg": rtk.yaw_deg,
        "yaw_rad": math.radians(rtk.yaw_deg),
        "pos_flag": rtk.pos_flag,
        "yaw_flag": rtk.yaw_flag,
    }


def _angles(names: Sequence[str], angles_deg: Sequence[float]) -> dict[str, Any]:
    """Return the angles in degrees, then in radians."""
    pairs = list(zip(names, angles_deg, strict=True))
    degrees = {f"{name}_deg": _single(angle) for name, angle in pairs}
    return degrees | {f"{name}_rad": math.radians(angle) for name, angle in pairs}


def _gimbal(gimbal: Gimbal) -> dict[str, Any]:
    return {
        **_angles(("roll", "pitch", "yaw"), gimbal[:3]),
        "pitch_limit": gimbal.pitch_limit,
        "roll_limit": gimbal.roll_limit,
        "yaw_limit": gimbal.yaw_limit,
    }


def _gimbal_angles(angles: GimbalAngles) -> dict[str, Any]:
    return _angles(("pitch", "roll", "yaw"), angles)


def _battery(battery: Battery) -> dict[str, Any]:
    fields = _named(battery)
    if battery.voltage_mv is not None and battery.current_ma is not None:
        fields["voltage_v"] = battery.voltage_mv / 1000
        fields["current_a"] = battery.current_ma / 1000
    return fields


def _device(device: Device) -> dict[str, Any]:
    return {
        "control_mode": device.control_mode,
        "device_status": device.device_status,
        "flight_status": device.flight_status,
        "vrc_status": device.vrc_status,
    }


def _gps_fused(fused: GpsFused) -> dict[str, Any]:
    return {
        "lon_rad": fused.lon_rad,
        "lat_rad": fused.lat_rad,
        "lon_deg": math.degrees(fused.lon_rad),
        "lat_deg": math.degrees(fused.lat_rad),
        "altitude_m": _single(fused.altitude_m),
        "satellites": fused.satellites,
    }


def _gps_position(position: GpsPosition) -> dict[str, Any]:
    return {**position._asdict(), "order_packed": "x=lon,y=lat"}


def _rtk_position(position: RtkPosition) -> dict[str, Any]:
    return {**position._asdict(), "hfsl_m": _single(position.hfsl_m)}


def _hard_sync(sync: HardSync) -> dict[str, Any]:
    fields = {name: _field(value) for name, value in sync._asdict().items()}
    return {"index" if name == "tag" else name: value for name, value in fields.items()}


def _velocity_cmps(vel_cmps: Sequence[float]) -> dict[str, Any]:
    return {"cmps": _vector(vel_cmps), "mps": _metres(vel_cmps)}


def _rtk_yaw(yaw_deg: int) -> dict[str, Any]:
    return {"deg": yaw_deg, "rad": math.radians(yaw_deg)}


def _gimbal_status(bits: int) -> dict[str, Any]:
    return {"bits": bits} | {name: bits >> i & 1 for i, name in enumerate(_STATUS_BITS)}


_FIELDS: dict[type, Callable[[Any], Any]] = {
    Time: _time,
    Velocity: _velocity,
    Position: _position,
    RelativePosition: _named,
    Gps: _gps,
    GpsDetail: _gps_detail,
    Rtk: _rtk,
    Rc: _named,
    Gimbal: _gimbal,
    Status: _named,
    Battery: _battery,
    Device: _device,
    GpsFused: _gps_fused,
    GpsPosition: _gps_position,
    RtkPosition: _rtk_position,
    GimbalAngles: _gimbal_angles,
    HardSync: _hard_sync,
}

# Topics whose meaning does not follow from their type.
_TOPICS: dict[str, Callable[[Any], Any]] = {
    "GPS_VELOCITY": _velocity_cmps,
    "RTK_VELOCITY": _velocity_cmps,
    "RTK_YAW": _rtk_yaw,
    "GIMBAL_STATUS": _gimbal_status,
    "HOME_POINT_INFO": list,  # 64 bits wide
}
