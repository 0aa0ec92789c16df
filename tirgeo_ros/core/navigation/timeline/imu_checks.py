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
"""Check that IMU samples continue each other, and whether the sensor is within its range.

A sample that does not continue the earlier ones is held. The next one shows whether the clock has
changed or only that sample is wrong. Gaps up to ``max_imu_gap_s`` are bridged; a longer gap
restarts the time line.

A sensor that is shaken beyond its range repeats the end of the range. This end is not configured:
it shows as a pile of readings that jump to the largest value so far, and outnumber those just
below it. Coarse steps, a long turn, a frozen sensor, rest or a single shock make no such pile.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.core.types.verdicts import Outcome

#: A stamp that goes back further means another clock or a bag that restarts, not disorder.
_CLOCK_JUMP_NS = 1_000_000_000
#: The clock has gone back once this many late samples are in order among themselves.
_BACK_NUMBER = 5
#: If a stamp is further ahead, samples are missing, even of the slowest IMU (50 Hz).
_HOLD_NS = 45_000_000
#: A live sensor's readings do not repeat in all digits. The sensor is frozen after this many
#: repeats over this time, but only if this many changes have shown before that it is live.
_FROZEN_NUMBER, _FROZEN_NS, _ALIVE_NUMBER = 5, 50_000_000, 50
#: Largest change from one sample to the next, vibration of some g included. More is saturation or
#: a wrong byte on the line.
_SPIKE_M_S2, _SPIKE_RAD_S = 80.0, 3.0

CHANNELS = tuple(f"{sensor} {axis}" for sensor in ("accelerometer", "gyroscope") for axis in "xyz")
_UNITS = ("m/s2",) * 3 + ("rad/s",) * 3
#: No IMU has a range below 2 g and 125 deg/s (19.6, 2.18); smaller readings are not examined.
_LEAST_M_S2, _LEAST_RAD_S = 18.0, 2.0
_LEAST_M_S2_2, _LEAST_RAD_S_2 = _LEAST_M_S2**2, _LEAST_RAD_S**2
#: Readings within this fraction of the extreme value count as equal to it.
_EQUAL_SHARE = 1e-4
#: Readings within this fraction below the extreme are just short of it. A reading that comes from
#: further below has jumped.
_SHORT_SHARE = 0.05
#: Hits within the window that make a pile. Of coarse readings (0.08 m/s2) under strong vibration
#: three are equal by chance in a flight of some minutes.
_PILE = 5
_WINDOW_NS = 1_000_000_000
#: An extreme that was not reached again for this long was an ordinary reading.
_FORGET_NS = 10_000_000_000
#: How long a warning stays: longer than the time between two diagnostics messages.
_WARN_NS = 5_000_000_000


class Checked(NamedTuple):
    """Hold the outcome of a check, and the samples to use; ``begins``: on a new time line."""

    outcome: Outcome
    reason: str = ""
    use: tuple[ImuSample, ...] = ()
    begins: bool = False


class ImuClock:
    """Follow the stamps and readings of the IMU."""

    def __init__(self, max_gap_s: float) -> None:
        self.configure(max_gap_s)
        self.newest_ns: int | None = None  # of the accepted samples
        self._force_b: list[float] = []
        self._rate_b: list[float] = []
        self._held: ImuSample | None = None  # newest sample that did not continue the others
        self._odd_number = 0
        self._changed_ns = 0
        self._repeated = 0
        self._alive = 0

    def configure(self, max_gap_s: float) -> None:
        """Take the longest gap to bridge, s, at the start or in flight."""
        self._max_gap_ns = round(max_gap_s * 1e9)
        self._hold_ns = min(_HOLD_NS, self._max_gap_ns)

    def check(self, sample: ImuSample) -> Checked:
        """Return the outcome of the next sample to arrive; its numbers must be finite."""
        newest_ns = self.newest_ns
        force_b, rate_b = sample.specific_force_b.tolist(), sample.angular_rate_b.tolist()
        if newest_ns is None:
            return self._unless_frozen(_continuous(sample), sample.stamp_ns, force_b, rate_b)
        ahead_ns = sample.stamp_ns - newest_ns
        if abs(ahead_ns) <= self._max_gap_ns and (
            math.dist(force_b, self._force_b) > _SPIKE_M_S2
            or math.dist(rate_b, self._rate_b) > _SPIKE_RAD_S
        ):
            return Checked(Outcome.GATED, "force or rate jumps more than an aircraft's can")
        checked = _continuous(sample)
        if not 0 < ahead_ns <= self._hold_ns:
            checked = self._discontinuous(sample, newest_ns, ahead_ns)
            if not checked.use:
                return checked
        return self._unless_frozen(checked, sample.stamp_ns, force_b, rate_b)

    def _discontinuous(self, sample: ImuSample, newest_ns: int, ahead_ns: int) -> Checked:
        """Judge a sample that does not closely follow the newest accepted one."""
        last = self._held
        if last is not None and (last.stamp_ns > newest_ns) is not (ahead_ns > 0):
            last = None  # a late sample proves nothing about one ahead
        goes_on = last is not None and 0 < sample.stamp_ns - last.stamp_ns <= self._max_gap_ns
        self._odd_number = self._odd_number + 1 if goes_on else 1
        self._held = sample
        both = (last, sample) if goes_on and last is not None else (sample,)
        ahead_s = ahead_ns * 1e-9
        if ahead_ns > 0:
            if not goes_on:
                reason = f"{ahead_s:.3f} s after the previous one: the next one decides"
                return Checked(Outcome.WAITING, reason)
            if both[0].stamp_ns - newest_ns <= self._max_gap_ns:
                return Checked(Outcome.USED, "", both)
            reason = f"no imu/data for {ahead_s:.3f} s"
            return Checked(Outcome.GAP, reason, both, begins=True)
        enough = 2 if -ahead_ns > _CLOCK_JUMP_NS else _BACK_NUMBER
        if -ahead_ns > self._max_gap_ns and self._odd_number >= enough:
            reason = f"imu/data went back by {-ahead_s:.3f} s"
            return Checked(Outcome.TIME_JUMP, reason, both, begins=True)
        return Checked(Outcome.OUT_OF_ORDER, "stamp not later than the previous one")

    def _unless_frozen(
        self, checked: Checked, stamp_ns: int, force_b: list[float], rate_b: list[float]
    ) -> Checked:
        """Return ``checked``, or REPEATED for a frozen sensor; store an accepted reading."""
        if force_b != self._force_b or rate_b != self._rate_b:
            self._changed_ns, self._repeated = stamp_ns, 0
            self._alive += 1
        else:
            self._repeated += 1
            long = stamp_ns - self._changed_ns >= _FROZEN_NS
            if self._alive >= _ALIVE_NUMBER and self._repeated >= _FROZEN_NUMBER and long:
                return Checked(Outcome.REPEATED, "imu/data repeats the same reading")
        self.newest_ns, self._force_b, self._rate_b = stamp_ns, force_b, rate_b
        self._held, self._odd_number = None, 0
        return checked


def in_body_axes(sample: ImuSample, rotation_bi: Array | None) -> ImuSample:
    """Return a sample rotated to body axes; the autopilot's attitude is in them already."""
    if rotation_bi is None:
        return sample
    force_b, rate_b = rotation_bi @ sample.specific_force_b, rotation_bi @ sample.angular_rate_b
    return replace(sample, specific_force_b=force_b, angular_rate_b=rate_b)


