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
"""Read the subtitles (SRT) that DJI's cameras write beside a video: position, gimbal and lens.

The fields and their order differ by model and year. A cue begins at its number; its end time,
which may be impossible (00:04:60), is not read. There is no IMU: the aircraft's attitude is that
of ``F.PRY``, or level, below the camera.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    ImuSample,
    PositionSample,
    Source,
)
from tirgeo_ros.io.files.whole_files import read_text
from tirgeo_ros.io.logs.log_contents import (
    MSL,
    SECOND_NS,
    TAKEOFF,
    LogContents,
    LogOptions,
    WrittenTime,
    first_count,
    largest_group,
    written_time,
)

MOST_BYTES = 1 << 28
_N = r"\s*([-+]?\d+(?:\.\d+)?)"  # a number
_CUE = re.compile(r"^\ufeff?\d+[ \t]*\n(?=\d+:\d\d:\d\d[,.]\d+\s*-->|\d{4}[-.])", re.MULTILINE)
_BEGIN = re.compile(r"(\d{1,2}):(\d\d):(\d\d)[,.](\d{1,3})\s*-->")
#: Matrice 300: latitude first, third number a height of 0.0 M. All others: longitude first, third
#: number satellites or a height; Phantom 4 RTK writes RTK, not GPS, while it has an RTK solution.
_LAT_LON = (
    re.compile(rf"\[latitude\s*:{_N}\]\s*\[longt?itude\s*:{_N}\]"),
    re.compile(rf"GPS\s*\({_N},{_N},{_N}M\)"),
)
_LON_LAT = re.compile(rf"(?:GPS|RTK)\s*\({_N},{_N},{_N}\)")
#: Height above mean sea level, above an unknown datum, above the take-off.
_ABSOLUTE = re.compile(rf"abs_alt\s*:{_N}")
_PLAIN = re.compile(rf"\[altitude\s*:{_N}")
_RELATIVE = re.compile(rf"(?:rel_alt\s*:|BAROMETER\s*:|\bHb\s*:|\bH\s){_N}")
_GIMBAL_PRY = re.compile(rf"G\.PRY\s*\({_N}°?,{_N}°?,{_N}°?\)")
_GIMBAL_YPR = re.compile(rf"gb_yaw\s*:{_N}\s+gb_pitch\s*:{_N}\s+gb_roll\s*:{_N}")
_GIMBAL = re.compile(r"G\.PRY|gb_(?:yaw|pitch|roll)")
_AIRCRAFT_PRY = re.compile(rf"F\.PRY\s*\({_N}°?,{_N}°?,{_N}°?\)")
_FOCAL, _ZOOM = (re.compile(rf"{name}\s*:{_N}") for name in ("focal_len", "dzoom_ratio"))
#: What a whole number counts; one with a decimal point is in mm, or a ratio.
_FOCAL_PARTS, _ZOOM_PARTS = 10, 10_000
_CUE_NAME = "cue"
_LEVEL = (
    "the aircraft's attitude is not recorded: level, looking where the camera looks; only lever "
    "arms depend on it"
)


class _Cue(NamedTuple):
    """Hold a cue's text, its begin in the video (ns; None: not written) and its date."""

    text: str
    begin_ns: int | None
    written: WrittenTime | None


class Moment(NamedTuple):
    """Hold the time of a cue (UTC, and in the video), and the lens then; None: not written."""

    stamp_ns: int
    begin_ns: int | None
    focal_mm: float | None  # the zoom in it, for a picture of 36 mm by 24 mm with its diagonal
    zoom: float | None  # digital


def is_srt(head: bytes) -> bool:
    """Return whether a file's first bytes are numbered cues."""
    return bool(_CUE.match(head.decode("utf-8", "replace").replace("\r\n", "\n").lstrip()))


def read_srt(path: Path, options: LogOptions) -> LogContents:
    """Read DJI's subtitles. Raise LogError if a zone, a date or a datum is missing."""
    text = read_text(path, LogError, MOST_BYTES, damaged=True)
    return read_cues(text, path, options)[0]


def read_cues(text: str, path: Path, options: LogOptions) -> tuple[LogContents, list[Moment]]:
    """Return the contents of subtitles, and the moment of each cue; LogError as ``read_srt``."""
    if not _CUE.search(text):
        raise LogError(f"{path}: no subtitles in it: copy it from the card again")
    cues = [_cue(part) for part in _CUE.split(text) if part.strip()]
    contents, moments = LogContents(), []
    heights = _Heights(path, options)
    for cue, stamp_ns in zip(cues, _stamps_ns(cues, path, options), strict=True):
        contents.read[_CUE_NAME] += 1
        focal_mm, zoom = _number(_FOCAL, cue, _FOCAL_PARTS), _number(_ZOOM, cue, _ZOOM_PARTS)
        moments.append(Moment(stamp_ns, cue.begin_ns, focal_mm, zoom))
        place = _place(cue.text)
        height_m = None if place is None else heights.of(cue.text)
        if place is None or height_m is None:
            reason = "no position in it" if place is None else "no height in it"
            contents.refused[_CUE_NAME, reason] += 1
        else:
            source, status, unknown = Source.GPS_POSITION, FixStatus.SINGLE, np.zeros((3, 3))
            latitude_rad, longitude_rad = (math.radians(float(degrees)) for degrees in place)
            geodetic = latitude_rad, longitude_rad, height_m
            contents.samples.append(PositionSample(stamp_ns, source, status, *geodetic, unknown))
        attitudes = _attitudes(cue.text, stamp_ns)
        contents.samples += attitudes
        if not attitudes and _GIMBAL.search(cue.text):
            contents.refused[_CUE_NAME, "its gimbal angles cannot be read"] += 1
    if heights.used:
        contents.notes.append(f"heights: {', '.join(heights.used)}")
    if any(_GIMBAL.search(cue.text) and not _AIRCRAFT_PRY.search(cue.text) for cue in cues):
        contents.notes.append(_LEVEL)
    return contents, moments


