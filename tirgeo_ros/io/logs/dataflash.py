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
"""Read ArduPilot's logs (DataFlash) through pymavlink: IMU, attitude, receiver, barometer.

A log is binary, or a text file that a ground station converted it to.
Axes are body FRD with ``AHRS_ORIENTATION`` applied, angles in degrees, heights above mean sea
level. Older logs have the names IMU2 and GPS2 where newer ones number instances in a column ``I``.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from mmap import mmap
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.io.files.whole_files import first_bytes
from tirgeo_ros.io.logs.autopilot_tables import (
    LEAST_FIX,
    GnssTable,
    ImuTable,
    Records,
    add_samples,
    count_records,
    parsing,
    receiver_notes,
)
from tirgeo_ros.io.logs.log_contents import MSL, LogContents, LogOptions, utc_ns_of_week

#: First bytes of a log: a format message (FMT, 0x80), which describes a message, mostly itself.
_BINARY, _TEXT = b"\xa3\x95\x80", b"FMT,"
_FORMAT_BYTES = 89
#: Message -> the fields that are read; NaN where a log lacks one.
_FIELDS = {
    "IMU": ("TimeUS", "I", "AccX", "AccY", "AccZ", "GyrX", "GyrY", "GyrZ"),
    "ATT": ("TimeUS", "Roll", "Pitch", "Yaw"),
    "GPS": (
        *("TimeUS", "I", "Status", "GMS", "GWk", "Lat", "Lng", "Alt"),
        *("Spd", "GCrs", "VZ", "Yaw", "U"),
    ),
    "GPA": ("TimeUS", "I", "HAcc", "VAcc", "SAcc", "YAcc", "VV"),
    "BARO": ("TimeUS", "I", "Press"),
    "MNT": ("TimeUS",),
}
_PARAMETER = "PARM"


def is_dataflash(head: bytes) -> bool:
    """Return whether a file that begins so is a DataFlash log, binary or as text."""
    return head.startswith((_BINARY, _TEXT))


@dataclass
class _Log:
    """Hold the data of a log: fields by message, parameters, whether all could be read.

    A log that ends within a record is ``cut``, not ``damaged``: each power cut ends a log so.
    """

    fields: dict[str, dict[str, array[float]]]
    parameters: dict[str, float]
    damaged: bool = False
    cut: bool = False


@np.errstate(invalid="ignore", over="ignore")  # samples are judged afterwards
def read_dataflash(path: Path, options: LogOptions) -> LogContents:
    """Read a log, as far as it is whole.

    Of several IMUs the first is used, of receivers the one that the autopilot used. Raise LogError
    if it is not such a log, has no IMU, or has positions while the geoid's undulation is not
    given.
    """
    log = _read_log(path)
    contents = LogContents(damaged=log.damaged)
    used = _used_receiver(log.fields["GPS"])
    imu, attitude, air = (_records(log, name) for name in ("IMU", "ATT", "BARO"))
    receiver, accuracy = (_records(log, name, used) for name in ("GPS", "GPA"))
    if imu.others and not len(imu):
        raise LogError(
            f"{path}: its IMU has no TimeUS: logs with TimeMS, of ArduPilot before 3.3 (2015), "
            "are not supported"
        )
    if not len(imu):
        raise LogError(f"{path}: no IMU in this log: enable it in the parameter LOG_BITMASK")
    if log.cut:
        contents.refused["record", "cut off at the end of the log"] += 1
    count_records(contents, (imu, attitude, receiver, air))
    gnss = _gnss(path, receiver, accuracy, options) if len(receiver) else None
    pressures = air.time_us, air.column("Press")
    rates_b = imu.columns("GyrX", "GyrY", "GyrZ")
    inertial = ImuTable(imu.time_us, imu.columns("AccX", "AccY", "AccZ"), rates_b)
    q_nb = quat_from_euler(*np.radians(attitude.columns("Roll", "Pitch", "Yaw")).T)
    attitudes = (attitude.time_us, q_nb) if len(attitude) else None
    add_samples(contents, inertial, attitudes, gnss, pressures)
    contents.notes += _notes(log, used)
    return contents


def _read_log(path: Path) -> _Log:
    from pymavlink.DFReader import (  # noqa: PLC0415  an extra, for these logs
        DFReader_binary,
        DFReader_text,
    )

    class Reader(DFReader_binary):  # type: ignore[misc]  # pymavlink has no types
        data_map: mmap

        def init_arrays_fast(self, progress_callback: Any = None) -> None:
            """Index in Python: the faster way in C prints despite the redirection."""
            parts = _whole_records(self.data_map)
            if len(parts) > 1:
                log.damaged, self.data_len = True, sum(map(len, parts))
                self.data_map.close()
                self.data_map = mmap(-1, self.data_len)
                self.data_map.write(b"".join(parts))
            self.init_arrays(progress_callback)
            lasts = ((self.formats.get(k), at[-1]) for k, at in enumerate(self.offsets) if at)
            ends = (at + form.len for form, at in lasts if form)
            log.cut = max(ends, default=0) > self.data_len

    log = _Log({name: {key: array("d") for key in names} for name, names in _FIELDS.items()}, {})
    is_text = first_bytes(path, len(_TEXT), LogError) == _TEXT
    form = DFReader_text if is_text else Reader
    with parsing(path, "DataFlash log") as output, form(str(path)) as file:
        while message := file.recv_match(type={*_FIELDS, _PARAMETER}, strict=True):
            _take(log, message)
    # pymavlink prints each place that it cannot read.
    log.damaged = log.damaged or bool(output.getvalue())
    return log


def _whole_records(data: mmap) -> list[bytes]:
    """Return the parts of a log in which another record, or nothing, follows each record.

    So a damaged byte costs one record or two; pymavlink would stop at an unknown number.
    """
    head, number, lengths = _BINARY[:2], _BINARY[2], {_BINARY[2]: _FORMAT_BYTES}
    parts, start, at = list[bytes](), 0, 0
    while at + 5 <= len(data):
        end = at + lengths.get(data[at + 2], 0)
        if end > at and data[at : at + 2] == head and data.find(head, end) in {end, -1}:
            if data[at + 2] == number:
                lengths[data[at + 3]] = data[at + 4]
            at = end
            continue
        after = data.find(head, at + 1)
        if after < 0:  # only the filling of the last block is left
            break
        parts.append(data[start:at])
        start = at = after
    return [*parts, data[start:]]


def _take(log: _Log, message: Any) -> None:
    try:
        if message.get_type() == _PARAMETER:
            log.parameters[str(message.Name)] = float(message.Value)
        else:
            fields = log.fields[message.get_type()]
            row = [float(getattr(message, name, math.nan)) for name in fields]
            for values, value in zip(fields.values(), row, strict=True):
                values.append(value)
    except (TypeError, ValueError, AttributeError):
        log.damaged = True


def _instances(fields: Mapping[str, array[float]]) -> Array:
    """Return the instance of each record (N,), infinite for one without a time."""
    timed = np.isfinite(fields["TimeUS"])
    numbers = np.nan_to_num(np.array(fields.get("I", np.zeros(len(timed)))))
    return np.where(timed, numbers, math.inf)


def _records(log: _Log, name: str, instance: float | None = None) -> Records:
    """Return the records with a time of one instance of a message; None: the first instance."""
    instances = _instances(log.fields[name])
    first = instances.min(initial=math.inf) if instance is None else instance
    taken = (instances == first) & np.isfinite(instances)
    fields = {field: np.array(values)[taken] for field, values in log.fields[name].items()}
    others = len(taken) - int(taken.sum())
    return Records(name, fields["TimeUS"].astype(np.int64), fields, others)


def _used_receiver(fields: Mapping[str, array[float]]) -> float | None:
    """Return the receiver whose fixes the autopilot used most, else the first with a fix.

    The fix type does not show which is best: a rover's is relative to its moving base.
    """
    instances = _instances(fields)
    fixed = (np.array(fields["Status"]) >= LEAST_FIX) & np.isfinite(instances)
    if not fixed.any():
        return None
    used = fixed & (np.array(fields["U"]) == 1)
    numbers, counts = np.unique(instances[used if used.any() else fixed], return_counts=True)
    return float(numbers[counts.argmax() if used.any() else 0])


def _gnss(path: Path, fixes: Records, accuracy: Records, options: LogOptions) -> GnssTable:
    """Return the receiver's table; accuracies are those logged at the same time."""
    undulation_m = options.to_ellipsoid_m(MSL, path)
    course_rad = np.radians(fixes.column("GCrs"))
    speed, down = fixes.column("Spd"), fixes.column("VZ")
    velocity_n = np.stack([speed * np.cos(course_rad), speed * np.sin(course_rad), down], axis=-1)
    rows = accuracy.columns("HAcc", "VAcc", "SAcc", "YAcc", "VV")
    by_time = dict(zip(accuracy.time_us.tolist(), rows, strict=True))
    unknown = np.full(5, math.nan)
    at_fixes = np.array([by_time.get(time_us, unknown) for time_us in fixes.time_us.tolist()])
    horizontal, vertical, of_speed, yaw_deg, has_down = at_fixes.T
    velocity_n[has_down == 0] = math.nan
    latitude_rad, longitude_rad = np.radians(fixes.columns("Lat", "Lng")).T
    heading_deg = fixes.column("Yaw")
    heading_deg[heading_deg == 0] = math.nan  # 0 is logged by a receiver without a heading
    return GnssTable(
        fixes.name,
        fixes.time_us,
        _utc_us(fixes),
        np.nan_to_num(fixes.column("Status")).astype(np.int64),
        np.stack([latitude_rad, longitude_rad, fixes.column("Alt") + undulation_m], axis=-1),
        np.stack([horizontal, vertical], axis=-1),
        velocity_n,
        of_speed,
        np.radians(heading_deg),
        np.radians(yaw_deg),
    )