def _continuous(sample: ImuSample) -> Checked:
    """Return the outcome of a sample that continues the earlier ones: use it alone."""
    return tuple.__new__(Checked, (Outcome.USED, "", (sample,), False))


@dataclass(slots=True)
class _End:
    """Track a possible end of one channel's range; values are magnitudes."""

    level: float
    met_ns: int
    least: float  # smaller readings are not examined
    proven: bool = False  # whether there was a pile here
    jumped_ns: int | None = None  # newest hit that jumped from below
    hits_ns: deque[int] = field(default_factory=deque)  # within the window
    short_ns: deque[int] = field(default_factory=deque)

    def add(self, value: float, stamp_ns: int, before: float) -> int:
        """Return how many samples are clipped with this one: 0, 1, or all of a new pile."""
        short = self.level * (1 - _SHORT_SHARE)
        if value < self.level * (1 - _EQUAL_SHARE):
            if value > short:
                self.short_ns.append(stamp_ns)
            return 0
        self.met_ns, self.level = stamp_ns, max(value, self.level)
        self.hits_ns.append(stamp_ns)
        short = self.level * (1 - _SHORT_SHARE)
        if before < short:
            self.jumped_ns = stamp_ns
        if self.proven:
            return 1
        _forget(self.short_ns, stamp_ns)
        number = self.number()
        jumped = self.jumped_ns is not None and abs(stamp_ns - self.jumped_ns) <= _WINDOW_NS
        piled = jumped and number >= max(_PILE, len(self.short_ns))
        self.proven = piled and short >= self.least  # below, readings just short were skipped
        return number if self.proven else 0

    def number(self) -> int:
        """Return the number of hits in the second up to the newest hit."""
        _forget(self.hits_ns, self.met_ns)
        return len(self.hits_ns)


