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
"""Convert the aircraft's counters to stamps for a file that does not record arrival times.

The receivers' date and time of day give a capture's place in civil time. These two words have
whole seconds and come five times a second, so they are exact in the first message of a new second.
DJI's headers state that they are in GMT+8.
"""

from __future__ import annotations

from datetime import datetime, timezone
from itertools import pairwise
from statistics import median, median_low

from tirgeo_ros.dji.clocks.aircraft_clock import (
    LONG_TICK_NS,
    LONGEST_EXTRA_NS,
    MILLISECOND_NS,
    RunningCounter,
    is_long,
)

_SECOND_NS = 1_000_000_000
_HOUR_NS = 3600 * _SECOND_NS

# Counters.

#: Two counters that differ by less than this at the same place of a file show the same clock.
_SAME_NS = _SECOND_NS
#: A message belongs to a new count if it is older than the previous one by more than _LATE_NS (by
#: less, it is only out of order), or ahead by more than _LONG_NS.
_LATE_NS, _LONG_NS = _SECOND_NS, 60 * _SECOND_NS
#: Two messages in a row confirm a new count if they differ by at most this.
_AGREE_NS = _SECOND_NS
#: Assumed time between the last stamp before a counter restarts and the first stamp after it.
RESTART_NS = _SECOND_NS

# Civil time.

#: Receivers without a fix send 1980 or 2000; ROS times end in 2106.
_FIRST_YEAR, _LAST_YEAR = 2010, 2099
#: The time zone that DJI's headers state, hours ahead of UTC.
DOCUMENTED_OFFSET_H = 8
#: Tolerance for a file's modification time, which is that of its last byte or a little later.
_HINT_NS = 2 * _HOUR_NS
#: A second whose shift differs from the median by more than this has wrong words.
_ASTRAY_NS = 2 * _SECOND_NS


class CaptureTimeline:
    """Hold the timeline that the counters of one file share.

    Stamps are the aircraft's time since power-up plus ``shift_ns``. With ``start_ns``, the shift
    is chosen so that the first message gets this stamp.
    """

    def __init__(self, start_ns: int | None = None, shift_ns: int = 0) -> None:
        self._start_ns = start_ns
        self.shift_ns = shift_ns
        self.restarts = 0  # restarts of counters, each of unknown duration
        self.number = 0  # of clocks that have begun
        self.newest_ns: int | None = None  # newest stamp, without the shift
        self.aircraft_ns = 0  # counter time of the newest stamp

    def clock(self, tick_ns: int = MILLISECOND_NS, *, resets_alone: bool = False) -> CaptureClock:
        """Return a clock for another counter of the same file."""
        return CaptureClock(self, tick_ns, resets_alone=resets_alone)

    @property
    def now_ns(self) -> int:
        """Return the newest stamp, which is used for messages without a time."""
        return (self.newest_ns or 0) + self.shift_ns

    def take(self, stamp_ns: int, aircraft_ns: int) -> int:
        """Take a message of any of the clocks; return its stamp with the shift."""
        if self._start_ns is not None:
            self.shift_ns, self._start_ns = self._start_ns - stamp_ns, None
        if self.newest_ns is None or stamp_ns >= self.newest_ns:
            self.newest_ns, self.aircraft_ns = stamp_ns, aircraft_ns
        return stamp_ns + self.shift_ns


