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
"""Define the options and the results of readers of foreign logs; convert logs' times to UTC.

GPS time counts on through leap seconds: it was UTC on 1980-01-06, and is ahead by one second for
each leap second since (IS-GPS-200, section 3.3.4; the dates are those of IERS Bulletin C).
"""

from __future__ import annotations

import bisect
import math
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, NamedTuple

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.io.messages import SensedSample

SECOND_NS = 1_000_000_000
WEEK_NS = 7 * 86400 * SECOND_NS
#: 1980-01-06 in Unix time.
GPS_EPOCH_NS = 315_964_800 * SECOND_NS
#: Year and month at whose beginning (UTC) GPS time became ahead by one second more.
_LEAPS = (
    *((1981, 7), (1982, 7), (1983, 7), (1985, 7), (1988, 1), (1990, 1), (1991, 1), (1992, 7)),
    *((1993, 7), (1994, 7), (1996, 1), (1997, 7), (1999, 1), (2006, 1), (2009, 1), (2012, 7)),
    *((2015, 7), (2017, 1)),
)
_WRITTEN = re.compile(
    r"((?:19|20)\d{2})[-./](\d{1,2})[-./](\d{1,2})[T\s]+(\d{1,2}):(\d{2}):(\d{2})"
    r"(?![\d.,]*\s*[AaPp]\.?[Mm]\b)"  # a time with AM or PM is not read
    r"(?:[.,](\d{1,9})\d*)?(?:,(\d{3}))?"
    r"[ \t]*(?:(Z|UTC|GMT)\b)?[ \t]*([+-]\d{1,2}(?::?\d{2})?(?![\d:.]))?"
)
_OFFSET = re.compile(r"([+-])(\d{1,2})(?::?(\d{2}))?")
ELLIPSOIDAL, MSL, TAKEOFF = DATUMS = ("ellipsoid", "sea", "takeoff")
#: Of the direction that DJI's gimbals take for north: 0 to 5 deg off as a rule, until calibrated.
NORTH_SIGMA_DEG = 3.0
#: Half a wavelength of L1: more than a tape's error, less than that of most wrong ambiguities.
_LENGTH_TOLERANCE_M = 0.1
_ORDINARY = {Source.RTK_POSITION: Source.GPS_POSITION, Source.RTK_VELOCITY: Source.GPS_VELOCITY}


def _unix_ns(*fields: int) -> int:
    return round(datetime(*fields, tzinfo=timezone.utc).timestamp()) * SECOND_NS  # type: ignore[misc,arg-type]


#: GPS times, counted from 1970 as Unix times are, from which one more leap second counts.
_FROM_NS = [_unix_ns(*date, 1) + (k + 1) * SECOND_NS for k, date in enumerate(_LEAPS)]


def utc_ns(gpst_ns: int) -> int:
    """Return the Unix time of a GPS time that is counted from 1970 as Unix times are."""
    return gpst_ns - bisect.bisect_right(_FROM_NS, gpst_ns) * SECOND_NS


def utc_ns_of_week(week: int, of_week_ns: int) -> int:
    """Return the Unix time of a full GPS week (2303, not 255) and a time of week."""
    return utc_ns(GPS_EPOCH_NS + week * WEEK_NS + of_week_ns)


def largest_group(begins_ns: Iterable[int]) -> tuple[int, int]:
    """Return first and last of the largest group of times within a second, a date's resolution."""
    begins = sorted(begins_ns)
    ends = [bisect.bisect_right(begins, begin + SECOND_NS) - 1 for begin in begins]
    first = max(range(len(begins)), key=lambda k: ends[k] - k)
    return begins[first], begins[ends[first]]