class _Heights:
    """Find the heights of cues, and make them ellipsoidal."""

    def __init__(self, path: Path, options: LogOptions) -> None:
        self._path, self._options = path, options
        self.used: dict[str, None] = {}  # names of heights, each with its datum

    def of(self, text: str) -> float | None:
        """Return a cue's ellipsoidal height, or None; LogError if its datum is not known.

        Of two heights the one above the take-off is better, and is used if the take-off's height
        is given.
        """
        relative, absolute, plain = (p.search(text) for p in (_RELATIVE, _ABSOLUTE, _PLAIN))
        if relative and (self._options.takeoff_height_m is not None or not (absolute or plain)):
            return self._above(TAKEOFF, relative)
        if absolute:
            return self._above(MSL, absolute)
        if plain and not self._options.height:
            raise LogError(
                f"{self._path}: it does not say what its altitude is above: give --height sea "
                "(above sea level) or --height takeoff"
            )
        return self._above(self._options.height, plain) if plain else None

    def _above(self, datum: str, match: re.Match[str]) -> float:
        self.used[f"{match[0].strip(' :[').partition(':')[0].split()[0]} as {datum}"] = None
        return float(match[1]) + self._options.to_ellipsoid_m(datum, self._path)


def _cue(part: str) -> _Cue:
    begin_ns = None
    if begin := _BEGIN.match(part):
        hours, minutes, seconds, thousandths = begin.groups()
        whole_s = (int(hours) * 60 + int(minutes)) * 60 + int(seconds)
        begin_ns = whole_s * SECOND_NS + int(thousandths.ljust(3, "0")) * 1_000_000
    return _Cue(part, begin_ns, written_time(part))


def _stamps_ns(cues: list[_Cue], path: Path, options: LogOptions) -> Iterator[int]:
    """Yield the UTC of each cue: its date, else the video's start plus the time in the video.

    The start is that of the first date that does not contradict most others. Without any date the
    first cue is at ``start_ns``; raise LogError if that is not given.
    """
    begins = [options.utc_ns(c.written, path) - (c.begin_ns or 0) for c in cues if c.written]
    if begins:
        first, last = largest_group(begins)
        video_start_ns = next(begin for begin in begins if first <= begin <= last)
    elif options.start_ns is None:
        raise LogError(f"{path}: no date in it: give the UTC of its first cue as --start-time")
    else:
        video_start_ns = options.start_ns - first_count(cue.begin_ns or 0 for cue in cues)
    for cue in cues:
        if cue.written:
            yield options.utc_ns(cue.written, path)
        else:
            yield video_start_ns + (cue.begin_ns or 0)


def _place(text: str) -> tuple[str, str] | None:
    """Return latitude and longitude (deg) as they are written, or None."""
    for pattern in _LAT_LON:
        if match := pattern.search(text):
            return match[1], match[2]
    match = _LON_LAT.search(text)
    return (match[2], match[1]) if match else None


def _attitudes(text: str, stamp_ns: int) -> list[ImuSample | CameraAttitudeSample]:
    """Return the attitudes of aircraft and camera in NED, if the camera's angles are written."""
    if match := _GIMBAL_PRY.search(text):
        pitch, roll, yaw = match.groups()
    elif match := _GIMBAL_YPR.search(text):
        yaw, pitch, roll = match.groups()
    else:
        return []
    angles_rad = [math.radians(float(angle)) for angle in (roll, pitch, yaw)]
    if aircraft := _AIRCRAFT_PRY.search(text):
        body_rad = [math.radians(float(aircraft[place])) for place in (2, 1, 3)]
    else:  # a roll of 180 deg, which DJI writes at a pitch of -90, turns the yaw by 180
        behind = abs(angles_rad[0]) > math.pi / 2
        body_rad = [0.0, 0.0, angles_rad[2] + behind * math.pi]
    attitude = ImuSample.of_attitude(stamp_ns, quat_from_euler(*body_rad))
    return [attitude, CameraAttitudeSample(stamp_ns, quat_from_euler(*angles_rad))]


def _number(pattern: re.Pattern[str], cue: _Cue, parts: int) -> float | None:
    """Return a number of a cue, or None; a whole number counts so many parts."""
    match = pattern.search(cue.text)
    return float(match[1]) / (1 if "." in match[1] else parts) if match else None
