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
"""Read NMEA 0183: GGA and GST to positions; HDT, THS, PASHR and SkyTraq's PSTI to headings.

Sentences are decoded by pynmeagps. GST has the sigmas of latitude, longitude and height of its
epoch; without it the covariance is unknown. RMC, ZDA and PSTI have a date. A sentence without one
is within half a day of the one before it, and those before the first date of that. HDT and THS
have no time: theirs is that of the sentence before, or of the one after where the log begins with
a heading.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from datetime import date, datetime, time, timezone
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import FixStatus, HeadingSample, PositionSample, Source
from tirgeo_ros.io.files.whole_files import reading
from tirgeo_ros.io.logs.log_contents import (
    MSL,
    SECOND_NS,
    LogContents,
    LogOptions,
    Refused,
    classify_receiver,
    must,
)

_NAME = rb"\$(?:[A-Z]{2}(?=[A-Z]{3},))?(GGA|RMC|GST|HDT|THS|ZDA|PASHR(?=,\d)|PSTI,03[56]),"
_FIRST = re.compile(b"^" + _NAME, re.MULTILINE)
_SENTENCE = re.compile(_NAME + rb"[^$*\r\n]*(\*[0-9A-F]{2})?")
#: Quality of a GGA: RTK fixed, RTK float, differential, single, PPS.
_STATUS = {
    4: FixStatus.FIXED,
    **dict.fromkeys((2, 5), FixStatus.FLOAT),
    **dict.fromkeys((1, 3), FixStatus.SINGLE),
}
_RTK = (4, 5)
_TIMELESS = ("THS", "HDT")
_VECTOR = "PSTI,035"  # from the moving base to the rover
#: Sentences with a heading: its field, and the field that says whether it is good, with what it
#: says then. Those of one log repeat the same heading, and the first is used.
_HEADINGS = {
    _VECTOR: ("field_10", "field_05", "R"),
    "PSTI,036": ("field_04", "field_07", "R"),
    "PASHR": ("trueHdg", "gnssQual", range(1, 10)),
    "THS": ("headt", "mi", "A"),
    "HDT": ("headingT", "msgID", "HDT"),
}
#: What a field that is missing or no number raises; the checksum has eight bits.
_DAMAGE = (AttributeError, KeyError, TypeError, ValueError)
_DAY_NS = 86400 * SECOND_NS


def is_nmea(head: bytes) -> bool:
    """Return whether one of a file's first lines is a sentence that is read."""
    return bool(_FIRST.search(head))


def read_nmea(path: Path, options: LogOptions) -> LogContents:
    """Read a log of NMEA, alone or among other data.

    Raise LogError if it cannot be read, or if heights are above an unknown sea level.
    """
    with reading(path, LogError):
        data = path.read_bytes()
    contents = LogContents()
    log = _NmeaLog(list(_sentences(data, contents)), path, options, contents)
    log.add("GST", log.take_sigmas)
    log.add("GGA", log.position)
    if contents.read["GGA"]:
        classify_receiver(contents, "GGA", is_rtk=log.is_rtk)
    # Vectors have lengths that are checked: the other headings of such a receiver have none.
    headings = [_VECTOR] if contents.read[_VECTOR] else _HEADINGS
    if name := next(
        (each for each in headings if log.add(each, partial(log.heading, each))), None
    ):
        contents.notes.append(f"headings are those of {name}")
    return contents


class _Sentence(NamedTuple):
    """Hold a sentence and its time (Unix, ns): less than a day if it has no date."""

    name: str
    fields: Any
    time_ns: int | None


def _sentences(data: bytes, contents: LogContents) -> Iterator[_Sentence]:
    """Yield the sentences with a checksum; count the others."""
    from pynmeagps import NMEAReader  # noqa: PLC0415  an extra
    from pynmeagps.exceptions import NMEAParseError, NMEATypeError  # noqa: PLC0415  as above

    for match in _SENTENCE.finditer(data):
        name = match[1].decode()
        contents.read[name] += 1
        try:
            must(match[2], "cut off")
            yield _sentence(name, NMEAReader.parse(match[0] + b"\r\n"))
        except (Refused, NMEAParseError, NMEATypeError, *_DAMAGE):
            contents.refused[name, "cut off, or its checksum is wrong"] += 1


def _sentence(name: str, fields: Any) -> _Sentence:
    """Return a sentence with its time; raise ValueError for an impossible date."""
    from pynmeagps import date2utc, time2utc  # noqa: PLC0415  as above

    day = getattr(fields, "date", None)
    moment = getattr(fields, "time", getattr(fields, "utctime", None))
    if fields.msgID == "STI":
        moment, day = time2utc(fields.field_02), date2utc(fields.field_03)
    elif name == "ZDA" and fields.year:
        day = date(fields.year, fields.month, fields.day)
    if not isinstance(moment, time):
        return _Sentence(name, fields, None)
    utc = datetime.combine(day or date(1970, 1, 1), moment, timezone.utc)
    return _Sentence(name, fields, round(utc.timestamp() * 1e6) * 1000)