def first_count(counts: Iterable[int]) -> int:
    """Return the first count, extrapolated from the next eight if it does not fit them."""
    head = list(islice(counts, 9)) or [0]
    steps = sorted(abs(later - before) for before, later in pairwise(head))
    fits = len(steps) < 3 or abs(head[1] - head[0]) <= 2 * steps[-2]
    return head[0] if fits else head[1] - steps[len(steps) // 2]


class WrittenTime(NamedTuple):
    """Hold a date and time as written: ns of Unix time as if it were UTC, and the zone."""

    local_ns: int
    offset_s: int | None  # of the zone, east positive; None where it is not written


def written_time(text: str) -> WrittenTime | None:
    """Return the first date with time of day in a text, or None; its second may be 60.

    Takes ``2024-06-11T07:44:39.25Z``, ``2025/08/28 17:30:39.749``, DJI's
    ``2022.8.7 13:40:40,774,808`` and Emlid's ``2022-03-14 13:03:45.8 UTC+03:00``.
    """
    match = _WRITTEN.search(text)
    if match is None:
        return None
    *fields, fraction, micros, utc, offset = match.groups()
    zone = offset or (utc and "Z")
    year, month, day, hour, minute, second = map(int, fields)
    try:
        minutes_ns = _unix_ns(year, month, day, hour, minute)
        offset_s = zone_offset_s(zone) if zone else None
    except (ValueError, OverflowError):
        return None
    if second > 60:
        return None
    digits = f"{fraction or ''}{micros or ''}"[:9]
    local_ns = minutes_ns + second * SECOND_NS + int(digits.ljust(9, "0"))
    return WrittenTime(local_ns, offset_s)


def zone_offset_s(text: str) -> int:
    """Return the offset (s, east positive) of ``+09:00``, ``-0330``, ``+02`` or ``Z``.

    Raise ValueError for another text.
    """
    if text == "Z":
        return 0
    match = _OFFSET.fullmatch(text)
    if match is None:
        raise ValueError(text)
    hours, minutes = int(match[2]), int(match[3] or 0)
    if hours > 14 or minutes > 59:
        raise ValueError(text)
    return (hours * 3600 + minutes * 60) * (-1 if match[1] == "-" else 1)


class Refused(Exception):  # noqa: N818  no error: the record is counted
    """Say why a record of a log gives no sample."""


def must(good: object, reason: str) -> None:
    """Raise Refused unless a record is good."""
    if not good:
        raise Refused(reason)


@dataclass(frozen=True)
class LogOptions:
    """Hold what a log does not say itself; None or empty: not given."""

    geoid_undulation_m: float | None = None  # for heights above mean sea level
    baseline_m: float | None = None  # between the two antennas: other lengths are refused
    baseline_rad: float = 0.0  # direction from the first antenna to the second, from the nose
    rover_first: bool = False  # the first antenna is the rover's, the second the moving base's
    takeoff_height_m: float | None = None  # ellipsoidal, for heights above the take-off
    height: str = ""  # datum of heights if the log does not say it: one of DATUMS
    time_scale: str = ""  # of times if the log does not say it: gpst or utc
    utc_offset_s: int | None = None  # of local times, east positive
    start_ns: int | None = None  # UTC of the log's first record, where it has no date
    set_heading_rad: float | None = None  # of the nose, set by a person
    columns: Path | None = None  # what the columns of a CSV file mean
    every_s: float = 0.0  # a video's picture each so many seconds; 0: all of them

    def to_ellipsoid_m(self, datum: str, path: Path) -> float:
        """Return the offset from heights above ``datum`` (of DATUMS) to ellipsoidal heights.

        Raise LogError, naming the option to give, if it is not known.
        """
        if datum == ELLIPSOIDAL:
            return 0.0
        offset_m = self.geoid_undulation_m if datum == MSL else self.takeoff_height_m
        mend = (
            "above mean sea level: give the geoid's height there with --geoid-undulation"
            if datum == MSL
            else "above the take-off: give that place's ellipsoidal height with --takeoff-height"
        )
        if offset_m is None:
            raise LogError(f"{path}: its heights are {mend}")
        return offset_m

    def check_baseline(self, length_m: float) -> None:
        """Raise Refused if the baseline has another length; any is right where it is not known."""
        near = self.baseline_m is None or abs(length_m - self.baseline_m) <= _LENGTH_TOLERANCE_M
        must(near, f"its length is more than {_LENGTH_TOLERANCE_M:g} m from the baseline's")

    def heading(self, stamp_ns: int, azimuth_deg: float, sigma_deg: float) -> HeadingSample:
        """Return the nose's heading where a receiver's points from its first antenna on."""
        azimuth_rad = math.radians(azimuth_deg) + self.rover_first * math.pi
        heading_rad = (azimuth_rad - self.baseline_rad) % math.tau
        return HeadingSample(stamp_ns, heading_rad, math.radians(sigma_deg) ** 2)

    def utc_ns(self, written: WrittenTime, path: Path) -> int:
        """Return the Unix time of a written time. Raise LogError if its zone is not known."""
        offset_s = self.utc_offset_s if written.offset_s is None else written.offset_s
        if offset_s is None:
            raise LogError(
                f"{path}: its times are local, without a zone: give --utc-offset, such as +02:00"
            )
        return written.local_ns - offset_s * SECOND_NS


@dataclass(frozen=True, slots=True)
class Picture:
    """Hold a picture of the camera as a whole file: JPEG, PNG or TIFF, with all that is in it."""

    stamp_ns: int
    data: bytes
    camera: Camera | None = None  # None: not known
    name: str = ""  # of its file, if it is a still
    temperatures: bytes = b""  # PNG in the scale of their topic; empty: not known


@dataclass
class LogContents:
    """Hold the samples of a log, with stamps in ns of Unix time (UTC), and what was left out.

    ``read`` counts the log's records by name, ``refused`` those that gave no sample, by name and
    reason. Each of ``notes`` says in a sentence what the log left open and what is assumed. A
    ``damaged`` file, or one that was cut off, may have lost records that are not counted.
    ``pictures`` are in the order of their stamps and made as they are read, once: those of a video
    do not fit into memory; a reader counts them in ``read`` and ``refused`` meanwhile.
    ``parameters`` of the nodes follow from the log (the sigma of a lens that is not calibrated):
    dotted name -> value.
    """

    samples: list[SensedSample] = field(default_factory=list)
    read: Counter[str] = field(default_factory=Counter)
    refused: Counter[tuple[str, str]] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    damaged: bool = False
    pictures: Iterable[Picture] = ()
    parameters: dict[str, Any] = field(default_factory=dict)


def classify_receiver(contents: LogContents, name: str, *, is_rtk: bool) -> None:
    """Note whether a receiver is RTK; if it is not, change its samples to those of ordinary GPS.

    It is RTK if it was float or fixed at least once; the filter has no use for other ``rtk/fix``.
    """
    if not is_rtk:
        contents.samples = [
            replace(sample, source=_ORDINARY[sample.source])
            if isinstance(sample, PositionSample | VelocitySample)
            else sample
            for sample in contents.samples
        ]
    contents.notes.append(
        f"{name} was {'' if is_rtk else 'never '}RTK float or fixed: its positions are "
        f"{'rtk/fix' if is_rtk else 'gps/fix'}"
    )
