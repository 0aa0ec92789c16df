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
"""Compute stamps for periodic messages that contain no time.

They arrive in bursts, with varying delays, but the aircraft sends them at a steady rate. So their
number is a clock, which counts periods since the first. ``dji.clocks.aircraft_clock`` puts that
clock on the line below the arrivals, as it does with the aircraft's own clock.
"""

from __future__ import annotations

import math

from tirgeo_ros.core.config.dji_parameters import DjiClockConfig
from tirgeo_ros.dji.clocks.aircraft_clock import AircraftClock, Point, middle_slope

#: The period is learned from at least this many messages over this time. The number doubles each
#: time the period proves wrong, up to _LEARN_MOST.
_LEARN_NUMBER, _LEARN_NS, _LEARN_MOST = 8, 1_000_000_000, 128
#: From _PARTED_NUMBER messages on, parts of the sequence are compared. If the messages are
#: periodic, the slopes of its quarters differ from the total slope by less than the share _ALIKE.
#: If the slope of a half is smaller than the total by more than the share _LOSSLESS, messages were
#: lost, but not in that half.
_PARTED_NUMBER, _ALIKE, _LOSSLESS = 64, 0.1, 0.01
#: Largest remaining error of the period, and the window of the minima.
_CONFIG = DjiClockConfig(window_s=10.0, max_drift_ppm=10_000.0)
_LARGEST_DRIFT = 0.9e-6 * _CONFIG.max_drift_ppm
#: A silence longer than both limits is a pause: lost messages cannot be counted over it.
_PAUSE_NS, _PAUSE_PERIODS = 500_000_000, 2.5
#: A message that is late by this many periods counts as late by a period.
_LOST_PERIODS = 0.8
#: No message is delayed for longer than this: a longer lateness shows lost messages.
_HELD_UP_NS = 200_000_000
#: If the period is longer than this, one message that is late by a period proves a loss.
_SLOW_NS = 150_000_000
#: Stamps are earlier than the arrival by at most this.
_EARLIEST_NS = 250_000_000
#: Arrivals may be out of order by less than this, because two threads stamp them.
_DISORDER_NS = 50_000_000
#: The period is wrong if among _JUDGED_NUMBER messages the count was wrong more than _WRONG_NUMBER
#: times, or more than _LOST_NUMBER messages were lost.
_JUDGED_NUMBER, _WRONG_NUMBER, _LOST_NUMBER = 128, 12, 64


