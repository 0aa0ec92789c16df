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
"""Read u-blox UBX: NAV-PVT to position and velocity, NAV-RELPOSNED to the heading.

Fields as in u-blox's F9 interface description, decoded by pyubx2. hAcc is the root of the sum of
both horizontal variances (NAV-COV of the same epochs has them), so each axis gets half of its
square. RELPOSNED points from the moving base to the rover, and has no date: its time is that of a
NAV-PVT near it in the log, plus the difference of their times of week.
"""

from __future__ import annotations

import bisect
import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.io.files.whole_files import reading
from tirgeo_ros.io.logs.log_contents import (
    SECOND_NS,
    WEEK_NS,
    LogContents,
    LogOptions,
    Refused,
    classify_receiver,
    must,
    written_time,
)
from tirgeo_ros.io.messages import SensedSample

PVT, RELPOSNED, HPPOSLLH = "NAV-PVT", "NAV-RELPOSNED", "NAV-HPPOSLLH"
_KEYS = {b"\x01\x07": PVT, b"\x01\x3c": RELPOSNED, b"\x01\x14": HPPOSLLH}
#: Lengths of their payloads: those of older receivers first.
_LENGTHS = {PVT: (84, 92), RELPOSNED: (40, 64), HPPOSLLH: (36,)}
_AROUND = 8  # bytes of a frame in addition to its payload
_STATUS = {2: FixStatus.FIXED, 1: FixStatus.FLOAT}
_WEEK_MS = WEEK_NS // 1_000_000
_FIX_TYPES = (3, 4)  # 3D; GNSS and dead reckoning. 2D has no height, 1 is dead reckoning alone
_SYNC = b"\xb5\x62"
_HEAD, _SUM = 6, 2  # bytes before and behind the payload


def read_ubx(path: Path, options: LogOptions) -> LogContents:
    """Read a log of UBX, alone or among NMEA and RTCM. Raise LogError if it cannot be read."""
    log = _UbxLog(options)
    with reading(path, LogError):
        data = path.read_bytes()
    for frame in ubx_frames(data):
        log.take(frame)
    log.finish()
    return log.contents


class _Dated(NamedTuple):
    """Hold a solution with a date: its place in the log, time of week (ms) and UTC (ns)."""

    number: int
    of_week_ms: int
    stamp_ns: int


