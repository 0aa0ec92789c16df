"""Decode the receivers' date and time of day, and place a capture in civil time by them.

The words have whole seconds and come five times a second, so each is right at the first message of
a new second. DJI's headers say that they are in GMT+8.
"""

from __future__ import annotations

from datetime import datetime, timezone
from statistics import median_low
from typing import NamedTuple

_SECOND_NS = 1_000_000_000
_HOUR_NS = 3600 * _SECOND_NS
#: Receivers without a fix send 1980 or 2000; ROS times end in 2106.
_FIRST_YEAR, _LAST_YEAR = 2010, 2099
#: The time zone that DJI's headers state, hours ahead of UTC.
DOCUMENTED_OFFSET_H = 8
#: A file's modification time is that of its last byte, or a little after; this is the tolerance.
_HINT_NS = 2 * _HOUR_NS
#: Seconds whose shift is further than this from the median are wrong words.
_ASTRAY_NS = 2 * _SECOND_NS


def utc_from_words(date_yyyymmdd: int, time_hhmmss: int, utc_offset_h: float) -> int | None:
    """Convert a local date and time to nanoseconds of UTC; return None for invalid words.

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
    """Hold the time zone of the aircraft's words; ``is_known`` if a hint confirmed it."""

    hours: int
    is_known: bool


def guess_utc_offset(newest_words_ns: int, hint_ns: int | None) -> UtcOffset:
    """Return the time zone of words, UTC or GMT+8, by the approximate time of the newest.

    ``newest_words_ns`` takes the words as UTC (``WholeSeconds.newest_ns``). The hint, such as the
    time of the file's last change, is in UTC. Without a hint within 2 h of either, return the
    documented GMT+8.
    """
    if hint_ns is not None:
        for hours in (DOCUMENTED_OFFSET_H, 0):
            if abs(newest_words_ns - hours * _HOUR_NS - hint_ns) <= _HINT_NS:
                return UtcOffset(hours, is_known=True)
    return UtcOffset(DOCUMENTED_OFFSET_H, is_known=False)


class WholeSeconds:
    """Estimate the shift from a capture's stamps to civil time by the whole seconds in messages.

    A message contains the second that has begun, so civil time is at least that: civil time minus
    stamp is at least the largest difference found. The estimate is early by the delay of the first
    message of a second (some 10 ms where epochs are at whole seconds).
    """

    def __init__(self) -> None:
        self._word_ns: int | None = None
        self._newest_ns = 0
        self._shifts_ns: list[int] = []  # one for each new second
        self._stamps: list[tuple[int, int]] = []  # words and stamp of each new second

    def take(self, stamp_ns: int, date_yyyymmdd: int, time_hhmmss: int) -> None:
        """Take a message's date and time words and its stamp, on any timeline."""
        word_ns = utc_from_words(date_yyyymmdd, time_hhmmss, 0)
        self._newest_ns = stamp_ns
        if word_ns is None or word_ns == self._word_ns:
            return
        if self._word_ns is not None:  # the first second may have begun before the capture
            self._shifts_ns.append(word_ns - stamp_ns)
            self._stamps.append((word_ns, stamp_ns))
        self._word_ns = word_ns

    @property
    def shift_ns(self) -> int | None:
        """Return words (as if they were UTC) minus stamps; None until a second began."""
        if not self._shifts_ns:
            return None
        middle = median_low(self._shifts_ns)
        return max(shift for shift in self._shifts_ns if abs(shift - middle) <= _ASTRAY_NS)

    @property
    def seconds_ns(self) -> list[tuple[int, int]]:
        """Return the intervals between new seconds: by the words, and by the stamps."""
        pairs = zip(self._stamps[:-1], self._stamps[1:], strict=True)
        return [(new[0] - old[0], new[1] - old[1]) for old, new in pairs]

    @property
    def newest_ns(self) -> int | None:
        """Return the time of the newest message; None until a second began.

        It is the time by the words as if they were UTC.
        """
        shift_ns = self.shift_ns
        return None if shift_ns is None else self._newest_ns + shift_ns