class Clipping:
    """Track the IMU's readings at full scale; a sample in the middle of the range costs 0.5 us."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}  # channel -> samples at full scale
        self.newest_ns: int | None = None
        self._ends: dict[tuple[int, bool], _End] = {}  # key: channel, whether positive
        self._before: ImuSample | None = None

    def add(self, sample: ImuSample) -> None:
        """Take the next sample to arrive; its numbers must be finite."""
        before, self._before = self._before, sample
        x, y, z = sample.specific_force_b.tolist()
        p, q, r = sample.angular_rate_b.tolist()
        if x * x + y * y + z * z < _LEAST_M_S2_2 and p * p + q * q + r * r < _LEAST_RAD_S_2:
            return  # nearly always
        if before is not None:
            self._look(sample.stamp_ns, [x, y, z], before.specific_force_b.tolist(), 0)
            self._look(sample.stamp_ns, [p, q, r], before.angular_rate_b.tolist(), 3)

    def active(self, now_ns: int) -> bool:
        """Return whether the IMU was at full scale within the last second."""
        return self.newest_ns is not None and abs(now_ns - self.newest_ns) <= _WINDOW_NS

    def warnings(self, now_ns: int) -> tuple[str, ...]:
        """Return which channels were clipped lately, at which value and how often."""
        lately = (
            (channel, end)
            for (channel, _), end in sorted(self._ends.items(), key=lambda item: item[0])
            if end.proven and abs(now_ns - end.met_ns) <= _WARN_NS
        )
        return tuple(
            f"imu/data: {CHANNELS[channel]} clipped at {end.level:.3g} {_UNITS[channel]} "
            f"({end.number()} samples in 1 s): vibration beyond its range"
            for channel, end in dict(lately).items()  # one end of each channel
        )

    def _look(self, stamp_ns: int, values: list[float], earlier: list[float], first: int) -> None:
        """Check the readings (3,) of a sensor; ``first`` is the index of its first channel."""
        if values == earlier:
            return  # no new reading: frozen, or slower than the topic
        least = _LEAST_RAD_S if first else _LEAST_M_S2
        for channel, (value, last) in enumerate(zip(values, earlier, strict=True), first):
            size = abs(value)
            if size < least:
                continue
            place = channel, value > 0
            end = self._ends.get(place)
            if (
                end is None
                or size > end.level * (1 + _EQUAL_SHARE)
                or abs(stamp_ns - end.met_ns) > _FORGET_NS
            ):
                end = self._ends[place] = _End(size, stamp_ns, least)
            number = end.add(size, stamp_ns, last if value > 0 else -last)
            if number:
                name = CHANNELS[channel]
                self.counts[name] = self.counts.get(name, 0) + number
                self.newest_ns = stamp_ns


def _forget(stamps_ns: deque[int], now_ns: int) -> None:
    """Drop the stamps outside the window."""
    while stamps_ns and abs(now_ns - stamps_ns[0]) > _WINDOW_NS:
        stamps_ns.popleft()
