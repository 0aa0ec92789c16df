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
epoch; without it the covariance is unknown. The date is that of the RMC, ZDA or PSTI nearest in
the log. HDT and THS have no time: theirs is that of the sentence before, or of the one after it
where the log begins with a heading.
"""

from __future__ import annotations

import bisect
import math
import re
from collections.abc import Callable
from datetime import datetime, time, timezone
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

_ANY = re.compile(rb"^\$(?:[A-Z]{2}(?:GGA|RMC|GST|HDT|THS|ZDA)|PASHR|PSTI),", re.MULTILINE)
_SENTENCE = re.compile(
    rb"\$(?:[A-Z]{2}(?:GGA|RMC|GST|HDT|THS|ZDA)|PASHR,\d|PSTI,03[56]),?[^$*\r\n]*(?:\*[0-9A-F]{2})?"
)
#: Quality of a GGA: RTK fixed, RTK float, differential, single, PPS.
_STATUS = {
    4: FixStatus.FIXED,
    **dict.fromkeys((2, 5), FixStatus.FLOAT),
    **dict.fromkeys((1, 3), FixStatus.SINGLE),
}
_RTK = (4, 5)
_VECTOR, _ANGLES = "PSTI,035", "PSTI,036"  # from the moving base to the rover
#: Sentences with a heading; those of one log repeat the same one, and the first is used.
_HEADINGS = (_ANGLES, "PASHR", "THS", "HDT")
#: What a field that is missing or no number raises; the checksum has eight bits.
_DAMAGE = (AttributeError, KeyError, TypeError, ValueError)
_DAY_NS = 86400 * SECOND_NS
#: As for RELPOSNED of u-blox.
_LENGTH_TOLERANCE_M = 0.1


def is_nmea(head: bytes) -> bool:
    """Return whether one of a file's first lines is a sentence that is read."""
    return bool(_ANY.search(head))


def read_nmea(path: Path, options: LogOptions) -> LogContents:
    """Read a log of NMEA, alone or among other data.

    Raise LogError if it cannot be read, or if heights are above an unknown sea level.
    """
    with reading(path, LogError):
        data = path.read_bytes()
    log = _NmeaLog(path, options)
    for match in _SENTENCE.finditer(data):
        log.take(match[0])
    log.finish()
    return log.contents


class _Sentence(NamedTuple):
    """Hold a sentence, its place in the log, its time of day (ns) and its date if it has them."""

    number: int
    fields: Any
    of_day_ns: Any  # int or None
    day_ns: Any  # Unix time of its midnight