def _utc_us(fixes: Records) -> IntArray:
    """Return UTC (n,) in us of Unix time; 0 where the week is not known."""
    weeks, tows_ms = np.nan_to_num(fixes.columns("GWk", "GMS")).astype(np.int64).T.tolist()
    times_us = (
        utc_ns_of_week(week, tow_ms * 1_000_000) // 1000 if week > 0 else 0
        for week, tow_ms in zip(weeks, tows_ms, strict=True)
    )
    return np.array(list(times_us), np.int64)


def _notes(log: _Log, used: float | None) -> Iterator[str]:
    """Yield notes on the receiver, by the log's parameters, and on what is left out."""
    number = int(used or 0) + 1
    if number > 1:
        yield f"GPS: receiver {number} is taken"
    new = f"GPS{number}_POS", f"GPS{number}_DELAY_MS"  # names since ArduPilot 4.6
    old = f"GPS_POS{number}", f"GPS_DELAY_MS{number if number > 1 else ''}"
    for antenna, delay in (new, old):
        place = [log.parameters.get(f"{antenna}_{axis}", 0.0) for axis in "XYZ"]
        yield from receiver_notes(antenna, place, delay, log.parameters.get(delay, 0.0))
    if np.isfinite(log.fields["MNT"]["TimeUS"]).any():
        yield "MNT (gimbal) is left out: what its angles refer to differs by mount and version"