class CaptureClock:
    """Convert the values of one aircraft counter of 32 bits to stamps on a file's timeline.

    The counter is trusted, wraps included. If two messages in a row show that it has gone back by
    more than a second, it has restarted: stamps continue ``RESTART_NS`` after the newest stamp,
    since the file does not show how long the aircraft was off. A single message that is so far
    back, or more than a minute ahead, gets the newest stamp. Stamps of increasing counts do not
    decrease.

    Counters of a file that show nearly the same value belong to the same clock. For a counter that
    shows another value, the order of the messages gives the offset: a message is not older than
    the messages of other clocks before it. The same applies to a counter with ``resets_alone``
    after its first reset, because a command sets it to zero while the others continue.
    """

    def __init__(self, timeline: CaptureTimeline, tick_ns: int, *, resets_alone: bool) -> None:
        self._timeline, self._resets_alone = timeline, resets_alone
        self._counter = RunningCounter(tick_ns, 32)
        self._is_begun = False
        self._is_apart = False  # whether the order of the messages gives the offset
        self._offset_ns = 0  # from counter time to the timeline
        self._newest_ns = 0  # in counter time
        self._stray_ns: int | None = None  # counter time of an unconfirmed previous message

    def stamp_ns(self, ticks: int, arrival_ns: int = 0, extra_ns: int = 0) -> int:  # noqa: ARG002  as the other clocks
        """Return the stamp of a message sent ``extra_ns`` after a tick; ignore the arrival."""
        if not 0 <= extra_ns <= LONGEST_EXTRA_NS:
            extra_ns = 0
        if not self._is_begun:
            self._begin(ticks, extra_ns)
        tick_ns = self._counter.time_ns(ticks)
        aircraft_ns = tick_ns + extra_ns
        step_ns = aircraft_ns - self._newest_ns
        if not -_LATE_NS <= step_ns <= _LONG_NS:
            before_ns, self._stray_ns = self._stray_ns, aircraft_ns
            if before_ns is None or abs(aircraft_ns - before_ns) > _AGREE_NS:
                return self._timeline.now_ns  # the previous message does not confirm it
            if step_ns < 0:
                self._start_again(ticks, extra_ns)
                tick_ns, aircraft_ns = self._newest_ns - extra_ns, self._newest_ns
        self._stray_ns = None
        if step_ns > 0:
            self._counter.go_on(ticks, tick_ns)
            self._newest_ns = aircraft_ns
            now_ns = self._timeline.newest_ns
            if self._is_apart and now_ns is not None:  # not older than earlier messages
                self._offset_ns = max(self._offset_ns, now_ns - aircraft_ns)
        return self._timeline.take(aircraft_ns + self._offset_ns, aircraft_ns)

    def _begin(self, ticks: int, extra_ns: int) -> None:
        """Set the offset at the first message."""
        line, now_ns = self._timeline, self._timeline.newest_ns
        self._is_begun = True
        self._newest_ns = aircraft_ns = self._counter.begin(ticks) + extra_ns
        line.number += 1
        if now_ns is not None:
            self._is_apart = abs(aircraft_ns - line.aircraft_ns) >= _SAME_NS
            self._offset_ns = now_ns - (aircraft_ns if self._is_apart else line.aircraft_ns)

    def _start_again(self, ticks: int, extra_ns: int) -> None:
        """Set a new offset after a restart.

        It is that of another clock that has restarted already. Without one, stamps continue after
        the newest stamp.
        """
        line, newest_ns = self._timeline, self._newest_ns + self._offset_ns
        self._newest_ns = aircraft_ns = self._counter.begin(ticks) + extra_ns
        now_ns = line.now_ns - line.shift_ns
        if abs(aircraft_ns - line.aircraft_ns) < _SAME_NS:
            earliest_ns = now_ns + aircraft_ns - line.aircraft_ns
            self._offset_ns = max(earliest_ns, newest_ns) - aircraft_ns
        elif self._resets_alone and line.number > 1:
            self._is_apart = True
            self._offset_ns = now_ns - aircraft_ns
        else:
            line.restarts += 1
            self._offset_ns = now_ns + RESTART_NS - aircraft_ns


def time_of_words(date_yyyymmdd: int, time_hhmmss: int) -> int | None:
    """Return a date (years 2010 to 2099) and time as ns since 1970, in their own time zone.

    Returns None for invalid words.
    """
    year, month, day = _three(date_yyyymmdd)
    if not _FIRST_YEAR <= year <= _LAST_YEAR or time_hhmmss < 0:
        return None
    try:
        local = datetime(year, month, day, *_three(time_hhmmss), tzinfo=timezone.utc)
    except ValueError:
        return None
    return round(local.timestamp()) * _SECOND_NS


def _three(word: int) -> tuple[int, int, int]:
    return word // 10_000, word // 100 % 100, word % 100


def guess_utc_offset(newest_words_ns: int, hint_ns: int) -> int | None:
    """Return how many hours date and time words are ahead of UTC: 8 or 0.

    ``hint_ns`` is the approximate UTC of the newest words, such as the time of the file's last
    change. Returns None if neither offset fits within 2 h.
    """
    ahead_ns, possible = newest_words_ns - hint_ns, (DOCUMENTED_OFFSET_H, 0)
    fits = (hours for hours in possible if abs(ahead_ns - hours * _HOUR_NS) <= _HINT_NS)
    return next(fits, None)


class WholeSeconds:
    """Estimate the shift from a capture's stamps to civil time by the whole seconds in messages.

    A message contains the second that has begun. So civil time is at least that second, and the
    shift is at least the largest difference of second minus stamp. The estimate is early by the
    delay of the first message of a second (some 10 ms if epochs are at whole seconds).
    """

    def __init__(self) -> None:
        self._word_ns: int | None = None
        self._seconds: list[tuple[int, int]] = []  # word and stamp of each new second
        self.newest_ns = 0  # newest stamp

    def take(self, stamp_ns: int, date_yyyymmdd: int, time_hhmmss: int) -> None:
        """Take a message's date and time words and its stamp, on any timeline."""
        word_ns = time_of_words(date_yyyymmdd, time_hhmmss)
        self.newest_ns = stamp_ns
        if word_ns is None or word_ns == self._word_ns:
            return
        if self._word_ns is not None:  # the first second may have begun before the capture
            self._seconds.append((word_ns, stamp_ns))
        self._word_ns = word_ns

    @property
    def number(self) -> int:
        """Return the number of seconds that began."""
        return len(self._seconds)

    @property
    def shift_ns(self) -> int | None:
        """Return the shift: words (in their time zone) minus stamps; None until a second began."""
        shifts_ns = [word_ns - stamp_ns for word_ns, stamp_ns in self._seconds]
        if not shifts_ns:
            return None
        middle = median_low(shifts_ns)
        return max(shift for shift in shifts_ns if abs(shift - middle) <= _ASTRAY_NS)

    @property
    def tick_ns(self) -> int:
        """Return the tick of a counter taken for milliseconds: 2.5 ms if three seconds show it."""
        steps = [(new[0] - old[0], new[1] - old[1]) for old, new in pairwise(self._seconds)]
        if len(steps) < 2:
            return MILLISECOND_NS
        counted = median(by_stamps / by_words for by_words, by_stamps in steps)
        return LONG_TICK_NS if is_long(1.0, counted) else MILLISECOND_NS
