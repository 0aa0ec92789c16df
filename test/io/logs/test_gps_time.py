"""GPS time to UTC, against dates that others have published."""

from __future__ import annotations

from datetime import datetime, timezone

import pytest

from tirgeo_ros.io.logs.gps_time import unix_ns_of_gps, unix_ns_of_week


def utc_ns(text):
    return int(datetime.fromisoformat(text).replace(tzinfo=timezone.utc).timestamp()) * 10**9


@pytest.mark.parametrize(
    ("week", "tow_s", "utc"),
    [
        (0, 0, "1980-01-06T00:00:00"),
        (1024, 0, "1999-08-21T23:59:47"),  # the first roll-over: 13 s
        (1973, 6448, "2017-10-29T01:47:10"),
        (2048, 0, "2019-04-06T23:59:42"),  # the second: 18 s
    ],
)
def test_weeks(week, tow_s, utc):
    assert unix_ns_of_week(week, tow_s * 10**9) == utc_ns(utc)


def test_the_leap_second_itself():
    """2016-12-31T23:59:60 was 17 s behind GPS's 00:00:17; from the next second on it is 18."""
    midnight = utc_ns("2017-01-01T00:00:00")
    assert unix_ns_of_gps(midnight + 16 * 10**9) == midnight - 10**9
    assert unix_ns_of_gps(midnight + 18 * 10**9) == midnight
    assert unix_ns_of_gps(midnight + 18 * 10**9 + 5) == midnight + 5