def _stamps_ns(sentences: list[_Sentence]) -> list[int | None]:
    """Return the UTC (ns) of each sentence; None: not known."""
    times_ns = [each.time_ns for each in sentences]
    last_ns = next((time_ns for time_ns in times_ns if time_ns and time_ns >= _DAY_NS), None)
    stamps: list[int | None] = []
    for time_ns in times_ns:
        if last_ns is None or time_ns is None:
            stamps.append(None)
            continue
        step_ns = (time_ns - last_ns + _DAY_NS // 2) % _DAY_NS - _DAY_NS // 2
        last_ns = time_ns if time_ns >= _DAY_NS else last_ns + step_ns
        stamps.append(last_ns)
    way = -1 if sentences and sentences[0].name in _TIMELESS else 1
    near: int | None = None
    for place in range(len(stamps))[::way]:
        near = stamps[place] = near if stamps[place] is None else stamps[place]
    return stamps


class _NmeaLog:
    """Convert the sentences of a log by name."""

    def __init__(
        self, sentences: list[_Sentence], path: Path, options: LogOptions, contents: LogContents
    ) -> None:
        self._path, self._options, self._contents = path, options, contents
        self._dated = list(zip(sentences, _stamps_ns(sentences), strict=True))
        self._sigmas_m: dict[int, tuple[float, ...]] = {}
        self._epochs: set[int] = set()
        self.is_rtk = False

    def add(self, name: str, convert: Callable[..., Any]) -> int:
        """Add the samples of the sentences of a name, count the others; return their number."""
        before = len(self._contents.samples)
        for sentence, stamp_ns in self._dated:
            if sentence.name != name:
                continue
            try:
                must(stamp_ns is not None, "no RMC or ZDA with its date: record one of them too")
                sample = convert(sentence.fields, stamp_ns)
                self._contents.samples += [] if sample is None else [sample]
            except Refused as why:
                self._contents.refused[name, str(why)] += 1
            except _DAMAGE:
                self._contents.refused[name, "a field of it is missing, or no number"] += 1
        return len(self._contents.samples) - before

    def take_sigmas(self, gst: Any, stamp_ns: int) -> None:
        """Take the sigmas of an epoch (m, north, east, down); raise Refused without them."""
        sigmas = gst.stdLat, gst.stdLong, gst.stdAlt
        must(all(isinstance(sigma, float) and sigma > 0 for sigma in sigmas), "it has no sigmas")
        self._sigmas_m[stamp_ns] = sigmas

    def position(self, gga: Any, stamp_ns: int) -> PositionSample:
        """Return a position; raise Refused without a fix."""
        must(gga.quality in _STATUS, "no fix, or none of satellites")
        must(stamp_ns not in self._epochs, "another one of its epoch is used")
        self._epochs.add(stamp_ns)
        self.is_rtk |= gga.quality in _RTK
        place = _float(gga.lat), _float(gga.lon), _float(gga.alt)
        ellipsoidal = gga.sep != ""  # the geoid that the receiver itself has used
        offset_m = gga.sep if ellipsoidal else self._options.to_ellipsoid_m(MSL, self._path)
        covariance_n = np.diag(np.square(self._sigmas_m.get(stamp_ns, (0.0, 0.0, 0.0))))
        geodetic = math.radians(place[0]), math.radians(place[1]), place[2] + offset_m
        status, source = _STATUS[gga.quality], Source.RTK_POSITION
        return PositionSample(stamp_ns, source, status, *geodetic, covariance_n)

    def heading(self, name: str, fields: Any, stamp_ns: int) -> HeadingSample:
        """Return a heading; raise Refused where the receiver does not vouch for it."""
        azimuth, mark, good = _HEADINGS[name]
        must(getattr(fields, mark) in good, "the receiver marks it as not fixed, or not valid")
        if name == _VECTOR:
            self._options.check_baseline(_float(fields.field_09))
        sigma_deg = _float(fields.hdgAcc) if name == "PASHR" else 0.0  # unknown
        return self._options.heading(stamp_ns, _float(getattr(fields, azimuth)), sigma_deg)


def _float(value: object) -> float:
    """Return a field as a number; raise Refused for an empty one."""
    must(value not in {"", None}, "a field of it is empty")
    return float(value)  # type: ignore[arg-type]
