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
"""Read the marks that DJI's RTK aircraft write beside stills (Timestamp.MRK).

A line has a still's number, GPS seconds of week and week, how far the camera is from the antenna
north, east and down (mm), the camera's latitude, longitude and ellipsoidal height, the sigmas
north, east and down (m) and the quality of RTK: as in the user manuals of DJI's aircraft.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source
from tirgeo_ros.io.files.whole_files import read_text
from tirgeo_ros.io.logs.log_contents import (
    SECOND_NS,
    LogContents,
    LogOptions,
    classify_receiver,
    utc_ns_of_week,
)

_N = r"\s*([-+]?\d+(?:\.\d+)?)\s*"
_LINE = re.compile(
    rf"\d+\s+{_N}\[(\d+)\][^,]*,N[^,]*,E[^,]*,V{_N},Lat{_N},Lon{_N},Ellh{_N},{_N},{_N}(\d+)\s*,Q"
)
_FLOAT, _FIXED = 32, 50  # least quality; 16 is single, 0 no position
_MARK = "mark"


def is_mrk(head: bytes) -> bool:
    """Return whether a file's first bytes have a mark of a still."""
    return bool(_LINE.search(head.decode("ascii", "replace")))


def read_mrk(path: Path, _options: LogOptions) -> LogContents:
    """Read the marks of stills; raise LogError if the file cannot be read."""
    contents, positions = LogContents(), []
    for line in filter(str.strip, read_text(path, LogError, damaged=True).splitlines()):
        contents.read[_MARK] += 1
        match = _LINE.match(line.strip())
        if match is None or not int(match[9]):
            reason = "not a whole line" if match is None else "no position in it"
            contents.refused[_MARK, reason] += 1
        else:
            positions.append(_position(*match.groups()))
    contents.samples += positions
    is_rtk = any(position.status > FixStatus.SINGLE for position in positions)
    classify_receiver(contents, "the aircraft", is_rtk=is_rtk)
    contents.notes.append(
        "positions are of the camera, not of the antenna: leave aircraft.rtk_antenna_m and the "
        "camera's place at zero"
    )
    return contents


def _position(of_week_s: str, week: str, *values: str) -> PositionSample:
    latitude_deg, longitude_deg, height_m, *sigmas_m, quality = map(float, values)
    stamp_ns = utc_ns_of_week(int(week), round(float(of_week_s) * SECOND_NS))
    status = FixStatus.FLOAT if quality >= _FLOAT else FixStatus.SINGLE
    status = FixStatus.FIXED if quality >= _FIXED else status
    geodetic = math.radians(latitude_deg), math.radians(longitude_deg), height_m
    covariance_n = np.diag(np.square(sigmas_m))
    return PositionSample(stamp_ns, Source.RTK_POSITION, status, *geodetic, covariance_n)
