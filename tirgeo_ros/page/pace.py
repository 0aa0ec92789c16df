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
"""Choose how large the pictures of one viewer are, by how long they take to his screen."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

_FIRST = 4  # index into LEVELS
_FIRST_ONES = 3  # pictures: of a page that has just begun one alone may take long
#: Most pictures on the way to a screen: on a slow link only one while its bytes alone take longer
#: than _ALONE_S, since a second would wait for the first and be old when it arrives; on a long way
#: as many as fit into it.
_UNANSWERED, _ALONE_S, _MOST_ON_A_LONG_WAY = 2, 0.08, 3
_LOST_S = 3.0  # then a picture counts as answered: the page may have failed on it
#: A trip lasts from sending a picture to its answer; without the way itself, which no size makes
#: shorter, it is late by its bytes. Above _LONG_S pictures become smaller, below _SHORT_S larger;
#: the new size aims at _WANTED_S, or surely at _SURE_S.
_LONG_S, _SHORT_S, _WANTED_S, _SURE_S = 0.18, 0.1, 0.12, 0.07
_VERY_LONG_S, _IN_SUCCESSION = 0.6, 2  # one long trip alone may be a hiccup
_READABLE = 5  # smallest size that shows a person; smaller ones only for very long trips
#: Periods of trying a larger size; it has failed if trips are long within _SOON_S.
_PROBE_S, _RAREST_PROBE_S, _SOON_S = 1.0, 32.0, 3.0


class Level(NamedTuple):
    """Hold one size of picture."""

    divisor: int  # of width and height: 1, 2 or 4
    quality: int  # of the JPEG; 0: the bytes as they came
    share: float  # of the original bytes, as measured on thermal pictures of 640 x 512
    coarse: bool = False  # whether the map is drawn coarser too


#: From the original picture down; each has about two thirds of the bytes of the one before.
LEVELS = (
    Level(1, 0, 1.0),
    Level(1, 60, 0.67),
    Level(1, 35, 0.46),
    Level(2, 80, 0.36, coarse=True),
    Level(2, 55, 0.23, coarse=True),
    Level(2, 35, 0.17, coarse=True),
    Level(4, 80, 0.125, coarse=True),
    Level(4, 50, 0.077, coarse=True),
)


class Pace:
    """Choose the size of pictures for one viewer, by the time until each is on the screen."""

    def __init__(self) -> None:
        #: The first pictures are the smallest: their trip is nearly the way alone.
        self.level = len(LEVELS) - 1
        self._sent, self._first = 0, _FIRST
        self._bytes: dict[int, int] = {}  # of a picture, by level
        self._on_the_way: dict[int, tuple[float, int]] = {}  # number -> sent at, level
        self._probe_at_s, self._probe_every_s = 0.0, _PROBE_S
        self._probed_s, self._anew_at_s = -math.inf, -math.inf
        self._trip_s = 0.0  # of the last picture
        self._least_s: dict[int, float] = {}  # shortest trip by level
        self._long = 0  # trips in succession

    def may_send(self, now_s: float) -> bool:
        """Return whether a picture may be sent."""
        self._forget(lambda _, sent_s: now_s - sent_s > _LOST_S)
        transfer_s, way_s = self._split_s()
        most = 1 if transfer_s > _ALONE_S else _UNANSWERED
        on_the_way = 1 + int(way_s / max(transfer_s, 1e-3))
        return len(self._on_the_way) < max(most, min(on_the_way, _MOST_ON_A_LONG_WAY))

    def sent(self, number: int, size: int, now_s: float) -> None:
        """Record that a picture of so many bytes is sent at the present level."""
        self._on_the_way[number] = now_s, self.level
        self._bytes[self.level] = size
        self._sent += 1
        if self._sent == _FIRST_ONES:
            self.level = self._first

    def shown(self, number: int, now_s: float) -> bool:
        """Record that a picture is on the screen; return whether it was waiting for this answer.

        Pictures sent before it count as answered too.
        """
        if number not in self._on_the_way:
            return False
        sent_s, level = self._on_the_way[number]
        self._forget(lambda other, _: other <= number)
        self._trip_s = now_s - sent_s
        self._least_s[level] = min(self._trip_s, self._least_s.get(level, math.inf))
        if level != self.level:
            return True  # its size is no longer sent
        late_s = self._trip_s - self._split_s()[1]
        self._long = self._long + 1 if late_s > _LONG_S else 0
        if self._long >= _IN_SUCCESSION or late_s > _VERY_LONG_S:
            self._shrink(late_s, now_s)
        elif late_s < _SHORT_S and self.level > 0:
            self._grow(max(late_s, 1e-3), now_s)
        return True

    def _split_s(self) -> tuple[float, float]:
        """Return how long (s) a picture's bytes take, and the way itself, there and back.

        Both by the shortest trips of this size and of the smallest one; before there is another,
        all of a trip is its bytes. The way is no longer than any trip.
        """
        smaller = [n for n in self._least_s if n > self.level]
        if not smaller or self.level not in self._least_s:
            return self._trip_s, 0.0
        trip_s, least = self._least_s[self.level], max(smaller)
        share = max(1 - self._bytes[least] / self._bytes[self.level], 0.1)
        transfer_s = max(trip_s - self._least_s[least], 0.0) / share
        way_s = min(max(trip_s - transfer_s, 0.0), *self._least_s.values())
        return trip_s - way_s, way_s

    def _forget(self, which: Callable[[int, float], bool]) -> None:
        sent = self._on_the_way.items()
        self._on_the_way = {number: at for number, at in sent if not which(number, at[0])}

    def _shrink(self, trip_s: float, now_s: float) -> None:
        """Take the level whose trip is short enough if trips are proportional to the bytes."""
        share = LEVELS[self.level].share * _WANTED_S / trip_s
        least = len(LEVELS) - 1 if trip_s > _VERY_LONG_S else max(_READABLE, self.level)
        fitting = (n for n, level in enumerate(LEVELS) if level.share <= share)
        if self.level == least and now_s >= self._anew_at_s:
            self._begin_anew(now_s)
            return
        self.level = min(max(next(fitting, least), self.level + 1), least)
        failed = now_s - self._probed_s < _SOON_S  # the link carries no more: try less often
        self._probe_every_s = min(self._probe_every_s * 2, _RAREST_PROBE_S) if failed else _PROBE_S
        self._long, self._probed_s = 0, -math.inf
        self._probe_at_s = now_s + self._probe_every_s

    def _begin_anew(self, now_s: float) -> None:
        """Forget the trips so far: no size helps any more, so the way may have become longer."""
        self._least_s.clear()
        self.level, self._sent, self._long = len(LEVELS) - 1, 0, 0
        self._first = _READABLE
        self._anew_at_s = now_s + _RAREST_PROBE_S

    def _grow(self, trip_s: float, now_s: float) -> None:
        """Take the best level whose trip is surely short; from time to time try the next one."""
        share = LEVELS[self.level].share * _SURE_S / trip_s
        best = next(n for n, level in enumerate(LEVELS) if level.share <= share or n == self.level)
        if best < self.level:
            self.level = best
        elif now_s >= self._probe_at_s:
            self.level -= 1
            self._probed_s = now_s
            self._probe_at_s = now_s + self._probe_every_s
