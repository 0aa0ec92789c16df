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
"""Read NMEA 0183: GGA and GST to positions; HDT, THS, PASHR and SkyTraq's PSTI,035 to headings.

Sentences are decoded by pynmeagps. GST has the sigmas of latitude, longitude and height of its
epoch; without it the covariance is unknown. The date is that of the last RMC, ZDA or PSTI before,
or of the log's first one. HDT and THS have no time: theirs is that of the sentence before, or of
the one after it where the log begins with a heading.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from datetime import date, datetime, time, timezone
from itertools import accumulate
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

_NAME = rb"\$(?:[A-Z]{2}(GGA|RMC|GST|HDT|THS|ZDA)|(PASHR)(?=,\d)|(PSTI)(?=,035)),"
_FIRST = re.compile(b"^" + _NAME, re.MULTILINE)
_SENTENCE = re.compile(_NAME + rb"[^$*\r\n]*(\*[0-9A-F]{2})?")
#: Quality of a GGA: RTK fixed, RTK float, differential, single, PPS.
_STATUS = {
    4: FixStatus.FIXED,
    **dict.fromkeys((2, 5), FixStatus.FLOAT),
    **dict.fromkeys((1, 3), FixStatus.SINGLE),
}
_RTK = (4, 5)
#: Sentences with a heading; those of one log repeat the same one, and the first is used.
_TIMELESS = ("THS", "HDT")
_HEADINGS = ("PSTI", "PASHR", *_TIMELESS)
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
    log = _NmeaLog(path, options)
    for match in _SENTENCE.finditer(data):
        log.take(match)
    log.finish()
    return log.contents


class _Sentence(NamedTuple):
    """Hold a sentence and its time (Unix, ns): of 1970-01-01 if it has no date."""

    name: str
    fields: Any
    time_ns: int | None
    is_dated: bool


class _NmeaLog:
    """Collect the sentences of a log, then date and convert them."""

    def __init__(self, path: Path, options: LogOptions) -> None:
        self.contents = LogContents()
        self._path, self._options = path, options
        self._sentences: list[_Sentence] = []
        self._sigmas_m: dict[int, tuple[float, ...]] = {}
        self._epochs: set[int] = set()
        self._is_rtk = False

    def take(self, match: re.Match[bytes]) -> None:
        """Take a sentence with its checksum."""
        from pynmeagps import NMEAReader  # noqa: PLC0415  an extra
        from pynmeagps.exceptions import NMEAParseError, NMEATypeError  # noqa: PLC0415  as above

        name = (match[1] or match[2] or match[3]).decode()
        self.contents.read[name] += 1
        try:
            must(match[4], "cut off")
            sentence = _sentence(name, NMEAReader.parse(match[0] + b"\r\n"))
        except (Refused, NMEAParseError, NMEATypeError, *_DAMAGE):
            self.contents.refused[name, "cut off, or its checksum is wrong"] += 1
        else:
            self._sentences.append(sentence)

    def finish(self) -> None:
        """Convert the collected sentences to samples."""
        self._stamps = self._stamps_ns()
        self._each("GST", self._take_sigmas)
        self._each("GGA", self._position)
        if self.contents.read["GGA"]:
            classify_receiver(self.contents, "GGA", is_rtk=self._is_rtk)
        name = next((name for name in _HEADINGS if self._each(name, self._heading)), None)
        self.contents.notes += [f"headings are those of {name}"] if name else []

    def _stamps_ns(self) -> list[int | None]:
        """Return the UTC (ns) of each sentence; None: not known."""
        last = next((each for each in self._sentences if each.is_dated), None)
        stamps: list[int | None] = []
        for each in self._sentences:
            last = each if each.is_dated else last
            if each.time_ns is None or last is None or last.time_ns is None:
                stamps.append(None)
            else:
                step_ns = (each.time_ns - last.time_ns + _DAY_NS // 2) % _DAY_NS - _DAY_NS // 2
                stamps.append(last.time_ns + step_ns)
        way = -1 if self._sentences and self._sentences[0].name in _TIMELESS else 1
        return list(accumulate(stamps[::way], _own_or_near))[::way]

    def _each(self, name: str, convert: Callable[[_Sentence, int], Any]) -> int:
        """Convert the sentences of a name; return how many samples they gave."""
        before = len(self.contents.samples)
        for sentence, stamp_ns in zip(self._sentences, self._stamps, strict=True):
            if sentence.name == name:
                self._count(sentence, stamp_ns, convert)
        return len(self.contents.samples) - before

    def _count(
        self, sentence: _Sentence, stamp_ns: int | None, convert: Callable[..., Any]
    ) -> None:
        try:
            must(stamp_ns is not None, "no RMC or ZDA with its date: record one of them too")
            sample = convert(sentence.fields, stamp_ns)
            self.contents.samples += [] if sample is None else [sample]
        except Refused as why:
            self.contents.refused[sentence.name, str(why)] += 1
        except _DAMAGE:
            self.contents.refused[sentence.name, "a field of it is missing, or no number"] += 1

    def _take_sigmas(self, gst: Any, stamp_ns: int) -> None:
        sigmas = gst.stdLat, gst.stdLong, gst.stdAlt
        must(all(isinstance(sigma, float) and sigma > 0 for sigma in sigmas), "it has no sigmas")
        self._sigmas_m[stamp_ns] = sigmas

    def _position(self, gga: Any, stamp_ns: int) -> PositionSample:
        must(gga.quality in _STATUS, "no fix, or none of satellites")
        must(stamp_ns not in self._epochs, "another one of its epoch is used")
        self._epochs.add(stamp_ns)
        self._is_rtk |= gga.quality in _RTK
        place = _float(gga.lat), _float(gga.lon), _float(gga.alt)
        ellipsoidal = gga.sep != ""  # the geoid that the receiver itself has used
        offset_m = gga.sep if ellipsoidal else self._options.to_ellipsoid_m(MSL, self._path)
        covariance_n = np.diag(np.square(self._sigmas_m.get(stamp_ns, (0.0, 0.0, 0.0))))
        geodetic = math.radians(place[0]), math.radians(place[1]), place[2] + offset_m
        status, source = _STATUS[gga.quality], Source.RTK_POSITION
        return PositionSample(stamp_ns, source, status, *geodetic, covariance_n)

    def _heading(self, fields: Any, stamp_ns: int) -> HeadingSample:
        sigma_deg = 0.0  # unknown
        if fields.msgID == "STI":  # from the moving base to the rover
            must(fields.field_05 == "R", "ambiguities are not fixed")
            self._options.check_baseline(_float(fields.field_09))
            azimuth_deg = _float(fields.field_10)
        elif fields.msgID == "ASHR":
            must(fields.gnssQual, "the receiver marks it as not valid")
            azimuth_deg, sigma_deg = _float(fields.trueHdg), _float(fields.hdgAcc)
        else:
            must(getattr(fields, "mi", "A") == "A", "the receiver marks it as not valid")
            azimuth_deg = _float(fields.headt if fields.msgID == "THS" else fields.headingT)
        return self._options.heading(stamp_ns, azimuth_deg, sigma_deg)


def _own_or_near(near_ns: int | None, own_ns: int | None) -> int | None:
    return near_ns if own_ns is None else own_ns


def _float(value: object) -> float:
    """Return a field as a number; raise Refused for an empty one."""
    must(value not in {"", None}, "a field of it is empty")
    return float(value)  # type: ignore[arg-type]


def _sentence(name: str, fields: Any) -> _Sentence:
    """Return a sentence with its time; raise ValueError for an impossible date."""
    from pynmeagps import date2utc, time2utc  # noqa: PLC0415  as above

    day = getattr(fields, "date", None)
    moment = getattr(fields, "time", getattr(fields, "utctime", None))
    if name == "PSTI":
        moment, day = time2utc(fields.field_02), date2utc(fields.field_03)
    elif name == "ZDA" and fields.year:
        day = date(fields.year, fields.month, fields.day)
    if not isinstance(moment, time):
        return _Sentence(name, fields, None, is_dated=False)
    utc = datetime.combine(day or date(1970, 1, 1), moment, timezone.utc)
    return _Sentence(name, fields, round(utc.timestamp() * 1e6) * 1000, is_dated=bool(day))
