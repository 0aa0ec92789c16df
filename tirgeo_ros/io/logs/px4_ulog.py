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
"""Read PX4's logs (ULog) through pyulog: IMU, attitude, satellite receiver, barometer.

Fields differ by version and are taken by their names: positions in 1e-7 deg and mm, or in deg and
m. ``heading`` is the nose's: PX4's drivers subtract ``heading_offset``, the baseline's direction
in the body, from the baseline's azimuth, as the contract of ``rtk/heading`` asks for.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import LogError
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
from tirgeo_ros.io.logs.log_contents import MSL, LogContents, LogOptions

MAGIC = b"ULog\x01\x12\x35"

_IMUS, _ATTITUDE = ("sensor_combined", "vehicle_imu"), "vehicle_attitude"
#: The receiver that PX4's filter uses, which may be a blend of several; else a single receiver.
_RECEIVERS = ("vehicle_gps_position", "sensor_gps")
_AIR = "vehicle_air_data"
_GIMBALS = ("gimbal_device_attitude_status", "mount_orientation")
_WANTED = [*_IMUS, _ATTITUDE, *_RECEIVERS, _AIR, *_GIMBALS]


def is_px4_ulog(head: bytes) -> bool:
    """Return whether a file that begins so is a ULog."""
    return head.startswith(MAGIC)


class _File(BufferedReader):
    """Read a file; ``cut`` is true if the last read ended within a record."""

    cut = False

    def read(self, size: int | None = -1, /) -> bytes:
        """Return up to ``size`` bytes: of a record its head of three, then its rest."""
        data = super().read(size)
        self.cut = size is not None and len(data) < size and (size != 3 or bool(data))
        return data


@np.errstate(invalid="ignore", over="ignore", divide="ignore")  # samples are judged afterwards
def read_px4_ulog(path: Path, options: LogOptions) -> LogContents:
    """Read a log, as far as it is whole.

    Of several instances of a topic the first is used, of receivers the first with a fix. Raise
    LogError if it is not a ULog, has no IMU, or has only heights above mean sea level while the
    undulation is not given.
    """
    from pyulog import ULog  # noqa: PLC0415  an extra, for these logs alone

    with parsing(path, "ULog"), _File(FileIO(path)) as file:
        log = ULog(file, _WANTED)
    contents = LogContents(damaged=file.cut or log.file_corruption)
    tables = _instances_taken(log)
    imu = tables.get(_IMUS[0], tables.get(_IMUS[1]))
    receiver = tables.get(_RECEIVERS[0], tables.get(_RECEIVERS[1]))
    attitude, air = tables.get(_ATTITUDE), tables.get(_AIR)
    if imu is None:
        raise LogError(f"{path}: no IMU in this log: none of {', '.join(_IMUS)} is in it")
    count_records(contents, filter(None, (imu, attitude, receiver, air)))
    try:
        gnss = None if receiver is None else _gnss(path, receiver, options)
        pressures = None if air is None else (air.time_us, air.column("baro_pressure_pa"))
        attitudes = None
        if attitude is not None:
            q_nb = attitude.columns(*(f"q[{k}]" for k in range(4)))
            attitudes = attitude.time_us, q_nb
        add_samples(contents, _imu(imu), attitudes, gnss, pressures)
        if receiver is not None:
            contents.notes += _receiver_notes(log.initial_parameters, receiver)
    except KeyError as error:
        why = f"a topic has no field {error}: this version of PX4 is not supported"
        raise LogError(f"{path}: {why}") from None
    contents.notes += [
        f"{name} is left out: what its angles refer to differs by flags and version"
        for name in _GIMBALS
        if name in tables
    ]
    return contents


def _instances_taken(log: Any) -> dict[str, Records]:
    """Return each topic's records of one instance, by their times of measurement since boot.

    It is the first instance with a fix, else the first; the records of the others are counted.
    """
    topics = defaultdict[str, list[Records]](list)
    for data in sorted(log.data_list, key=lambda data: int(data.multi_id)):
        logged_us = np.asarray(data.data.get("timestamp", ()), np.int64)
        if len(logged_us):  # a topic with a damaged format has none
            sampled_us = data.data.get("timestamp_sample", np.zeros(len(logged_us)))
            sampled_us = np.asarray(sampled_us, np.int64)
            time_us = np.where(sampled_us > 0, sampled_us, logged_us)
            topics[data.name].append(Records(data.name, time_us, data.data))
    tables = {}
    for name, instances in topics.items():
        fixed = (table for table in instances if (table.integers("fix_type") >= LEAST_FIX).any())
        tables[name] = taken = next(fixed, instances[0])
        taken.others = sum(map(len, instances)) - len(taken)
    return tables


def _imu(table: Records) -> ImuTable:
    """Return the IMU: rates and forces, or the steps of angle and velocity by their durations."""
    if table.name == _IMUS[0]:
        force_b, rate_b = _xyz(table, "accelerometer_m_s2"), _xyz(table, "gyro_rad")
        return ImuTable(table.time_us, force_b, rate_b)
    seconds = table.columns("delta_velocity_dt", "delta_angle_dt") * 1e-6
    force_b = _xyz(table, "delta_velocity") / seconds[:, :1]
    rate_b = _xyz(table, "delta_angle") / seconds[:, 1:]
    return ImuTable(table.time_us, force_b, rate_b)


def _xyz(table: Records, name: str) -> Array:
    return table.columns(*(f"{name}[{axis}]" for axis in range(3)))


def _gnss(path: Path, table: Records, options: LogOptions) -> GnssTable:
    """Return a receiver's table; integers are in 1e-7 deg and mm, doubles in deg and m."""
    degrees = ("latitude_deg", "longitude_deg")
    scaled = not table.has(degrees[0])
    latitude, longitude = table.columns(*(("lat", "lon") if scaled else degrees)).T
    velocity_n = table.columns("vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
    velocity_n[table.column("vel_ned_valid") == 0] = math.nan
    unit = math.radians(1e-7 if scaled else 1.0)
    heights = ("alt_ellipsoid", "alt") if scaled else ("altitude_ellipsoid_m", "altitude_msl_m")
    height_m, sea_level_m = (table.column(name) * (1e-3 if scaled else 1.0) for name in heights)
    if not height_m.any() or np.isnan(height_m).all():  # none is logged
        height_m = sea_level_m + options.to_ellipsoid_m(MSL, path)
    return GnssTable(
        table.name,
        table.time_us,
        table.integers("time_utc_usec"),
        table.integers("fix_type"),
        np.stack([latitude * unit, longitude * unit, height_m], axis=-1),
        table.columns("eph", "epv"),
        velocity_n,
        table.column("s_variance_m_s"),  # a standard deviation, whatever its name says
        table.column("heading"),
        table.column("heading_accuracy"),
    )


def _receiver_notes(parameters: dict[str, float], receiver: Records) -> Iterator[str]:
    """Yield notes on the receiver: its place and delay by the log's parameters, its heading."""
    place = [float(parameters.get(f"EKF2_GPS_POS_{axis}", 0.0)) for axis in "XYZ"]
    delay_ms = float(parameters.get("EKF2_GPS_DELAY", 0.0))
    yield from receiver_notes("EKF2_GPS_POS", place, "EKF2_GPS_DELAY", delay_ms)
    offset = receiver.column("heading_offset")[~np.isnan(receiver.column("heading"))]
    offsets = offset[np.isfinite(offset)]
    if len(offsets):
        offset_deg = math.degrees(float(np.median(offsets)))
        yield (
            f"headings are the nose's: PX4 has subtracted heading_offset, {offset_deg:.1f} deg: "
            "seen from aircraft.rtk_antenna_m, aircraft.second_antenna_m lies in that direction, "
            "clockwise from the nose"
        )