class _NmeaLog:
    """Collect the sentences of a log, then date and convert them."""

    def __init__(self, path: Path, options: LogOptions) -> None:
        self.contents = LogContents()
        self._path, self._options = path, options
        self._sentences: dict[str, list[_Sentence]] = {}
        self._timed: list[_Sentence] = []
        self._number = 0
        self._heading_first = False

    def take(self, data: bytes) -> None:
        """Take a sentence with its checksum."""
        from pynmeagps import NMEAReader  # noqa: PLC0415  an extra
        from pynmeagps.exceptions import NMEAParseError, NMEATypeError  # noqa: PLC0415  as above

        faults = (Refused, NMEAParseError, NMEATypeError, *_DAMAGE)

        name = data[1:9].decode() if data.startswith(b"$PSTI") else data[1:6].decode()
        name = name if name.startswith("P") and name[1] in "AS" else name[2:]
        self.contents.read[name] += 1
        try:
            must(b"*" in data, "cut off")
            sentence = _sentence(self._number, NMEAReader.parse(data + b"\r\n"))
        except faults:
            self.contents.refused[name, "cut off, or its checksum is wrong"] += 1
            return
        self._heading_first |= not self._number and sentence.of_day_ns is None
        self._number += 1
        self._sentences.setdefault(name, []).append(sentence)
        if sentence.of_day_ns is not None:
            self._timed.append(sentence)

    def finish(self) -> None:
        """Convert the collected sentences to samples."""
        self._dated = [sentence for sentence in self._timed if sentence.day_ns is not None]
        self._sigmas_m: dict[int, tuple[float, ...]] = {}
        self._lengths_m: dict[int, float] = {}
        self._epochs: set[int] = set()
        self._each("GST", self._take_sigmas)
        self._each("GGA", self._position)
        self._each(_VECTOR, self._take_length)
        for name in _HEADINGS:
            if self._each(name, self._heading):
                self.contents.notes.append(f"headings are those of {name}")
                break
        if "GGA" in self._sentences:
            qualities = {
                getattr(sentence.fields, "quality", 0) for sentence in self._sentences["GGA"]
            }
            classify_receiver(self.contents, "GGA", is_rtk=bool(qualities & {*_RTK}))

    def _each(self, name: str, convert: Callable[[_Sentence, int], Any]) -> int:
        """Convert the sentences of a name; return how many samples they gave."""
        before = len(self.contents.samples)
        for sentence in self._sentences.get(name, ()):
            self._count(name, sentence, convert)
        return len(self.contents.samples) - before

    def _count(self, name: str, sentence: _Sentence, convert: Callable[..., Any]) -> None:
        try:
            sample = convert(sentence, self._stamp_ns(sentence))
            self.contents.samples += [] if sample is None else [sample]
        except Refused as why:
            self.contents.refused[name, str(why)] += 1
        except _DAMAGE:
            self.contents.refused[name, "a field of it is missing, or no number"] += 1

    def _stamp_ns(self, sentence: _Sentence) -> int:
        """Return the UTC (ns) of a sentence, by the date nearest to it in the log."""
        if sentence.of_day_ns is None:
            place = bisect.bisect(self._timed, sentence.number, key=lambda timed: timed.number)
            near = self._timed[place - 1 + self._heading_first :][:1] if place else self._timed[:1]
            must(near, "no sentence with a time beside it")
            sentence = near[0]
        place = bisect.bisect(self._dated, sentence.number, key=lambda dated: dated.number)
        steps = {
            (sentence.of_day_ns - d.of_day_ns + _DAY_NS // 2) % _DAY_NS - _DAY_NS // 2: d
            for d in self._dated[max(place - 1, 0) : place + 1]
        }
        must(steps, "no RMC or ZDA with its date: record one of them too")
        step_ns = min(steps, key=abs)
        return int(steps[step_ns].day_ns + steps[step_ns].of_day_ns + step_ns)

    def _take_sigmas(self, sentence: _Sentence, stamp_ns: int) -> None:
        sigmas = (sentence.fields.stdLat, sentence.fields.stdLong, sentence.fields.stdAlt)
        must(all(isinstance(sigma, float) and sigma > 0 for sigma in sigmas), "it has no sigmas")
        self._sigmas_m[stamp_ns] = sigmas

    def _take_length(self, sentence: _Sentence, stamp_ns: int) -> None:
        self._lengths_m[stamp_ns] = _float(sentence.fields.field_09)

    def _position(self, sentence: _Sentence, stamp_ns: int) -> PositionSample:
        gga = sentence.fields
        must(gga.quality in _STATUS, "no fix, or none of satellites")
        must(stamp_ns not in self._epochs, "another one of its epoch is used")
        self._epochs.add(stamp_ns)
        place = _float(gga.lat), _float(gga.lon), _float(gga.alt)
        ellipsoidal = gga.sep != ""  # the geoid that the receiver itself has used
        offset_m = gga.sep if ellipsoidal else self._options.to_ellipsoid_m(MSL, self._path)
        covariance_n = np.diag(np.square(self._sigmas_m.get(stamp_ns, (0.0, 0.0, 0.0))))
        geodetic = math.radians(place[0]), math.radians(place[1]), place[2] + offset_m
        status, source = _STATUS[gga.quality], Source.RTK_POSITION
        return PositionSample(stamp_ns, source, status, *geodetic, covariance_n)

    def _heading(self, sentence: _Sentence, stamp_ns: int) -> HeadingSample:
        azimuth_deg, sigma_deg = _azimuth_deg(sentence.fields)
        length_m, baseline_m = self._lengths_m.get(stamp_ns), self._options.baseline_m
        near = (
            length_m is None
            or baseline_m is None
            or abs(length_m - baseline_m) <= _LENGTH_TOLERANCE_M
        )
        must(near, f"its length is more than {_LENGTH_TOLERANCE_M:g} m from the baseline's")
        azimuth_rad = math.radians(azimuth_deg) + self._options.rover_first * math.pi
        heading_rad = (azimuth_rad - self._options.baseline_rad) % math.tau
        return HeadingSample(stamp_ns, heading_rad, math.radians(sigma_deg) ** 2)


def _azimuth_deg(fields: Any) -> tuple[float, float]:
    """Return azimuth and sigma (0: unknown) of a heading, deg; raise Refused if it has none."""
    if fields.msgID == "STI":
        must(fields.field_07 == "R", "ambiguities are not fixed")
        return _float(fields.field_04), 0.0
    if fields.msgID == "ASHR":
        must(fields.gnssQual, "the receiver marks it as not valid")
        return _float(fields.trueHdg), _float(fields.hdgAcc)
    must(getattr(fields, "mi", "A") == "A", "the receiver marks it as not valid")
    return _float(fields.headt if fields.msgID == "THS" else fields.headingT), 0.0


def _float(value: object) -> float:
    """Return a field as a number; raise Refused for an empty one."""
    must(value not in {"", None}, "a field of it is empty")
    return float(value)  # type: ignore[arg-type]


def _sentence(number: int, fields: Any) -> _Sentence:
    """Return a sentence with its time and date; raise ValueError for an impossible one."""
    moment: Any
    date: Any
    if fields.msgID == "STI":
        moment = datetime.strptime(fields.field_02[:6], "%H%M%S").time()  # noqa: DTZ007  UTC
        fraction_ns = round(float(f"0{fields.field_02[6:]}") * SECOND_NS)
        date = datetime.strptime(fields.field_03, "%d%m%y").date()  # noqa: DTZ007  UTC
    else:
        moment = getattr(fields, "time", getattr(fields, "utctime", None))
        fraction_ns, date = 0, getattr(fields, "date", None)
        if fields.msgID == "ZDA" and fields.year:
            date = datetime(fields.year, fields.month, fields.day, tzinfo=timezone.utc).date()
    of_day_ns = None
    if isinstance(moment, time):
        whole_s = (moment.hour * 60 + moment.minute) * 60 + moment.second
        of_day_ns = whole_s * SECOND_NS + moment.microsecond * 1000 + fraction_ns
    day_ns = (date.toordinal() - _EPOCH) * _DAY_NS if date and of_day_ns is not None else None
    return _Sentence(number, fields, of_day_ns, day_ns)


_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc).toordinal()
