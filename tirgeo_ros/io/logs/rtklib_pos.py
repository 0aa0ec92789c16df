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
"""Read the solution files of RTKLIB (.pos): positions, velocities and their covariances.

Columns as in the manual of RTKLIB 2.4.2, appendix B.1: the values stand in a fixed order, and the
header tells the time scale, the kind of coordinates and the heights' datum. Covariances are given
as signed square roots: ``sdne`` is ``sign(c) sqrt(|c|)``.
"""

from __future__ import annotations

import math
import re
from codecs import BOM_UTF8
from contextlib import suppress
from pathlib import Path

import numpy as np

from tirgeo_ros.core.frames.wgs84 import geodetic_from_ecef, rotation_ecef_from_ned
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source, VelocitySample
from tirgeo_ros.io.files.whole_files import read_text
from tirgeo_ros.io.logs.log_contents import (
    ELLIPSOIDAL,
    GPS_EPOCH_NS,
    MSL,
    SECOND_NS,
    WEEK_NS,
    LogContents,
    LogOptions,
    classify_receiver,
    utc_ns,
    written_time,
)
from tirgeo_ros.io.messages import SensedSample

_MOST_BYTES = 1 << 30
#: What separates columns: blanks, or what was chosen in RTKPOST.
_SEPARATOR = re.compile(r"[\s,;]+")
_TITLES = re.compile(r"%\s+(GPST|UTC|JST)[\s,;]+([^\s,;]+)")
_DATUM = re.compile(r"height=WGS84/(ellipsoidal|geodetic)")
_LIKE_DATUM = re.compile(r"%\s*\(.*(height=|WGS84/|ellipsoidal|geodetic)")
_NUMBER = r"[\s,;]+[-+.\d]+"
_DATE = r"\s*(\d{4}/\d\d/\d\d\s+\d\d:\d\d:[\d.]+|\d{3,4}[\s,;]+\d+(\.\d+)?)"
#: A solution: date, place of three or seven columns, quality, satellites, at least eight more.
_BARE = re.compile(
    rf"{_DATE}({_NUMBER}){{3}}(({_NUMBER}){{4}})?[\s,;]+[0-7](\.0*)?[\s,;]+\d{{1,3}}(\.0*)?"
    rf"({_NUMBER}){{8}}"
)
_DEGREES, _SEXAGESIMAL, _ECEF = "deg", "dms", "ecef"
_COORDINATES = {"latitude(deg)": _DEGREES, "latitude(d'\")": _SEXAGESIMAL, "x-ecef(m)": _ECEF}
_WIDTH = {_DEGREES: 3, _SEXAGESIMAL: 7, _ECEF: 3}
#: Time scale -> how far it is ahead of UTC; RTKLIB applies it to weeks and seconds too.
_AHEAD_NS = {"UTC": 0, "JST": 9 * 3600 * SECOND_NS}
#: Rotation of the file's north, east, up to NED.
_NEU = np.diag([1.0, 1.0, -1.0])
#: Fixed, float, SBAS, differential, single, PPP: the last has no integer ambiguities.
_STATUS: dict[float, FixStatus] = {
    1: FixStatus.FIXED,
    **dict.fromkeys((2, 3, 4, 6), FixStatus.FLOAT),
    5: FixStatus.SINGLE,
}
_RTK = (1, 2)  # fixed and float
_SAMPLE = "solution"


def is_pos(head: bytes) -> bool:
    """Return whether a file's first bytes are those of a solution file."""
    text = head.removeprefix(BOM_UTF8).decode("ascii", "replace")
    return bool(_TITLES.search(text) or _BARE.match(text))


def read_pos(path: Path, options: LogOptions) -> LogContents:
    """Read a solution file. Raise LogError if it is unreadable, or an option is missing."""
    text = read_text(path, LogError, _MOST_BYTES, damaged=True)
    lines = [line for line in text.splitlines() if line.strip()]
    log = _PosLog(path, options, lines)
    for line in lines:
        log.take(line)
    classify_receiver(log.contents, "the receiver", is_rtk=log.is_rtk)
    return log.contents


