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
"""Convert an autopilot's tables to samples: IMU with attitudes, satellite receiver, barometer."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.frames.rotations import flu_from_frd, slerp
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.streams.stamps import lone_stamps
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    PositionSample,
    PressureSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.io.files.bounded_reading import bounded_memory
from tirgeo_ros.io.files.whole_files import reading
from tirgeo_ros.io.logs.log_contents import LogContents, classify_receiver

#: Attitudes further apart than this are not interpolated; gimbal_node has the same limit.
_LONGEST_GAP_NS = 250_000_000
#: Limit of the memory to read a log: an hour at 250 Hz takes a third of it.
_LOG_BYTES = 2 << 30
#: The year 2000 in Unix time (us): a later time is a date, not a time since power-on.
_UNIX_US = 946_684_800_000_000
#: Fix types of MAVLink, which PX4 and ArduPilot log: 4 differential, 5 RTK float, 6 RTK fixed.
_FIXES = {3: FixStatus.SINGLE, 4: FixStatus.FLOAT, 5: FixStatus.FLOAT, 6: FixStatus.FIXED}
LEAST_FIX = min(_FIXES)


@contextmanager
def parsing(path: Path, form: str) -> Iterator[StringIO]:
    """Yield what a parser prints; raise LogError, naming the log, for whatever it raises."""
    output = StringIO()
    try:
        with (
            reading(path, LogError),
            bounded_memory(_LOG_BYTES),
            redirect_stdout(output),
            redirect_stderr(output),
        ):
            yield output
    except LogError:
        raise
    except Exception as error:  # noqa: BLE001  the parsers raise many kinds, and that very class
        why = str(error) or type(error).__name__
        raise LogError(f"{path}: damaged, or not a {form}: {why}") from None


class Records:
    """Hold the records of one message: their times (us), and their fields by name.

    They are of the one instance that is used; ``others`` counts the records of other instances.
    """

    def __init__(
        self, name: str, time_us: IntArray, fields: Mapping[str, Any], others: int = 0
    ) -> None:
        self.name, self.time_us, self.others = name, time_us, others
        self._fields = fields

    def __len__(self) -> int:
        return len(self.time_us)

    def has(self, field: str) -> bool:
        """Return whether the records have this field."""
        return field in self._fields

    def column(self, name: str) -> Array:
        """Return a field (N,); NaN if the records do not have it."""
        return np.array(self._fields.get(name, np.full(len(self), math.nan)), float)

    def columns(self, *names: str) -> Array:
        """Return fields as columns (N, number of names). Raise KeyError for a missing field."""
        return np.stack([np.asarray(self._fields[name], float) for name in names], axis=-1)

    def integers(self, name: str) -> IntArray:
        """Return a field (N,); zeros if the records do not have it."""
        return np.asarray(self._fields.get(name, np.zeros(len(self))), np.int64)


@dataclass(frozen=True)
class ImuTable:
    """Hold N readings in body FRD: specific force (m/s2), angular rate (rad/s); clock in us."""

    time_us: IntArray
    force_b: Array  # (N, 3)
    rate_b: Array  # (N, 3)


@dataclass(frozen=True)
class GnssTable:
    """Hold N records of a satellite receiver; clock in us; NaN where there is no value."""

    name: str
    time_us: IntArray
    utc_us: IntArray  # Unix time by the receiver; 0 or less: not known yet
    fix: IntArray  # MAVLink's GPS_FIX_TYPE
    geodetic: Array  # (N, 3) latitude, longitude (rad), ellipsoidal height (m)
    sigma_m: Array  # (N, 2) horizontal, vertical
    velocity_n: Array  # (N, 3) m/s
    velocity_sigma_m_s: Array
    heading_rad: Array  # of the nose, from two antennas
    heading_sigma_rad: Array


def count_records(contents: LogContents, tables: Iterable[Records]) -> None:
    """Count the records that are used, and those of other instances."""
    for table in tables:
        contents.read[table.name] += len(table) + table.others
        if table.others:
            contents.refused[table.name, "of another instance than the one taken"] += table.others


def add_samples(
    contents: LogContents,
    imu: ImuTable,
    attitude: tuple[IntArray, Array] | None,
    gnss: GnssTable | None,
    air: tuple[IntArray, Array] | None,
) -> None:
    """Add the samples of an autopilot's tables.

    ``attitude`` has times and quaternions (N, 4), body FRD to NED; ``air`` times and pressures,
    Pa. Stamps are the autopilot's clock plus its offset to the receiver's UTC.
    """
    shift_us = _clock_shift_us(gnss, int(imu.time_us[0]), contents)
    stamps_ns = ((imu.time_us + shift_us) * 1000).tolist()
    attitudes = _attitudes_at(imu.time_us, *attitude) if attitude else [None] * len(stamps_ns)
    contents.samples += map(ImuSample, stamps_ns, imu.force_b, imu.rate_b, attitudes)
    if gnss is not None:
        _add_gnss(contents, shift_us, gnss)
    for time_us, pressure_pa in zip(*air, strict=True) if air else ():
        stamp_ns = (int(time_us) + shift_us) * 1000
        contents.samples.append(PressureSample(stamp_ns, float(pressure_pa), 0.0))


def _clock_shift_us(gnss: GnssTable | None, first_us: int, contents: LogContents) -> int:
    """Return UTC minus the autopilot's clock (us); note its spread, or that no receiver has UTC.

    ``first_us`` is a time of the autopilot's clock.
    """
    shifts_us = np.empty(0, np.int64)
    if gnss is not None:
        dated = gnss.utc_us > 0
        # before a fix, a receiver reports only its own clock's count since it was switched on
        fixed = dated & np.isin(gnss.fix, list(_FIXES))
        shifts_us = (gnss.utc_us - gnss.time_us)[fixed if fixed.any() else dated]
    if len(shifts_us):
        spread_ms = float(np.ptp(shifts_us)) * 1e-3
        contents.notes.append(
            f"stamps are the autopilot's clock plus the median of {len(shifts_us)} "
            f"differences to the receiver's UTC, which spread over {spread_ms:.0f} ms"
        )
        return int(np.median(shifts_us))
    contents.notes.append(
        "no receiver gives UTC: the autopilot's own clock is used, which has a date"
        if first_us > _UNIX_US
        else "no receiver gives UTC: stamps count from the autopilot's start, and are in 1970"
    )
    return 0


def _attitudes_at(time_us: IntArray, attitude_us: IntArray, q_nb: Array) -> list[Array | None]:
    """Return the attitude (4,) at each time, interpolated; None in a gap and beyond the ends."""
    usable = np.array([usable_attitude(q) for q in q_nb], bool)
    usable &= ~lone_stamps(attitude_us * 1000)
    attitude_us, q_nb = attitude_us[usable], q_nb[usable]
    order = np.argsort(attitude_us, kind="stable")
    attitude_us, q_nb = attitude_us[order], q_nb[order]
    attitudes: list[Array | None] = []
    for at_us, after in zip(time_us.tolist(), np.searchsorted(attitude_us, time_us), strict=True):
        if after < len(attitude_us) and attitude_us[after] == at_us:
            attitudes.append(q_nb[after])
            continue
        if not 0 < after < len(attitude_us):
            attitudes.append(None)
            continue
        step_us = int(attitude_us[after] - attitude_us[after - 1])
        fraction = (at_us - int(attitude_us[after - 1])) / step_us
        near = step_us * 1000 <= _LONGEST_GAP_NS
        attitudes.append(slerp(q_nb[after - 1], q_nb[after], fraction) if near else None)
    return attitudes


def _add_gnss(contents: LogContents, shift_us: int, gnss: GnssTable) -> None:
    """Add a receiver's positions, velocities and headings."""
    add = contents.samples.append
    stamps_ns = ((gnss.time_us + shift_us) * 1000).tolist()
    for row, (stamp_ns, fix) in enumerate(zip(stamps_ns, gnss.fix.tolist(), strict=True)):
        if fix not in _FIXES:
            contents.refused[gnss.name, f"fix type {fix}: no position in three dimensions"] += 1
            continue
        horizontal, vertical = (_valid_sigma(sigma_m) ** 2 for sigma_m in gnss.sigma_m[row])
        covariance_n = np.diag([horizontal, horizontal, vertical])
        latitude_rad, longitude_rad, height_m = gnss.geodetic[row].tolist()
        place = latitude_rad, longitude_rad, height_m
        source, status = Source.RTK_POSITION, _FIXES[fix]
        add(PositionSample(stamp_ns, source, status, *place, covariance_n))
        velocity_n = gnss.velocity_n[row]
        if not np.isnan(velocity_n).any():
            covariance_n = np.eye(3) * _valid_sigma(gnss.velocity_sigma_m_s[row]) ** 2
            add(VelocitySample(stamp_ns, Source.RTK_VELOCITY, velocity_n, covariance_n))
        if not np.isnan(gnss.heading_rad[row]):
            heading_rad = float(gnss.heading_rad[row] % (2 * np.pi))
            add(
                HeadingSample(
                    stamp_ns, heading_rad, _valid_sigma(gnss.heading_sigma_rad[row]) ** 2
                )
            )
    classify_receiver(contents, gnss.name, is_rtk=bool(np.isin(gnss.fix, (5, 6)).any()))


def _valid_sigma(sigma: float) -> float:
    """Return a standard deviation; 0 (unknown) if it is not positive and finite."""
    return float(sigma) if 0 < sigma < np.inf else 0.0


def receiver_notes(
    antenna: str, place_frd_m: Sequence[float], delay: str, delay_ms: float
) -> Iterator[str]:
    """Yield notes on the antenna's place and the receiver's delay, by the log's parameters."""
    if any(place_frd_m):
        forward, left, up = (flu_from_frd(np.array(place_frd_m)) + 0.0).tolist()  # no -0
        yield (
            f"{antenna}: the antenna is at [{forward:g}, {left:g}, {up:g}] (forward, left, up); "
            "set aircraft.gps_antenna_m, or rtk_antenna_m"
        )
    if delay_ms:
        yield (
            f"{delay} is {delay_ms:g} ms, and stamps are not corrected for it: set gps.delay_s, "
            f"or rtk.delay_s, to {delay_ms * 1e-3:g}"
        )