class _UbxLog:
    """Collect the messages of a log; a position waits for its high-precision part."""

    def __init__(self, options: LogOptions) -> None:
        self.contents = LogContents()
        self._options = options
        self._messages: dict[str, list[tuple[int, Any]]] = {name: [] for name in _KEYS.values()}
        self._dated: list[_Dated] = []

    def take(self, frame: bytes | None) -> None:
        """Take a frame; None stands for a damaged one."""
        from pyubx2 import UBX_MSGIDS, UBXReader  # noqa: PLC0415  an extra

        if frame is None:
            self.contents.refused["frame", "cut off, or its checksum is wrong"] += 1
            return
        unknown = f"class {frame[2]:02x} id {frame[3]:02x}"
        name = _KEYS.get(frame[2:4]) or str(UBX_MSGIDS.get(frame[2:4], unknown))
        self.contents.read[name] += 1
        if name not in _LENGTHS:
            return
        if len(frame) - _AROUND in _LENGTHS[name]:  # at another length pyubx2 leaves fields out
            number = self.contents.read.total()  # its place in the log
            self._messages[name].append((number, UBXReader.parse(frame)))
        else:
            self.contents.refused[name, "its length is not known"] += 1

    def finish(self) -> None:
        """Convert the collected messages to samples."""
        precise = defaultdict(list)  # by time of week, which may repeat in a joined log
        for number, message in self._messages[HPPOSLLH]:
            if not getattr(message, "invalidLlh", 0):
                precise[message.iTOW].append((number, message))
        for number, message in self._messages[PVT]:
            near = precise.get(message.iTOW, [(number, message)])
            _, place = min(near, key=lambda record: abs(record[0] - number))
            self._count(PVT, self._solution, number, message, place)
        for number, message in self._messages[RELPOSNED]:
            self._count(RELPOSNED, self._heading, number, message)
        if self._messages[PVT]:
            is_rtk = any(message.carrSoln for _, message in self._messages[PVT])
            classify_receiver(self.contents, PVT, is_rtk=is_rtk)

    def _count(self, name: str, convert: Any, *record: Any) -> None:
        try:
            self.contents.samples += convert(*record)
        except Refused as why:
            self.contents.refused[name, str(why)] += 1

    def _solution(self, number: int, pvt: Any, place: Any) -> list[SensedSample]:
        stamp_ns = _stamp_ns(pvt)
        self._dated.append(_Dated(number, pvt.iTOW, stamp_ns))
        must(pvt.gnssFixOk and pvt.fixType in _FIX_TYPES, "no 3D fix")
        must(not getattr(pvt, "invalidLlh", 0), "latitude, longitude and height are not valid")
        status = _STATUS.get(pvt.carrSoln, FixStatus.FLOAT if pvt.diffSoln else FixStatus.SINGLE)
        horizontal, vertical = 0.5 * (place.hAcc * 1e-3) ** 2, (place.vAcc * 1e-3) ** 2
        geodetic = math.radians(place.lat), math.radians(place.lon), place.height * 1e-3
        covariance_n = np.diag([horizontal, horizontal, vertical])
        source = Source.RTK_POSITION
        position = PositionSample(stamp_ns, source, status, *geodetic, covariance_n)
        velocity_n = np.array([pvt.velN, pvt.velE, pvt.velD]) * 1e-3
        covariance_n = np.eye(3) * (pvt.sAcc * 1e-3) ** 2
        velocity = VelocitySample(stamp_ns, Source.RTK_VELOCITY, velocity_n, covariance_n)
        return [position, velocity]

    def _heading(self, number: int, vector: Any) -> list[SensedSample]:
        whole = vector.version == 1 and vector.length == _LENGTHS[RELPOSNED][-1]
        must(whole, f"version {vector.version} of {vector.length} bytes has no heading")
        valid = vector.relPosValid and vector.relPosHeadingValid
        must(valid, "the receiver marks it as not valid")
        must(vector.isMoving, "not of a moving base: the bearing from a base on the ground")
        must(vector.carrSoln == 2, "ambiguities are not fixed")
        if self._options.baseline_m is None:
            raise Refused(
                "the baseline's length is not known: set aircraft.rtk_antenna_m and "
                "aircraft.second_antenna_m, or give --baseline"
            )
        self._options.check_baseline(vector.relPosLength * 1e-2)
        stamp_ns = self._stamp_near_ns(number, vector.iTOW)
        return [self._options.heading(stamp_ns, vector.relPosHeading, vector.accHeading)]

    def _stamp_near_ns(self, number: int, of_week_ms: int) -> int:
        """Return the UTC (ns) of a time of week, by the solution before or after it in the log.

        Times of week begin again each week, and a log may have more vectors than solutions.
        """
        place = bisect.bisect(self._dated, number, key=lambda dated: dated.number)
        half_ms = _WEEK_MS // 2
        by_difference_ms = {
            (of_week_ms - dated.of_week_ms + half_ms) % _WEEK_MS - half_ms: dated
            for dated in self._dated[max(place - 1, 0) : place + 1]
        }
        nearest_ms = min(by_difference_ms, key=abs, default=_WEEK_MS)
        must(
            abs(nearest_ms) < 60_000,
            "no NAV-PVT with a date within a minute of it: record both",
        )
        return by_difference_ms[nearest_ms].stamp_ns + nearest_ms * 1_000_000


def _stamp_ns(pvt: Any) -> int:
    """Return the UTC of a NAV-PVT in ns; its fraction of a second may be negative."""
    must(pvt.validDate and pvt.validTime, "date or time is not valid")
    must(pvt.fullyResolved, "UTC is not resolved to the second")
    text = f"{pvt.year:04}-{pvt.month}-{pvt.day} {pvt.hour}:{pvt.min:02}:{pvt.second:02}"
    time = written_time(text)
    if time is None or abs(pvt.nano) > SECOND_NS:
        raise Refused("date or time is impossible")
    return time.local_ns + int(pvt.nano)


def ubx_frames(data: bytes) -> Iterator[bytes | None]:
    """Yield the frames in order; None for sync characters without a whole frame behind them.

    A frame is two sync characters, class, id, length (little-endian), payload and two bytes of an
    8-bit Fletcher sum. Whatever stands between frames is skipped: NMEA, RTCM, comments. A frame
    counts only if its sum is right. After a wrong one the search goes on behind its sync
    characters, so that a damaged length costs one frame (pyubx2's reader would trust the length).
    """
    place = data.find(_SYNC)
    while place >= 0:
        end = place + _HEAD + int.from_bytes(data[place + 4 : place + 6], "little") + _SUM
        whole = end <= len(data) and _sum(data[place + 2 : end - _SUM]) == data[end - _SUM : end]
        yield data[place:end] if whole else None
        place = data.find(_SYNC, end if whole else place + len(_SYNC))


def has_solutions(data: bytes) -> bool:
    """Return whether a log has the beginning of a message that is read."""
    return any(_SYNC + key in data for key in _KEYS)


def is_ubx(head: bytes) -> bool:
    """Return whether a whole frame is in the first bytes of a file."""
    return any(ubx_frames(head))


def _sum(data: bytes) -> bytes:
    """Return the two bytes of the 8-bit Fletcher sum (RFC 1145)."""
    values = np.frombuffer(data, np.uint8).astype(np.int64)
    first = int(values.sum())
    second = int(values @ np.arange(len(values), 0, -1))
    return bytes([first & 255, second & 255])
