"""Decide when a viewer gets its next picture, and how small; no sockets, no clock of its own.

A picture's trip is from sending it to the page's answer that it is on the screen. Fewer than two
pictures are on the way at any time, so a slow link holds no queue of old ones; their size follows
the trip.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple


class Level(NamedTuple):
    """Hold one size of picture."""

    divisor: int  # of width and height: 1, 2 or 4
    quality: int  # of the JPEG; 0: the bytes as they came
    share: float  # of the untouched bytes, as measured on overlays of 640 x 512


#: From the untouched picture down, each some two thirds of the one before.
LEVELS = (
    Level(1, 0, 1.0),
    Level(1, 60, 0.68),
    Level(1, 30, 0.46),
    Level(2, 75, 0.28),
    Level(2, 50, 0.19),
    Level(2, 25, 0.125),
    Level(4, 80, 0.08),
    Level(4, 50, 0.048),
)
_FIRST = 4
#: Pictures on the way; one alone where bytes make trips longer than this: on a slow link a second
#: would only wait for the first, and be old when it arrives.
_UNANSWERED, _ALONE_S = 2, 0.08
_LOST_S = 3.0  # then a picture counts as answered: the page may have failed on it
#: Trips above the first make pictures smaller, trips below the second larger.
_LONG_S, _SHORT_S, _WANTED_S, _SURE_S = 0.28, 0.16, 0.2, 0.1
_VERY_LONG_S, _IN_SUCCESSION = 0.6, 2  # one long trip alone may be a hiccup
_READABLE = 5  # the least level that shows a person; below it only for very long trips
#: How often a larger size is tried; one that leads to long trips so soon has failed.
_PROBE_S, _RAREST_PROBE_S, _SOON_S = 1.0, 32.0, 3.0


class Pace:
    """Know what is on the way to one viewer, and how it fared."""

    def __init__(self) -> None:
        self.level = _FIRST
        self._on_the_way: dict[int, tuple[float, int]] = {}  # number -> sent at, level
        self._probe_at_s, self._probe_every_s = 0.0, _PROBE_S
        self._probed_s = -math.inf
        self._trip_s = 0.0  # of the last picture
        self._least_s: dict[int, float] = {}  # shortest trip by level
        self._long = 0  # trips in succession

    def may_send(self, now_s: float) -> bool:
        """Return whether a picture may be sent."""
        self._forget(lambda _, sent_s: now_s - sent_s > _LOST_S)
        return len(self._on_the_way) < (1 if self._of_bytes_s() > _ALONE_S else _UNANSWERED)

    def sent(self, number: int, now_s: float) -> None:
        """Note a picture that goes out at the present level."""
        self._on_the_way[number] = now_s, self.level

    def shown(self, number: int, now_s: float) -> bool:
        """Note a picture that is on the screen; return whether it had been sent, and not answered.

        Those sent before it count as answered too.
        """
        if number not in self._on_the_way:
            return False
        sent_s, level = self._on_the_way[number]
        self._forget(lambda other, _: other <= number)
        self._trip_s = now_s - sent_s
        self._least_s[level] = min(self._trip_s, self._least_s.get(level, math.inf))
        if level == self.level:  # else it tells of a size that is no longer sent
            self._judge(self._trip_s, now_s)
        return True

    def _of_bytes_s(self) -> float:
        """Return the part of the last trip that bytes took, as trips of smaller pictures tell."""
        smaller = [n for n in self._least_s if n > self.level]
        if not smaller or self.level not in self._least_s:
            return self._trip_s
        least = max(smaller)
        more_s = self._least_s[self.level] - self._least_s[least]
        return more_s / (1 - LEVELS[least].share / LEVELS[self.level].share)

    def _forget(self, which: Callable[[int, float], bool]) -> None:
        gone = [n for n, (sent_s, _) in self._on_the_way.items() if which(n, sent_s)]
        for number in gone:
            del self._on_the_way[number]

    def _judge(self, trip_s: float, now_s: float) -> None:
        self._long = self._long + 1 if trip_s > _LONG_S else 0
        if self._long >= _IN_SUCCESSION or trip_s > _VERY_LONG_S:
            self._shrink(trip_s, now_s)
        elif trip_s < _SHORT_S and self.level > 0:
            self._grow(trip_s, now_s)

    def _shrink(self, trip_s: float, now_s: float) -> None:
        """Take the level whose trip will be short if the bytes alone make it long."""
        share = LEVELS[self.level].share * _WANTED_S / trip_s
        least = len(LEVELS) - 1 if trip_s > _VERY_LONG_S else max(_READABLE, self.level)
        fitting = (n for n, level in enumerate(LEVELS) if level.share <= share)
        self.level = min(max(next(fitting, least), self.level + 1), least)
        failed = now_s - self._probed_s < _SOON_S  # the link bears no more: ask it less often
        self._probe_every_s = min(self._probe_every_s * 2, _RAREST_PROBE_S) if failed else _PROBE_S
        self._long, self._probed_s = 0, -math.inf
        self._probe_at_s = now_s + self._probe_every_s

    def _grow(self, trip_s: float, now_s: float) -> None:
        """Take the best level that is surely short enough; now and then try one that may be."""
        share = LEVELS[self.level].share * _SURE_S / trip_s
        best = next(n for n, level in enumerate(LEVELS) if level.share <= share or n == self.level)
        if best < self.level:
            self.level = best
        elif now_s >= self._probe_at_s:
            self.level -= 1
            self._probed_s = now_s
            self._probe_at_s = now_s + self._probe_every_s
