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
"""Convert the aircraft's clock to this computer's clock.

The aircraft counts milliseconds from power-up. A message arrives later than it was sent: by the
smallest latency of the link, plus the delays of queues, bursts and scheduling. So ``arrival -
aircraft time`` lies on or above a line. The highest line below all points (``LowerEnvelope``) is
the offset of the two clocks, with their drift, plus the smallest latency. One side alone cannot
measure that latency: the delay of each source is a parameter.

A counter that truncates to its tick makes stamps early by half a tick in the mean. This does not
bias the line, because the smallest differences are those of messages sent at a tick.

Firmware before 3.3 may count ticks of 2.5 ms in the same field. If they are taken for
milliseconds, the points leave the line by 0.6 s a second.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from typing import NamedTuple

from tirgeo_ros.core.config.dji_parameters import DjiClockConfig

Point = tuple[float, float]

# The counter.

_SECOND_NS = 1_000_000_000
#: Ticks of the aircraft's counters. Hard sync counts long ticks, and so may the broadcast of
#: firmware before 3.3, in the field that counts milliseconds in newer firmware.
MILLISECOND_NS, LONG_TICK_NS = 1_000_000, 2_500_000
#: The time after a tick that a message states cannot be longer than this.
LONGEST_EXTRA_NS = 10_000_000

# The line below the arrivals.

#: The time from which the drift is learned is divided into this many bins; each keeps its lowest
#: point.
_BINS = 64
#: The drift is learned over three windows, limited to this range.
_DRIFT_NS = 30e9, 300e9
#: Prior sigma of a change of the slope, as a share of the largest drift, and sigma of a minimum.
#: The slope of a stretch longer than their quotient gets more weight than the old slope.
_USUAL_DRIFT, _MINIMUM_NS = 0.3, 0.2e6
_INFINITY = float("inf")

# Steps of a clock, and the published offset.

#: A message above the line by more than this may show a clock step: no queue stays filled and
#: delays messages for longer.
_STEP_NS = 250_000_000
#: A clock step is accepted after this many messages in a row above the line by more than _STEP_NS,
#: over this time by the counter and by arrival. If one of them is less late than the first by more
#: than _DRAINS_NS, the run begins again: in a queue that drains, each message is less late than
#: the one before.
_STEP_NUMBER, _STEP_LASTS_NS, _DRAINS_NS = 5, 500_000_000, 20_000_000
#: A message may be overtaken by messages that were sent up to this much later.
_LATE_NS = _SECOND_NS
#: The offset is settled after this many messages and this time, once it is within
#: _SETTLED_WITHIN_NS of the line. It is unsettled again when it is more than _UNSETTLED_NS off the
#: line.
_SETTLED_NUMBER, _SETTLED_AFTER_NS = 20, 3 * _SECOND_NS
_SETTLED_WITHIN_NS, _UNSETTLED_NS = 100_000, 2_000_000
#: Rate at which the published offset approaches the line, as a share of elapsed time: _HASTE while
#: not settled, else _SLEW in addition to the largest drift.
_HASTE, _SLEW = 0.5, 200e-6


def is_long(passed: float, counted: float) -> bool:
    """Return whether a count taken for milliseconds is one of 2.5 ms, by the time passed.

    Delays may change the time by a tenth.
    """
    return abs(passed - counted * LONG_TICK_NS / MILLISECOND_NS) <= 0.1 * passed


class RunningCounter:
    """Unwrap a counter: choose the value nearest to the newest one, within half a turn."""

    def __init__(self, tick_ns: int, bits: int) -> None:
        self.tick_ns = tick_ns
        self._mask = (1 << bits) - 1
        self._half = 1 << (bits - 1)
        self._newest = 0
        self._newest_ns = 0
        self.wraps = 0

    def begin(self, ticks: int) -> int:
        """Start at a value of the counter; return its time in nanoseconds."""
        self._newest = ticks & self._mask
        self._newest_ns = self._newest * self.tick_ns
        return self._newest_ns

    def time_ns(self, ticks: int) -> int:
        """Return the time of a value in nanoseconds: earlier than the newest if it went back."""
        ahead = (ticks - self._newest) & self._mask
        if ahead > self._half:
            ahead -= self._mask + 1
        return self._newest_ns + ahead * self.tick_ns

    def go_on(self, ticks: int, time_ns: int) -> None:
        """Take a value as the newest, with its time from the method ``time_ns``."""
        ticks &= self._mask
        if ticks < self._newest and time_ns > self._newest_ns:
            self.wraps += 1
        self._newest, self._newest_ns = ticks, time_ns


class LowerEnvelope:
    """Track the line below the points of the last window; x and y in nanoseconds.

    ``x`` is a time of one clock, ``y`` the arrival by another clock minus ``x``. The smallest
    values of ``y`` lie on a line, whose slope is the drift between the two clocks; larger values
    have delays. The tracked line has the learned slope and is the highest with no point of the
    window below it. The slope is that of the lower convex hull's edge over the middle of a longer
    time (Moon, Skelley, Towsley 1999, and Zhang, Liu, Xia 2002, use it as the skew of two clocks).
    With the slope, a minimum stays valid for the whole window. Without it, a windowed minimum lags
    by drift times window, and jumps when it leaves the window.

    ``max_drift`` bounds the slope in both directions. A point costs about a microsecond; once per
    bin the ``_BINS`` lowest points are used again.
    """

    def __init__(self, window_ns: float, max_drift: float) -> None:
        self._window_ns = window_ns
        self._max_drift = max_drift
        shortest, longest = _DRIFT_NS
        self._memory_ns = max(shortest, window_ns, min(3 * window_ns, longest))
        self._width_ns = self._memory_ns / _BINS
        self.drift = self._drift_before = 0.0  # slope of the line
        self.base = 0.0  # the line is ``base + drift * x``
        self._bins: deque[Point] = deque()  # the lowest point of each closed bin
        self._bin_end = 0.0
        self._lowest_key, self._lowest = _INFINITY, (0.0, 0.0)  # of the open bin

    def begin(self, x: float, y: float) -> None:
        """Forget all points; put the line through this point, with the slope learned so far."""
        self._bins.clear()
        self._drift_before = self.drift
        self.base = y - self.drift * x
        self._open(x)

    def add(self, x: float, y: float) -> None:
        """Take a point. ``x`` may go back a little, within the width of one bin."""
        if x >= self._bin_end:
            self._close(x)
        key = y - self.drift * x
        if key < self._lowest_key:
            self._lowest_key, self._lowest = key, (x, y)
            self.base = min(self.base, key)

    def _open(self, x: float) -> None:
        """Begin a bin."""
        self._bin_end = x + self._width_ns
        self._lowest_key, self._lowest = _INFINITY, (x, 0.0)

    def _close(self, x: float) -> None:
        """Close the open bin; learn the slope and compute the line again."""
        is_used = self._lowest_key < _INFINITY
        if is_used and (not self._bins or self._lowest[0] > self._bins[-1][0]):
            self._bins.append(self._lowest)
        while self._bins and self._bins[0][0] < x - self._memory_ns:
            self._bins.popleft()
        span = self._bins[-1][0] - self._bins[0][0] if self._bins else 0.0
        if span > 0.0:
            slope = middle_slope([*self._bins])
            slope = min(max(slope, -self._max_drift), self._max_drift)
            prior, measured = (_USUAL_DRIFT * self._max_drift * span) ** 2, _MINIMUM_NS**2
            trust = prior / (prior + measured)
            self.drift = self._drift_before + trust * (slope - self._drift_before)
        begun = x - self._window_ns
        keys = [low_y - self.drift * low_x for low_x, low_y in self._bins if low_x >= begun]
        self.base = min(keys, default=self.base)
        self._open(x)


def middle_slope(points: list[Point]) -> float:
    """Return the slope of the lower hull's edge over the middle.

    ``points``: at least two, by increasing x.
    """
    hull: list[Point] = []
    for point in points:
        while len(hull) > 1 and _is_above(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    middle = (points[0][0] + points[-1][0]) / 2
    (x0, y0), (x1, y1) = next(edge for edge in pairwise(hull) if edge[1][0] >= middle)
    return (y1 - y0) / (x1 - x0)


def _is_above(first: Point, middle: Point, last: Point) -> bool:
    """Return whether the middle point is on or above the line from the first to the last."""
    (x0, y0), (x1, y1), (x2, y2) = first, middle, last
    return (y1 - y0) * (x2 - x0) >= (y2 - y0) * (x1 - x0)


class _Above(NamedTuple):
    """Hold a run of messages far above the line, due to a draining queue or a new offset."""

    number: int = -1  # of the run's newest message
    length: int = 0
    first: float = 0.0  # height of the first message above the line, nanoseconds
    least: float = 0.0  # smallest height
    aircraft_ns: int = 0  # of the first message
    arrival_ns: int = 0
    is_counter: bool = False  # True if the counter jumped, False if the host's clock did


class AircraftClock:
    """Convert the values of one aircraft counter to stamps on the host's clock.

    Stamps of increasing counts never decrease, and the same count gets the same stamp. Once
    settled, a step of stamps differs from the counter's step by at most 2 ``max_drift_ppm`` + 200
    ppm. Before that, and whenever the line is more than 2 ms off, it may differ by half of the
    step.

    When the counter restarts or the host's clock is set, the stamps follow: at once if this is
    certain (check sums protect the counts), after half a second if a queue could be the cause.
    Each counter needs its own AircraftClock.

    If a counter shows ticks of 2.5 ms instead of 1 ms before it has settled, it is read so:
    stamps fall behind by up to 1 s in the first 1.7 s, then they continue at their right times.
    """

    def __init__(
        self, config: DjiClockConfig, tick_ns: int = MILLISECOND_NS, bits: int = 32
    ) -> None:
        self._max_drift = config.max_drift_ppm * 1e-6
        self._slew = self._max_drift + _SLEW
        self.line = LowerEnvelope(config.window_s * 1e9, self._max_drift)
        self._counter = RunningCounter(tick_ns, bits)
        self._may_be_long = tick_ns == MILLISECOND_NS
        self._number = self._began_number = 0
        self._origin_ns = self._newest_ns = 0  # in counter time
        self._offset_ns = 0  # from counter time to host time, at the origin
        self._published = 0.0  # offset of the newest message, in addition to _offset_ns
        self._settled = False
        self._counts = {"resets": 0, "host steps": 0}
        self._above = _Above()

    def stamp_ns(self, ticks: int, arrival_ns: int, extra_ns: int = 0) -> int:
        """Return the host time (ns) at which a message arrives if its latency is the smallest.

        ``ticks`` is the counter's value, ``extra_ns`` the time after that tick if the aircraft
        sends it, ``arrival_ns`` the host's time of the message's last byte.
        """
        self._number += 1
        if not 0 <= extra_ns <= LONGEST_EXTRA_NS:
            extra_ns = 0
        if self._number == 1:
            return self._begin(ticks, extra_ns, arrival_ns)
        tick_ns = self._counter.time_ns(ticks)
        aircraft_ns = tick_ns + extra_ns
        x = float(aircraft_ns - self._origin_ns)
        y = float(arrival_ns - aircraft_ns - self._offset_ns)
        step_ns = aircraft_ns - self._newest_ns
        height = y - self.line.base - self.line.drift * x
        # Neither delay nor overtaking explains these. After a pause of the counter, a message far
        # above the line does not come from a queue, which would contain consecutive counts.
        paused = step_ns > _LATE_NS and height > _SECOND_NS
        below = height < -(_STEP_NS + 2 * self._max_drift * max(step_ns, 0))
        if step_ns < -_LATE_NS or paused or below:
            is_counter = abs(step_ns) > _LATE_NS
            self._counts["resets" if is_counter else "host steps"] += 1
            return self._begin(ticks, extra_ns, arrival_ns)
        if height > _STEP_NS and self._is_step(height, aircraft_ns, arrival_ns):
            run = self._above
            passed_ns, counted_ns = arrival_ns - run.arrival_ns, aircraft_ns - run.aircraft_ns
            if self._may_be_long and is_long(passed_ns, counted_ns):
                self._may_be_long, self._counter = False, RunningCounter(LONG_TICK_NS, 32)
                return self._begin(ticks, extra_ns, arrival_ns)
            self._counts["resets" if run.is_counter else "host steps"] += 1
            late_ns = round(height - run.least)
            return self._begin(ticks, extra_ns, arrival_ns - late_ns)
        self.line.add(x, y)
        if step_ns > 0:
            self._counter.go_on(ticks, tick_ns)
            self._newest_ns = aircraft_ns
            self._follow(x, float(step_ns))
        return aircraft_ns + self._offset_ns + int(self._published)

    def lateness_ns(self, ticks: int, arrival_ns: int) -> float:
        """Return how far above the line a message arrived (ns), without a change of the clock."""
        if not self._number:
            return 0.0
        aircraft_ns = self._counter.time_ns(ticks)
        y = arrival_ns - aircraft_ns - self._offset_ns
        return y - self.line.base - self.line.drift * (aircraft_ns - self._origin_ns)

    @property
    def state(self) -> str:
        """Return ``waiting`` (no message yet), ``settling`` or ``settled``.

        Settled: since the offset began, at least 20 messages have come over at least 3 s, and the
        stamps are on the line below them. While settling, stamps may be as late as the messages.
        """
        if not self._number:
            return "waiting"
        return "settled" if self._settled else "settling"

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return state, offset, drift and steps of the clocks, as texts."""
        tick_ms = self._counter.tick_ns / MILLISECOND_NS
        texts = {"clock state": self.state, "clock tick [ms]": f"{tick_ms:g}"}
        if self._number:
            offset_s = (self._offset_ns + round(self._published)) * 1e-9
            texts["clock offset [s]"] = f"{offset_s:.6f}"
            texts["clock drift [ppm]"] = f"{self.line.drift * 1e6:.2f}"
        texts["clock wraps"] = str(self._counter.wraps)
        return texts | {f"clock {name}": str(count) for name, count in self._counts.items()}

    def _begin(self, ticks: int, extra_ns: int, arrival_ns: int) -> int:
        """Begin the offset with this message; return its arrival as the stamp."""
        self._newest_ns = self._origin_ns = self._counter.begin(ticks) + extra_ns
        self._offset_ns = arrival_ns - self._origin_ns
        self._began_number = self._number
        self._published = 0.0
        self._settled = False
        self.line.begin(0.0, 0.0)
        return arrival_ns

    def _follow(self, x: float, step: float) -> None:
        """Move the published offset towards the line as fast as the elapsed time allows."""
        drift = self.line.drift
        self._published += drift * step
        gap = self.line.base + drift * x - self._published
        if self._settled and abs(gap) > _UNSETTLED_NS:
            self._settled = False
        limit = (self._slew if self._settled else _HASTE) * step
        move = min(max(gap, -limit), limit)
        self._published += move
        if not self._settled and abs(gap - move) < _SETTLED_WITHIN_NS:
            number = self._number - self._began_number
            self._settled = number >= _SETTLED_NUMBER and x >= _SETTLED_AFTER_NS
            self._may_be_long = self._may_be_long and not self._settled

    def _is_step(self, height: float, aircraft_ns: int, arrival_ns: int) -> bool:
        """Return whether messages have been far above the line long enough for a new offset."""
        above = self._above
        continues = above.number == self._number - 1
        if not continues or height < above.first - _DRAINS_NS:
            is_counter = above.is_counter if continues else aircraft_ns < self._newest_ns
            self._above = _Above(
                self._number, 1, height, height, aircraft_ns, arrival_ns, is_counter
            )
            return False
        length, least = above.length + 1, min(height, above.least)
        self._above = above._replace(number=self._number, length=length, least=least)
        lasted_ns = min(aircraft_ns - above.aircraft_ns, arrival_ns - above.arrival_ns)
        return length >= _STEP_NUMBER and lasted_ns >= _STEP_LASTS_NS