class _PosLog:
    """Convert the lines of a file one by one; a header applies until the next one."""

    def __init__(self, path: Path, options: LogOptions, lines: list[str]) -> None:
        self.contents = LogContents()
        self.is_rtk = False
        self._path, self._options = path, options
        self._scale = self._coordinates = self._datum = ""  # empty: not known yet
        for line in lines:  # the first header applies to lines before it too
            self._take_header(line)
            if self._scale:
                break
        else:
            self._do_without_header(lines)

    def take(self, line: str) -> None:
        """Take a line: of the header, or a solution."""
        if line.startswith("%"):
            self._take_header(line)
            return
        self.contents.read[_SAMPLE] += 1
        try:
            self.contents.samples += self._samples(_cells(line))
        except (ValueError, OverflowError):
            self.contents.refused[_SAMPLE, "its columns are not those of the header"] += 1

    def _take_header(self, line: str) -> None:
        datum, titles = _DATUM.search(line), _TITLES.match(line)
        if datum:
            self._datum = ELLIPSOIDAL if datum[1] == "ellipsoidal" else MSL
        elif _LIKE_DATUM.match(line):
            raise LogError(
                f"{self._path}: its header has not height=WGS84/ellipsoidal or /geodetic, but "
                f"{line[1:40].strip()}: let RTKLIB write one of them, or mend the line"
            )
        if titles:
            if titles[2] not in _COORDINATES:
                raise LogError(
                    f"{self._path}: coordinates {titles[2]} are relative to a base: let RTKLIB "
                    "write latitude, longitude and height"
                )
            self._scale, self._coordinates = titles[1], _COORDINATES[titles[2]]

    def _do_without_header(self, lines: list[str]) -> None:
        self._scale = self._options.time_scale.upper()
        if not self._scale:
            raise LogError(
                f"{self._path}: no header with the time scale: give --time-scale gpst or utc"
            )
        cells = next((_cells(line) for line in lines if not line.startswith("%")), [])
        coordinates = _SEXAGESIMAL if len(cells) in (19, 28) else _DEGREES
        with suppress(ValueError, IndexError):
            coordinates = _ECEF if abs(float(cells[2])) > 360 else coordinates
        self.contents.notes.append(f"it has no header: coordinates taken as {coordinates}")
        self._coordinates = coordinates

    def _samples(self, cells: list[str]) -> list[SensedSample]:
        """Return the samples of a line; raise ValueError if it is not a solution."""
        date, time, *cells = cells
        stamp_ns = self._stamp_ns(date, time)
        width = _WIDTH[self._coordinates]
        place, (quality, _satellites, *rest) = cells[:width], cells[width:]
        geodetic, r_nf = self._place(place)
        numbers = [float(cell) for cell in rest]
        self.is_rtk |= float(quality) in _RTK
        status = _STATUS.get(float(quality), FixStatus.NONE)
        covariance_n = _covariance_n(numbers[:6], r_nf)
        source = Source.RTK_POSITION
        position = PositionSample(stamp_ns, source, status, *geodetic, covariance_n)
        if len(numbers) < 17:  # covariance (6), age, ratio, velocity (3), its covariance (6)
            return [position]
        velocity_n = r_nf @ np.array(numbers[8:11])
        covariance_n = _covariance_n(numbers[11:17], r_nf)
        velocity = VelocitySample(stamp_ns, Source.RTK_VELOCITY, velocity_n, covariance_n)
        return [position, velocity]

    def _stamp_ns(self, date: str, time: str) -> int:
        """Return the Unix time of the first two columns: date and time, or week and seconds."""
        if "/" in date:
            written = written_time(f"{date} {time}")
            if written is None:
                raise ValueError(date)
            local_ns = written.local_ns
        else:
            local_ns = GPS_EPOCH_NS + int(date) * WEEK_NS + round(float(time) * 1e6) * 1000
        return utc_ns(local_ns) if self._scale == "GPST" else local_ns - _AHEAD_NS[self._scale]

    def _place(self, cells: list[str]) -> tuple[tuple[float, float, float], Array]:
        """Return latitude, longitude (rad), height, and the rotation of the file's axes to NED."""
        if self._coordinates == _ECEF:
            place = geodetic_from_ecef(np.array([float(cell) for cell in cells]))
            latitude_rad, longitude_rad, height_m = map(float, place)
            r_en = rotation_ecef_from_ned(latitude_rad, longitude_rad)
            return (latitude_rad, longitude_rad, height_m), r_en.T
        half = len(cells) // 2
        latitude_rad, longitude_rad = _angle_rad(cells[:half]), _angle_rad(cells[half:-1])
        datum = self._datum or self._options.height
        if not datum:
            raise LogError(
                f"{self._path}: its header does not say what heights are above: give --height "
                "ellipsoid, or --height sea (above sea level)"
            )
        offset_m = self._options.to_ellipsoid_m(datum, self._path)
        return (latitude_rad, longitude_rad, float(cells[-1]) + offset_m), _NEU


def _cells(line: str) -> list[str]:
    return _SEPARATOR.split(line.strip(" \t,;"))


def _angle_rad(cells: list[str]) -> float:
    """Return degrees, or degrees, minutes and seconds, in rad; -0 degrees is negative."""
    degrees, minutes, seconds = (*map(float, cells), 0.0, 0.0)[:3]
    return math.radians(math.copysign(abs(degrees) + minutes / 60 + seconds / 3600, degrees))


def _covariance_n(roots: list[float], r_nf: Array) -> Array:
    """Return the covariance in NED (3, 3) of signed square roots in the file's axes.

    They are of xx, yy, zz, xy, yz, zx.
    """
    xx, yy, zz, xy, yz, zx = (math.copysign(root * root, root) for root in roots)
    covariance_f = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    return np.asarray(r_nf @ covariance_f @ r_nf.T)