class SteadyStamps:
    """Compute the stamps of one stream from its count and the line below its arrivals.

    Stamps increase, unless the host's clock is set back, and are at most 0.25 s early. The stamp
    is the arrival itself until the period is known (after at least a second and 8 messages), after
    the period has changed, and for a stream without a period. Otherwise, once settled, it is the
    time at which the message would have come with the smallest delay of the last 10 s.

    When messages are lost, the stamps are early by the lost periods until the loss is certain:
    after 0.2 s, or at once if a period is longer than 0.15 s. The count begins again at the
    arrival after a pause (over 0.5 s and 2.5 periods), and when the host's clock is set back by
    over 50 ms. Intervals that vary at random by less than half may be taken for periods at first.
    """

    def __init__(self) -> None:
        self._arrivals_ns: list[int] = []  # from which the period is learned
        self._arrival_ns: int | None = None
        self._newest_ns = 0
        self._learn_number = _LEARN_NUMBER
        self._period_ns = 0.0  # 0: not known
        self._begin()

    def stamp_ns(self, arrival_ns: int) -> int:
        """Return the stamp of a message by its arrival, both in ns of the host's clock."""
        arrival_ns = self._in_order(arrival_ns)
        stamp_ns = arrival_ns
        if self._period_ns:
            stamp_ns = self._count_on(arrival_ns)
            stamp_ns = min(max(stamp_ns, arrival_ns - _EARLIEST_NS), arrival_ns)
        else:
            self._learn(arrival_ns)
        self._newest_ns = max(stamp_ns, self._newest_ns + 1)
        return self._newest_ns

    @property
    def period_ns(self) -> float:
        """Return the period by the host's clock; 0 as long as it is not known."""
        return self._period_ns * (1 + self._clock.line.drift)

    def _in_order(self, arrival_ns: int) -> int:
        """Return the arrival, at least the last one; begin again after a pause or a step back."""
        last_ns, self._arrival_ns = self._arrival_ns, arrival_ns
        if last_ns is None or last_ns - arrival_ns > _DISORDER_NS:
            self._newest_ns = arrival_ns - 1
            self._begin()
        elif arrival_ns - last_ns > _PAUSE_NS:
            steps = len(self._arrivals_ns) - 1
            mean_ns = (last_ns - self._arrivals_ns[0]) / steps if steps > 0 else math.inf
            if arrival_ns - last_ns > _PAUSE_PERIODS * (self.period_ns or mean_ns):
                self._begin()
        else:
            self._arrival_ns = max(arrival_ns, last_ns)
        return self._arrival_ns

    def _begin(self) -> None:
        """Begin the count again, with the period known so far."""
        if self._period_ns:
            self._period_ns = self.period_ns
        self._clock = AircraftClock(_CONFIG, tick_ns=1, bits=64)
        self._index = 0
        self._late_since_ns: int | None = None  # arrival of the first of a run of late messages
        self._first_late_ns = self._least_late_ns = 0.0  # lateness in that run
        self._judged = self._wrong = self._missing = 0
        self._arrivals_ns.clear()

    def _learn(self, arrival_ns: int) -> None:
        """Estimate the period by the lower hull of arrivals over their count."""
        self._arrivals_ns.append(arrival_ns)
        arrivals_ns = self._arrivals_ns.copy()
        since_ns = [arrival - arrivals_ns[0] for arrival in arrivals_ns]
        if len(since_ns) < self._learn_number or since_ns[-1] < _LEARN_NS:
            return
        self._period_ns = _period_ns(since_ns)
        self._begin()
        if not self._period_ns:
            self._learn_number = _LEARN_MOST
            return
        for arrival in arrivals_ns:
            self._index += 1
            self._clock.stamp_ns(round(self._index * self._period_ns), arrival)

    def _count_on(self, arrival_ns: int) -> int:
        """Return the stamp by the count, and correct the count for lost messages."""
        period_ns = self._period_ns
        self._index += 1
        late_ns = self._clock.lateness_ns(round(self._index * period_ns), arrival_ns)
        if late_ns > _LOST_PERIODS * period_ns:
            lost = self._lost(late_ns, arrival_ns)
            self._index += lost
            self._missing += lost
            self._wrong += lost > 0
        else:
            self._late_since_ns = None
            self._wrong += late_ns < -period_ns / 2
        stamp_ns = self._clock.stamp_ns(round(self._index * period_ns), arrival_ns)
        self._judge()
        return stamp_ns

    def _lost(self, late_ns: float, arrival_ns: int) -> int:
        """Return how many messages were lost before a late one; 0 if a queue may be the cause."""
        period_ns, since_ns = self._period_ns, self._late_since_ns
        if period_ns > _SLOW_NS:
            return round(late_ns / period_ns)
        if since_ns is None or late_ns < self._first_late_ns - _LOST_PERIODS * period_ns:
            self._late_since_ns = arrival_ns
            self._first_late_ns = self._least_late_ns = late_ns
            return 0
        self._least_late_ns = min(late_ns, self._least_late_ns)
        if arrival_ns - since_ns < max(_HELD_UP_NS, 2 * period_ns):
            return 0
        self._late_since_ns = None
        return round(self._least_late_ns / period_ns)

    def _judge(self) -> None:
        """Learn the period again if the count is wrong too often."""
        self._judged += 1
        too_wrong = self._wrong > _WRONG_NUMBER or self._missing > _LOST_NUMBER
        if too_wrong or abs(self._clock.line.drift) > _LARGEST_DRIFT:
            self._learn_number = min(2 * self._learn_number, _LEARN_MOST)
            self._begin()
            self._period_ns = 0.0
        elif self._judged >= _JUDGED_NUMBER:
            self._judged = self._wrong = self._missing = 0


def _period_ns(arrivals_ns: list[int]) -> float:
    """Return the period of arrivals, some of which may be missing; 0 if there is no period."""
    points = [(float(n), float(arrival)) for n, arrival in enumerate(arrivals_ns)]
    whole = middle_slope(points)
    if len(points) >= _PARTED_NUMBER:
        if any(abs(part - whole) >= _ALIKE * whole for part in _slopes(points, 4)):
            return 0.0
        least = min(_slopes(points, 2))
        whole = least if least < (1 - _LOSSLESS) * whole else whole
    return max(whole, 0.0)


def _slopes(points: list[Point], parts: int) -> list[float]:
    length = len(points) // parts
    return [middle_slope(points[n * length : (n + 1) * length]) for n in range(parts)]
