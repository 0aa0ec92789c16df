"""Date and time of day as receivers of the aircraft give them, and where a capture lies by them.

They are whole seconds that come five times a second, so each is right at the first message of a
new second. DJI's headers say that they are of GMT+8.
"""

from __future__ import annotations

from datetime import datetime, timezone
from statistics import median_low
from typing import NamedTuple

_SECOND_NS = 1_000_000_000
_HOUR_NS = 3600 * _SECOND_NS
#: Receivers without a fix say 1980 or 2000; ROS times end in 2106.
_FIRST_YEAR, _LAST_YEAR = 2010, 2099
#: What DJI's headers say of the time zone.
DOCUMENTED_OFFSET_H = 8
#: A file's time is when its last byte was written, or a little after.
_HINT_NS = 2 * _HOUR_NS
#: Seconds that lie elsewhere by more are wrong words.
_ASTRAY_NS = 2 * _SECOND_NS


def utc_from_words(date_yyyymmdd: int, time_hhmmss: int, utc_offset_h: float) -> int | None:
    """Nanoseconds of UTC of a local date and time; None for words that are none.

    ``utc_offset_h`` is how much local time is ahead of UTC. Years are 2010 to 2099.
    """
    year, month, day = _three(date_yyyymmdd)
    if not _FIRST_YEAR <= year <= _LAST_YEAR or time_hhmmss < 0:
        return None
    try:
        local = datetime(year, month, day, *_three(time_hhmmss), tzinfo=timezone.utc)
    except ValueError:
        return None
    return round(local.timestamp()) * _SECOND_NS - round(utc_offset_h * _HOUR_NS)


def _three(word: int) -> tuple[int, int, int]:
    return word // 10_000, word // 100 % 100, word % 100


class UtcOffset(NamedTuple):
    """Time zone of the aircraft's words; ``is_known`` when a hint has told."""

    hours: int
    is_known: bool


def guess_utc_offset(newest_words_ns: int, hint_ns: int | None) -> UtcOffset:
    """Whether words are of UTC or of GMT+8, by a time that is about that of the newest ones.

    ``newest_words_ns`` takes the words as UTC (``WholeSeconds.newest_ns``); the hint, such as the
    time of the file's last change, is UTC. Without a hint near either it is as documented.
    """
    if hint_ns is not None:
        for hours in (DOCUMENTED_OFFSET_H, 0):
            if abs(newest_words_ns - hours * _HOUR_NS - hint_ns) <= _HINT_NS:
                return UtcOffset(hours, is_known=True)
    return UtcOffset(DOCUMENTED_OFFSET_H, is_known=False)


class WholeSeconds:
    """Finds how far a capture's stamps are from civil time by the seconds that come in them.

    A message says the second that has begun, so civil time is at least that: civil time less
    stamp is at least the largest found. It is early by what the first message of a second is late
    (some 10 ms where epochs are at whole seconds).
    """

    def __init__(self) -> None:
        self._word_ns: int | None = None
        self._newest_ns = 0
        self._shifts_ns: list[int] = []  # one for each new second
        self._stamps: list[tuple[int, int]] = []  # words and stamp of each

    def take(self, stamp_ns: int, date_yyyymmdd: int, time_hhmmss: int) -> None:
        """Take a message's words and its stamp, on any timeline."""
        word_ns = utc_from_words(date_yyyymmdd, time_hhmmss, 0)
        self._newest_ns = stamp_ns
        if word_ns is None or word_ns == self._word_ns:
            return
        if self._word_ns is not None:  # the first second may have begun before
            self._shifts_ns.append(word_ns - stamp_ns)
            self._stamps.append((word_ns, stamp_ns))
        self._word_ns = word_ns

    @property
    def shift_ns(self) -> int | None:
        """Words (as if they were UTC) less stamps; None until a second began."""
        if not self._shifts_ns:
            return None
        middle = median_low(self._shifts_ns)
        return max(shift for shift in self._shifts_ns if abs(shift - middle) <= _ASTRAY_NS)

    @property
    def seconds_ns(self) -> list[tuple[int, int]]:
        """How far from one new second to the next: by the words, and by the stamps."""
        pairs = zip(self._stamps[:-1], self._stamps[1:], strict=True)
        return [(new[0] - old[0], new[1] - old[1]) for old, new in pairs]

    @property
    def newest_ns(self) -> int | None:
        """When the newest message was, by words as if they were UTC."""
        shift_ns = self.shift_ns
        return None if shift_ns is None else self._newest_ns + shift_ns
