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
"""Check the aids' stamps against the IMU's, and find measurements that are repeated.

An aid's clock may differ from the IMU's, so only the advance of its stamps measures a silence.
"""

from __future__ import annotations

from collections import deque
from enum import Enum
from itertools import pairwise

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid import Aiding
from tirgeo_ros.core.navigation.aiding.aid_status import PLACE
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: Fewer aiding samples than this without an IMU sample are no silence: they may be one burst.
_LEAST_AIDS = 5
#: Longest silence assumed before the first aid; a larger difference is an offset of the clocks.
_LONGEST_LEAD_NS = 500_000_000
#: Offsets observed longer ago than this are not reported.
_AGE_NS = 2_000_000_000
#: A shorter lag is reported as a latency, a longer one as another clock.
_LONGEST_DELAY_NS = 5_000_000_000
#: GPS time minus UTC, the leap seconds since 1980 (unchanged since 2017), and a tolerance.
_GPS_LESS_UTC_NS, _LEAP_NS = 18_000_000_000, 1_000_000_000
#: A value that repeats after longer than this is a new one (a test bench, an aircraft at rest).
_LONGEST_NS = 900_000_000
#: Within this share of the receiver's interval, an equal heading is the same measurement.
_INTERVAL_SHARE = 0.95


class AidClocks:
    """Follow the stamps of IMU and aids; ``imu_ns`` is the IMU's newest, None before the first."""

    def __init__(self, config: EkfConfig, imu_ns: int | None) -> None:
        self.configure(config)
        self.imu_ns = imu_ns
        self.aid_ns = 0  # of the newest aid to arrive
        self._aids = self._length_ns = 0  # since the newest IMU sample
        self._begun: dict[Source, tuple[int, int]] = {}  # first stamp, its lead over the IMU
        self._offsets: dict[Source, tuple[int, int]] = {}  # offset and IMU time

    def configure(self, config: EkfConfig) -> None:
        """Take the parameters, at the start or in flight."""
        self._max_delay_s = config.max_delay_s
        self._timeout_ns = config.trust.aid_timeout_s * 1e9

    @property
    def now_ns(self) -> int:
        """Return the newest IMU stamp plus its silence; before the first, the newest aid's."""
        return self.aid_ns if self.imu_ns is None else self.imu_ns + self.silence_ns

    @property
    def silence_ns(self) -> int:
        """Return for how long the IMU has been silent; 0 within ``trust.aid_timeout_s``."""
        silent = self._aids >= _LEAST_AIDS and self._length_ns > self._timeout_ns
        return self._length_ns if silent else 0

    def take_imu(self, stamp_ns: int) -> None:
        """Take the stamp of an IMU sample; it ends a silence."""
        self.imu_ns = stamp_ns
        if self._aids:
            self._aids = self._length_ns = 0
            self._begun.clear()

    def take_aid(self, source: Source, stamp_ns: int) -> None:
        """Take the stamp of an aiding sample."""
        self.aid_ns = stamp_ns
        self._aids += 1
        begun = self._begun.get(source)
        if begun is None:
            ahead_ns = 0 if self.imu_ns is None else max(stamp_ns - self.imu_ns, 0)
            begun = self._begun[source] = stamp_ns, min(ahead_ns, _LONGEST_LEAD_NS)
        self._length_ns = max(self._length_ns, stamp_ns - begun[0] + begun[1])

    def judge(self, verdict: Verdict, stamp_ns: int) -> None:
        """Take the verdict on an aiding sample: a refusal for its stamp shows an offset."""
        imu_ns = self.imu_ns
        if verdict.outcome not in {Outcome.TOO_NEW, Outcome.TOO_OLD} or imu_ns is None:
            self._offsets.pop(verdict.source, None)
        elif stamp_ns > imu_ns or stamp_ns < imu_ns - self._max_delay_s * 1e9:
            self._offsets[verdict.source] = stamp_ns - imu_ns, imu_ns

    @property
    def offsets(self) -> str:
        """Return the topics whose stamps are refused, with the first one's offset and cause."""
        imu_ns = self.imu_ns
        if not self._offsets or imu_ns is None:
            return ""
        recent = {s: off for s, (off, at) in self._offsets.items() if imu_ns - at <= _AGE_NS}
        if not recent:
            return ""
        first, *others = sorted(recent, key=PLACE.__getitem__)
        offset_ns = recent[first]
        off = f"{abs(offset_ns) * 1e-9:.1f} s {'ahead of' if offset_ns > 0 else 'behind'} imu/data"
        if -_LONGEST_DELAY_NS < offset_ns < 0:
            why = f"more than max_delay_s, {self._max_delay_s:g} s"
        else:
            why = "do both use the same clock?"
            if abs(abs(offset_ns) - _GPS_LESS_UTC_NS) <= _LEAP_NS:
                why += " (GPS time is 18 s ahead of UTC)"
        too = f"; {', '.join(source.topic for source in others)} too" if others else ""
        return f"{first.topic} is {off}: {why}{too}"


class Same(Enum):
    """Name what a measurement has in common with the previous one of its source."""

    NOTHING = 0
    VALUE = 1  # the value repeats in a new measurement, unless the receiver is frozen
    MEASUREMENT = 2  # the same measurement, sent again


class DuplicateDetector:
    """Compare each measurement with the previous one of its source.

    Two measured positions or velocities never agree in all digits. A position that repeats with a
    worse fix status is new, for its status is news; with a better status it is the same
    measurement. Headings in whole degrees do repeat. The receiver's interval is therefore learned
    from the changes of its positions.
    """

    def __init__(self) -> None:
        self._newest: dict[Source, tuple[int, tuple[float, ...]]] = {}
        self._status: dict[Source, FixStatus] = {}
        self._changes_ns: deque[int] = deque(maxlen=8)  # of RTK positions

    def compared(self, sample: Aiding) -> Same:
        """Return what a sample has in common with the previous one of its source."""
        source, worse, longest_ns = sample.source, False, float(_LONGEST_NS)
        if isinstance(sample, PositionSample):
            value: tuple[float, ...] = sample.latitude_rad, sample.longitude_rad, sample.height_m
            worse = sample.status < self._status.get(source, sample.status)
            self._status[source] = sample.status
        elif isinstance(sample, VelocitySample):
            value = tuple(sample.velocity_n.tolist())
        elif isinstance(sample, HeadingSample):
            value, longest_ns = (sample.heading_rad,), self._interval_ns()
        else:
            return Same.NOTHING  # rounded readings of other sensors do repeat
        newest, same = self._newest.get(source), Same.NOTHING
        if not worse and newest is not None and newest[1] == value:
            if 0 < abs(sample.stamp_ns - newest[0]) < longest_ns:
                return Same.MEASUREMENT
            same = Same.VALUE
        elif source is Source.RTK_POSITION:
            self._changes_ns.append(sample.stamp_ns)
        self._newest[source] = sample.stamp_ns, value
        return same

    def _interval_ns(self) -> float:
        """Return the time within which an equal heading counts as the same measurement."""
        steps = [b - a for a, b in pairwise(sorted(self._changes_ns))]
        usual_ns = sorted(steps)[len(steps) // 2] if steps else _LONGEST_NS
        return min(_INTERVAL_SHARE * usual_ns, _LONGEST_NS)
