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
"""Check time stamps: an output's rate, a stream's presence and outliers, order of arrival."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from tirgeo_ros.core.types.arrays import BoolArray, IntArray
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample, NavigationInput

#: A stream becomes steady after this many samples over at least this time.
_SAMPLES = 5
_STEADY_NS = 2_000_000_000
#: A steady stream is gone after this silence. In a stream that is not steady yet, a gap of this
#: length or a stamp that goes back restarts the count.
_SILENT_NS = 2_000_000_000
#: A stamp is an outlier if it is this far from the median of the five around it, in ns and in
#: steps. A stamp in order is at most two steps from that median.
_OUTLIER_NS, _OUTLIER_STEPS = 1_000_000_000, 3

S = TypeVar("S", bound=NavigationInput | JointSample | CameraAttitudeSample)
T = TypeVar("T")
Entry = tuple[int, int, T]  # time of arrival in ns, number, item


def exposure_ns(stamp_ns: int, video_latency_s: float) -> int:
    """Return the exposure time of a picture, ns: its stamp less the video's latency."""
    return stamp_ns - round(video_latency_s * 1e9)


class RateLimit:
    """Select the time stamps of a stream at which an output of a given rate (Hz) is due.

    A stamp may be early by a quarter of a period, so that all inputs at the rate itself are due.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._next_ns: int | None = None

    def due(self, stamp_ns: int) -> bool:
        """Return whether an output is due at a stamp (ns).

        If it is, the next one is scheduled a period later. If the stamp is more than
        two periods from the schedule (after a pause, or when stamps go back), the schedule
        restarts at this stamp.
        """
        if not self.is_due(stamp_ns):
            return False
        if self._next_ns is None or abs(stamp_ns - self._next_ns) > 2 * self._period_ns:
            self._next_ns = stamp_ns
        self._next_ns += self._period_ns
        return True

    def is_due(self, stamp_ns: int) -> bool:
        """Return what ``due`` would return, and schedule nothing."""
        if self._next_ns is None:
            return True
        early_ns = self._next_ns - stamp_ns
        return not self._period_ns // 4 < early_ns <= 2 * self._period_ns


class Spacing:
    """Select stamps that are at least an interval apart; a stamp that goes back is due too."""

    def __init__(self, interval_ns: int) -> None:
        self._interval_ns = interval_ns
        self._newest_ns: int | None = None

    def is_due(self, stamp_ns: int) -> bool:
        """Return whether ``take`` would take a stamp."""
        newest_ns = self._newest_ns
        return newest_ns is None or not 0 <= stamp_ns - newest_ns < self._interval_ns

    def take(self, stamp_ns: int) -> bool:
        """Take a stamp if it is due; return whether it was."""
        is_due = self.is_due(stamp_ns)
        if is_due:
            self._newest_ns = stamp_ns
        return is_due


class StreamPresence:
    """Track whether one stream is steady, from its stamps and those of another stream."""

    def __init__(self) -> None:
        self.steady = False
        self._first_ns = 0
        self._newest_ns = 0
        self._count = 0

    def add(self, stamp_ns: int) -> bool:
        """Take a sample's stamp (ns); return True if the stream becomes steady with it."""
        if self._count and not 0 <= stamp_ns - self._newest_ns < _SILENT_NS:
            self._count = 0
        if self._count == 0:
            self._first_ns = stamp_ns
        self._newest_ns = stamp_ns
        self._count += 1
        long_enough = self._count >= _SAMPLES and stamp_ns - self._first_ns >= _STEADY_NS
        became = long_enough and not self.steady
        self.steady = self.steady or long_enough
        return became

    def gone(self, now_ns: int) -> bool:
        """Take a stamp (ns) of another stream; return True if this one has just fallen silent."""
        if not self.steady or now_ns - self._newest_ns < _SILENT_NS:
            return False
        self.steady = False
        self._count = 0
        return True


def lone_stamps(stamps_ns: Sequence[int] | IntArray) -> BoolArray:
    """Return which stamps (N,) are outliers, far from their neighbours; none of fewer than five.

    A stamp after a gap, or after a clock was set, is no outlier: its neighbours are near it.
    """
    stamps = np.asarray(stamps_ns, np.int64)
    if len(stamps) < 5:
        return np.zeros(len(stamps), bool)
    near = np.sort(np.lib.stride_tricks.sliding_window_view(stamps, 5))
    steps = np.sort(np.diff(near))[:, 1]
    medians, steps = (np.pad(each, 2, mode="edge") for each in (near[:, 2], steps))
    return np.asarray(np.abs(stamps - medians) > np.maximum(_OUTLIER_NS, _OUTLIER_STEPS * steps))


class Arrivals:
    """Stamp samples without a time stamp, and count them by topic."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of samples without a stamp, by topic."""
        return dict(self._counts)

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return the counts as key and value strings for diagnostics."""
        return {f"stamped_at_arrival.{topic}": str(n) for topic, n in self._counts.items()}

    def stamped(self, topic: str, sample: S, arrival_ns: int) -> S:
        """Return the sample; if its stamp is 0, a copy stamped with the time of arrival."""
        stamp_ns = self.stamp_ns(topic, sample.stamp_ns, arrival_ns)
        return sample if stamp_ns == sample.stamp_ns else replace(sample, stamp_ns=stamp_ns)

    def stamp_ns(self, topic: str, stamp_ns: int, arrival_ns: int) -> int:
        """Return the stamp; if it is 0, count it and return the time of arrival."""
        if stamp_ns != 0:
            return stamp_ns
        self._counts[topic] += 1
        return arrival_ns


class ArrivalOrder(Generic[T]):
    """Merge several bounded FIFO queues, called lanes, by the time of arrival.

    The samples' own time stamps do not affect the order. The filter decides what is early, late
    or from another clock, and it needs the samples as they arrived to do so. A full lane discards
    its oldest item.
    """

    def __init__(self) -> None:
        self._lanes: dict[str, deque[Entry[T]]] = {}
        self._given_up: dict[str, int] = {}
        self._number = 0

    def __len__(self) -> int:
        return sum(map(len, self._lanes.values()))

    def open(self, lane: str, depth: int) -> None:
        """Create an empty lane that holds up to ``depth`` items."""
        self._lanes[lane] = deque(maxlen=depth)

    @property
    def given_up(self) -> dict[str, int]:
        """Return the number of discarded items by lane, without lanes that discarded none."""
        return dict(self._given_up)

    def put(self, lane: str, arrived_ns: int, item: T) -> None:
        """Append an item that arrived at ``arrived_ns`` to a lane; discard the oldest if full."""
        entries = self._lanes[lane]
        if len(entries) == entries.maxlen:
            self._given_up[lane] = self._given_up.get(lane, 0) + 1
        self._number += 1
        entries.append((arrived_ns, self._number, item))

    def pop(self) -> T | None:
        """Remove and return the earliest of the lanes' first items; None if all are empty."""
        waiting = [entries for entries in self._lanes.values() if entries]
        if not waiting:
            return None
        return min(waiting, key=lambda entries: entries[0][:2]).popleft()[2]
