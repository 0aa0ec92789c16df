"""GPS time to UTC through every leap second, and dates as logs write them."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.io.logs.log_contents import (
    SECOND_NS,
    utc_ns,
    utc_ns_of_week,
    written_time,
    zone_offset_s,
)

UTC = timezone.utc


def unix_ns(*fields):
    return round(datetime(*fields, tzinfo=UTC).timestamp()) * SECOND_NS


@pytest.mark.parametrize(
    ("day", "ahead_s"),
    [
        ((1980, 1, 7), 0),
        ((1981, 6, 30), 0),
        ((1981, 7, 1), 1),
        ((1999, 1, 2), 13),
        ((2005, 12, 31), 13),
        ((2006, 1, 1), 14),
        ((2015, 7, 1), 17),
        ((2016, 12, 31), 17),
        ((2017, 1, 1), 18),
        ((2025, 8, 28), 18),
    ],
)
def test_gps_time_is_ahead_as_the_bulletins_say(day, ahead_s):
    assert utc_ns(unix_ns(*day) + ahead_s * SECOND_NS) == unix_ns(*day)


def test_the_change_is_at_the_leap_second_itself():
    """23:59:60 UTC, which Unix time does not have, is the second before midnight's stamp."""
    midnight = unix_ns(2017, 1, 1)
    assert utc_ns(midnight + 18 * SECOND_NS) == midnight
    assert utc_ns(midnight + 18 * SECOND_NS - 1) == midnight + SECOND_NS - 1
    assert utc_ns(midnight + 17 * SECOND_NS - 1) == midnight - 1


def test_weeks_count_on_and_have_the_leap_seconds():
    """Of a DataFlash log: week 1973, 6448 s of it, is 2017-10-29 01:47:10 UTC."""
    assert utc_ns_of_week(1973, 6448 * SECOND_NS) == unix_ns(2017, 10, 29, 1, 47, 10)


@pytest.mark.parametrize(
    ("text", "local", "offset_s", "whole"),
    [
        ("2024-06-11T07:44:39Z", (2024, 6, 11, 7, 44, 39, 0), 0, True),
        ("2024-06-11 07:44:39.25+02:00", (2024, 6, 11, 7, 44, 39, 250_000), 7200, False),
        ("2025/08/28 17:30:39.749", (2025, 8, 28, 17, 30, 39, 749_000), None, False),
        ("HOME(1.0,2.0) 2017.8.5 14:11:51", (2017, 8, 5, 14, 11, 51, 0), None, True),
        ("2022-08-07 13:40:40,774,808\n", (2022, 8, 7, 13, 40, 40, 774_808), None, False),
        ("2024-06-11 07:44:39.25+02", (2024, 6, 11, 7, 44, 39, 250_000), 7200, False),  # SQL
        ("2024-06-11T07:44:39.2500000000-03:30", (2024, 6, 11, 7, 44, 39, 250_000), -12600, False),
        ("2022-03-14 13:03:45.8 UTC+03:00", (2022, 3, 14, 13, 3, 45, 800_000), 10800, False),
        ("2022-03-14 13:03:45 UTC", (2022, 3, 14, 13, 3, 45, 0), 0, True),
        ("2022.06.21 16:06:17\n-12.5", (2022, 6, 21, 16, 6, 17, 0), None, True),
        ("2024-06-11 07:44:39 +0200", (2024, 6, 11, 7, 44, 39, 0), 7200, True),
        ("2016-12-31 23:59:60", (2017, 1, 1, 0, 0, 0, 0), None, True),
    ],
)
def test_written_times(text, local, offset_s, whole):
    found = written_time(text)
    *fields, micros = local
    assert found == (unix_ns(*fields) + micros * 1000, offset_s, whole)


@pytest.mark.parametrize(
    "text",
    [
        *("", "2024-06-11", "2024-13-11 07:44:39", "2024-06-11 25:44:39", "12:30:00 61"),
        *("2024-06-11 07:44:39.125 PM", "2024-06-11 07:44:39am", "2024-06-11 7:44:39 p.m."),
    ],
)
def test_what_is_no_time(text):
    assert written_time(text) is None


@given(st.datetimes(datetime(1981, 1, 1), datetime(2037, 1, 1)), st.integers(0, 999_999_999))  # noqa: DTZ001  naive on purpose
def test_what_is_written_is_read(moment, nanos):
    moment = moment.replace(microsecond=0)
    text = f"{moment:%Y/%m/%d %H:%M:%S}.{nanos:09}"
    found = written_time(text)
    expected = (moment.replace(tzinfo=UTC) - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(
        seconds=1
    )
    assert found is not None
    assert found.local_ns == expected * SECOND_NS + nanos


def test_offsets():
    texts = ("+02:00", "-0330", "Z", "+02", "-8")
    assert [zone_offset_s(t) for t in texts] == [7200, -12600, 0, 7200, -28800]
    for text in ("2", "+15:00", "+02:60", "CET"):
        with pytest.raises(ValueError, match=text.replace("+", r"\+")):
            zone_offset_s(text)
