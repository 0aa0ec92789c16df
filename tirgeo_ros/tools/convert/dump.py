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
"""Decode a capture of the serial link frame by frame into plain values for JSON."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame, parse_key
from tirgeo_ros.dji.protocol import rtk_gps_imu_broadcast as parts
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import Broadcast, Layout, decode_broadcast
from tirgeo_ros.dji.protocol.subscription import PackageTable, Push, decode_push, package_table
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_file import load_yaml
from tirgeo_ros.tools.presentation.progress import Report, silent

_STATUS_BITS = ("mounted", "busy", "pitch_limited", "roll_limited", "yaw_limited", "calibrating")
#: Fields that are 64 bits wide.
_DOUBLES = {"lat_rad", "lon_rad", "lat_deg", "lon_deg"}
_Convert = Callable[[Any], Any]
Record = dict[str, Any]
#: The fields of a type that are printed, in order; a type that is not here prints all its fields.
#: ``time_s<time_ms``: computed from field time_ms, by the units; ``health<info:0``: bit 0 of field
#: info; ``device_status<bits:0:3``: three bits from bit 0.
_FIELDS: dict[type, str] = {
    parts.Time: "time_ms time_ns time_s<time_ms sync_time_2p5ms sync_tag sync_flag",
    parts.Velocity: "xyz_mps health<info:0",
    parts.Position: "lat_rad lon_rad lat_deg<lat_rad lon_deg<lon_rad altitude_m height_m health",
    parts.Gps: """date time lon_1e7 lat_1e7 hfsl_mm lon_deg<lon_1e7 lat_deg<lat_1e7 lon_rad<lon_1e7
        lat_rad<lat_1e7 hfsl_m<hfsl_mm vel_ned_cmps vel_ned_mps<vel_ned_cmps detail""",
    parts.GpsDetail: """hdop pdop fix vacc_mm hacc_mm sacc_cmps vacc_m<vacc_mm hacc_m<hacc_mm
        sacc_mps<sacc_cmps used_gps used_glonass nsv counter""",
    parts.Rtk: """date time lon_deg lat_deg lon_rad<lon_deg lat_rad<lat_deg hfsl_m vel_cmps
        vel_mps<vel_cmps yaw_deg yaw_rad<yaw_deg pos_flag yaw_flag""",
    parts.Gimbal: """roll_deg pitch_deg yaw_deg roll_rad<roll_deg pitch_rad<pitch_deg
        yaw_rad<yaw_deg pitch_limit<limits:0 roll_limit<limits:1 yaw_limit<limits:2""",
    parts.GimbalAngles: """pitch_deg roll_deg yaw_deg pitch_rad<pitch_deg roll_rad<roll_deg
        yaw_rad<yaw_deg""",
    parts.Battery: """capacity_mah voltage_mv current_ma percentage voltage_v<voltage_mv
        current_a<current_ma""",
    parts.Device: "control_mode device_status<bits:0:3 flight_status<bits:3 vrc_status<bits:4",
    parts.GpsFused: "lon_rad lat_rad lon_deg<lon_rad lat_deg<lat_rad altitude_m satellites",
    parts.GpsPosition: "x_raw y_raw z_raw order_packed<x_raw",
    parts.HardSync: """time2p5ms time1ns reset_time2p5ms index<tag flag q_wxyz accel_g
        gyro_radps""",
}
#: Conversions of topics whose meaning does not follow from their type.
_TOPICS: dict[str, _Convert] = {
    "GPS_VELOCITY": lambda v: {"cmps": _printed(v), "mps": _m_s(v)},
    "RTK_VELOCITY": lambda v: {"cmps": _printed(v), "mps": _m_s(v)},
    "RTK_YAW": lambda deg: {"deg": deg, "rad": math.radians(deg)},
    "GIMBAL_STATUS": lambda bits: (
        {"bits": bits} | {name: bits >> i & 1 for i, name in enumerate(_STATUS_BITS)}
    ),
    "HOME_POINT_INFO": list,  # 64 bits wide
}


def _m_s(cm_s: Any) -> Any:
    return [x * 0.01 for x in cm_s] if isinstance(cm_s, tuple) else cm_s / 100


#: Conversions by units: the last words of the names of source and result.
_UNITS: dict[tuple[str, str], _Convert] = {
    **dict.fromkeys(
        (("ms", "s"), ("mm", "m"), ("mv", "v"), ("ma", "a")), lambda value: value / 1000
    ),
    ("cmps", "mps"): _m_s,
    ("rad", "deg"): math.degrees,
    ("deg", "rad"): math.radians,
    ("1e7", "deg"): lambda raw: raw / 1e7,
    ("1e7", "rad"): lambda raw: math.radians(raw / 1e7),
    ("tag", "index"): int,
    ("raw", "packed"): lambda _: "x=lon,y=lat",
}


def _field(spec: str) -> tuple[str, str, _Convert | None]:
    """Return a field's name, its source field, and the conversion (None: unchanged)."""
    name, _, source = spec.partition("<")
    source, *bits = source.split(":")
    if bits:
        shift, width = int(bits[0]), int(bits[1]) if bits[1:] else 1
        return name, source, lambda value: value >> shift & (1 << width) - 1
    if not source:
        return name, name, None
    return name, source, _UNITS[source.rpartition("_")[2], name.rpartition("_")[2]]


_PRINTED = {kind: [*map(_field, text.split())] for kind, text in _FIELDS.items()}


