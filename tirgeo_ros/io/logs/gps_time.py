"""Convert GPS time to UTC: GPS time has no leap seconds, and is ahead of UTC by them."""

from __future__ import annotations

import bisect
from datetime import date

_DAY_NS, _WEEK_NS = 86_400_000_000_000, 604_800_000_000_000
#: 1980-01-06, where GPS time begins, in ns of Unix time.
_GPS_EPOCH_NS = (date(1980, 1, 6) - date(1970, 1, 1)).days * _DAY_NS
#: The first days (UTC) behind each leap second since then (IERS, Bulletin C). A leap second after
#: the last of them makes times behind it late by one second.
_AFTER_LEAPS = tuple(
    (date.fromisoformat(day) - date(1970, 1, 1)).days * _DAY_NS
    for day in (
        *("1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01"),
        *("1991-01-01", "1992-07-01", "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01"),
        *("1999-01-01", "2006-01-01", "2009-01-01", "2012-07-01", "2015-07-01", "2017-01-01"),
    )
)
#: In GPS time counted as if it were Unix time, each is later by the leap seconds so far.
_AFTER_LEAPS_GPS = tuple(at + (k + 1) * 10**9 for k, at in enumerate(_AFTER_LEAPS))


def unix_ns_of_gps(gps_ns: int) -> int:
    """Return ns of Unix time (UTC) of a GPS time counted in ns as if it were Unix time."""
    return gps_ns - bisect.bisect_right(_AFTER_LEAPS_GPS, gps_ns) * 10**9


def unix_ns_of_week(week: int, tow_ns: int) -> int:
    """Return ns of Unix time (UTC) of a whole GPS week (without roll-over) and time of week."""
    return unix_ns_of_gps(_GPS_EPOCH_NS + week * _WEEK_NS + tow_ns)
