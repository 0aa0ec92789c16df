"""Decode the receivers' date and time of day, and place a capture in civil time by them.

The words have whole seconds and come five times a second, so each is right at the first message of
a new second. DJI's headers say that they are in GMT+8.
"""

from __future__ import annotations

from datetime import datetime, timezone
from statistics import median_low

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
    """Return how many hours words are ahead of UTC (8 or 0), by the time of the newest.

    ``hint_ns`` is about that time in UTC, such as that of the file's last change. Returns None if
    neither fits within 2 h.
    """
    for hours in (DOCUMENTED_OFFSET_H, 0):
        if abs(newest_words_ns - hours * _HOUR_NS - hint_ns) <= _HINT_NS:
            return hours
    return None


class WholeSeconds:
    """Estimate the shift from a capture's stamps to civil time by the whole seconds in messages.

    A message contains the second that has begun, so civil time is at least that: civil time minus
    stamp is at least the largest difference found. The estimate is early by the delay of the first
    message of a second (some 10 ms where epochs are at whole seconds).
    """

    def __init__(self) -> None:
        self._word_ns: int | None = None
        self._shifts_ns: list[int] = []  # one for each new second
        self.newest_ns = 0  # newest stamp

    def take(self, stamp_ns: int, date_yyyymmdd: int, time_hhmmss: int) -> None:
        """Take a message's date and time words and its stamp, on any timeline."""
        word_ns = time_of_words(date_yyyymmdd, time_hhmmss)
        self.newest_ns = stamp_ns
        if word_ns is None or word_ns == self._word_ns:
            return
        if self._word_ns is not None:  # the first second may have begun before the capture
            self._shifts_ns.append(word_ns - stamp_ns)
        self._word_ns = word_ns

    @property
    def number(self) -> int:
        """Return how many seconds began."""
        return len(self._shifts_ns)

    @property
    def shift_ns(self) -> int | None:
        """Return words (in their own time zone) minus stamps; None until a second began."""
        if not self._shifts_ns:
            return None
        middle = median_low(self._shifts_ns)
        return max(shift for shift in self._shifts_ns if abs(shift - middle) <= _ASTRAY_NS)