def push_fields(push: Push) -> dict[str, Any]:
    """Return the fields of a push: the time when it was sent, if it has one, and its topics."""
    fields: dict[str, Any] = {}
    if push.time_ms is not None:
        time_s = push.time_ms / 1000
        fields["timestamp"] = {"time_ms": push.time_ms, "time_ns": push.time_ns, "time_s": time_s}
    topics = push.values.items()
    return fields | {name: _TOPICS.get(name, _printed)(value) for name, value in topics}


def _printed(value: Any, name: str = "") -> Any:
    """Return a part of a message as values for JSON, without fields that its layout lacks."""
    if hasattr(value, "_fields"):
        fields = {}
        for field, source, convert in _PRINTED.get(type(value)) or map(_field, value._fields):
            raw = getattr(value, source)
            if raw is not None:
                fields[field] = convert(raw) if convert else _printed(raw, field)
        return fields
    if isinstance(value, tuple):
        return [_printed(number) for number in value]
    is_single = isinstance(value, float) and name not in _DOUBLES
    return float(f"{value:.9g}") if is_single else value


def packages_of(file: PathLike | None) -> PackageTable:
    """Return the packages of a YAML file, else the default ones. Raise DjiError, ConfigError."""
    return package_table(load_yaml(file), str(file)) if file else PackageTable()


def frames_in(
    path: Path, reader: FrameReader, progress: Report = silent
) -> Iterator[ProtocolFrame]:
    """Yield the frames of a capture; ``reader`` counts them."""
    total = path.stat().st_size
    with path.open("rb") as file:
        while chunk := file.read(1 << 16):
            yield from reader.feed(chunk)
            progress(file.tell() * 1e-6, total * 1e-6)
    yield from reader.rescan()


class CaptureDump:
    """Read a capture of any size; ``records`` yields its frames in order.

    ``packages`` is a YAML file as ``dji.protocol.package_table`` reads it, which replaces the
    default packages; ``key`` is 64 hexadecimal digits, for encrypted frames. ``unreadable`` counts
    broadcasts that fit no layout and pushes that fit no package. Raises DjiError for an invalid
    key or table of packages, ConfigError for a file of packages that cannot be read.
    """

    def __init__(self, path: Path, packages: PathLike | None = None, key: str = "") -> None:
        self._path = path
        self._packages = packages_of(packages)
        self._reader = FrameReader(parse_key(key))
        self.kinds: Counter[str] = Counter()
        self.unreadable = 0

    @property
    def counts(self) -> dict[str, int]:
        """Return the counts of ``FrameReader`` and ``unreadable``."""
        return self._reader.counts | {"unreadable": self.unreadable}

    def records(self) -> Iterator[Record]:
        """Yield a record for each frame. Raise DjiError without frames, OSError if unreadable."""
        yield from map(self._record, frames_in(self._path, self._reader))
        counts = self._reader.counts
        if not counts["bytes"]:
            raise DjiError(f"{self._path}: the file is empty")
        if not counts["frames"]:
            raise DjiError(
                f"{self._path}: no frame in {counts['bytes']} bytes: give a recording of an "
                "aircraft's serial port, made at the right baud rate"
            )

    def _record(self, frame: ProtocolFrame) -> Record:
        contents = self._contents(frame)
        index = self.kinds.total()
        self.kinds[contents["kind"]] += 1
        return {
            "i": index,
            "offset": frame.offset,
            "length": frame.length,
            "cmd_set": frame.cmd_set,
            "cmd_id": frame.cmd_id,
            "seq": frame.sequence,
            "session": frame.session,
            "ack": int(frame.is_ack),
            "enc": frame.encryption,
            **contents,
        }

    def _contents(self, frame: ProtocolFrame) -> Record:
        """Return a frame's kind and its decoded contents."""
        if frame.is_encrypted:
            return {"kind": "encrypted", "fields": {}}
        match frame.cmd_set, frame.cmd_id:
            case 0x02, 0x00:
                return {"kind": "broadcast", **self._broadcast(frame.value)}
            case 0x02, 0x05:
                return {"kind": "subscription", **self._push(frame.value)}
        fields = {"hex": frame.value.hex()} if frame.value else {}
        return {"kind": "ack" if frame.is_ack else "unknown", "fields": fields}

    def _broadcast(self, value: bytes) -> Record:
        broadcast = decode_broadcast(value)
        if broadcast is None:
            self.unreadable += 1
            mask = int.from_bytes(value[:2], "little") if len(value) >= 2 else None
            return {"layout": None, "mask": mask, "fields": {}}
        present = zip(Broadcast._fields[1:], broadcast[1:], strict=True)
        fields = {name: _printed(part) for name, part in present if part is not None}
        if broadcast.velocity is not None and broadcast.layout is not Layout.MODERN:
            fields["velocity"]["sensor_id"] = broadcast.velocity.info >> 1 & 0xF
        return {"layout": broadcast.layout.value, "mask": broadcast.mask, "fields": fields}

    def _push(self, value: bytes) -> Record:
        push = decode_push(value, self._packages)
        if push is None:
            self.unreadable += 1
            unknown: Record = {"freq_hz": None, "with_timestamp": None, "topics": [], "fields": {}}
            return {"pkg_id": value[0] if value else None, **unknown}
        package = push.package
        return {
            "pkg_id": package.id,
            "freq_hz": package.rate_hz,
            "with_timestamp": package.with_timestamp,
            "topics": [{"name": t.name, "uid": f"0x{t.uid:08x}"} for t in package.topics],
            "fields": push_fields(push),
        }
