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
"""Times of logs, wrong digits in them, and whose topics a receiver's samples become."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta, timezone

import numpy as np
import pytest
from foreign_logs import OPTIONS, by_topic, read_table
from hypothesis import given, strategies as st
from project import PROJECT

from tirgeo_ros.core.streams.stamps import lone_stamps
from tirgeo_ros.io.logs.csv_log import read_csv
from tirgeo_ros.io.logs.log_contents import (
    SECOND_NS,
    utc_ns,
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
        ((1981, 7, 1), 1),
        ((1999, 1, 2), 13),
        ((2006, 1, 1), 14),
        ((2016, 12, 31), 17),
        ((2017, 1, 1), 18),
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


@pytest.mark.parametrize(
    ("text", "local", "offset_s"),
    [
        ("2024-06-11T07:44:39Z", (2024, 6, 11, 7, 44, 39, 0), 0),
        ("2024-06-11 07:44:39.25+02:00", (2024, 6, 11, 7, 44, 39, 250_000), 7200),
        ("2025/08/28 17:30:39.749", (2025, 8, 28, 17, 30, 39, 749_000), None),
        ("HOME(1.0,2.0) 2017.8.5 14:11:51", (2017, 8, 5, 14, 11, 51, 0), None),
        ("2022-08-07 13:40:40,774,808\n", (2022, 8, 7, 13, 40, 40, 774_808), None),
        ("2024-06-11 07:44:39.25+02", (2024, 6, 11, 7, 44, 39, 250_000), 7200),  # SQL
        ("2024-06-11T07:44:39.2500000000-03:30", (2024, 6, 11, 7, 44, 39, 250_000), -12600),
        ("2022-03-14 13:03:45.8 UTC+03:00", (2022, 3, 14, 13, 3, 45, 800_000), 10800),
        ("2022-03-14 13:03:45 UTC", (2022, 3, 14, 13, 3, 45, 0), 0),
        ("2022.06.21 16:06:17\n-12.5", (2022, 6, 21, 16, 6, 17, 0), None),
        ("2024-06-11 07:44:39 +0200", (2024, 6, 11, 7, 44, 39, 0), 7200),
        ("2016-12-31 23:59:60", (2017, 1, 1, 0, 0, 0, 0), None),
    ],
)
def test_written_times(text, local, offset_s):
    result = written_time(text)
    *fields, micros = local
    assert result == (unix_ns(*fields) + micros * 1000, offset_s)


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
    result = written_time(text)
    expected = (moment.replace(tzinfo=UTC) - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(
        seconds=1
    )
    assert result is not None
    assert result.local_ns == expected * SECOND_NS + nanos


def test_offsets():
    texts = ("+02:00", "-0330", "Z", "+02", "-8")
    assert [zone_offset_s(t) for t in texts] == [7200, -12600, 0, 7200, -28800]
    for text in ("2", "+15:00", "+02:60", "CET"):
        with pytest.raises(ValueError, match=text.replace("+", r"\+")):
            zone_offset_s(text)


S = 1_000_000_000
FROM_START = "time: {counts: start, column: t, unit: ms}\npressure: {column: p, unit: Pa}\n"


def stamps(contents, topic):
    return [sample.stamp_ns for sample in by_topic(contents)[topic]]


def airdata(path):
    return read_csv(
        path, replace(OPTIONS, columns=PROJECT / "config" / "columns" / "airdata.yaml")
    )


@pytest.mark.parametrize("row", [1, 2, 300, 651])
@pytest.mark.parametrize(
    ("column", "spoil"),
    [
        (1, lambda date: date[:17] + ("59" if date[17] != "5" else "09")),
        (1, lambda date: date.replace("2023", "2053")),
        (0, lambda count: str(int(count) - 20_000)),
        (0, lambda count: f"9{count}"),
    ],
    ids=["seconds of a date", "year of a date", "an early counter", "a digit before a counter"],
)
def test_the_dates_of_most_rows_decide(shared, tmp_path, row, column, spoil):
    whole = shared / "foreign_logs" / "dji" / "airdata_2023-12-22_with_DJI_0031.csv"
    lines = whole.read_text(encoding="utf-8-sig").splitlines()
    cells = lines[row].split(",")
    cells[column] = spoil(cells[column])
    lines[row] = ",".join(cells)
    path = tmp_path / "damaged.csv"
    path.write_text("\n".join(lines))
    result, right = airdata(path), airdata(whole)
    for topic in ("gps/fix", "gps/vel", "gimbal/attitude"):
        expected = stamps(right, topic)
        assert len(expected) == 651
        assert stamps(result, topic) == expected[: row - 1] + expected[row:]
    reason = "its date and count contradict those of most rows"
    names = ("gps_position", "gps_velocity", "gimbal_attitude")
    assert {result.refused[name, reason] for name in names} == {1}


@pytest.mark.parametrize("off_ms", [-20_000, -500, 20_000])
def test_a_wrong_count_in_the_first_row_does_not_move_the_others(tmp_path, off_ms):
    """``--start-time`` is the time of the first row, whose count others tell."""
    counts = [5000 + 10 * k for k in range(50)]
    counts[0] += off_ms
    table = "t,p\n" + "".join(f"{t},{1e5 + t}\n" for t in counts)
    result = stamps(read_table(tmp_path, table, FROM_START), "baro/pressure")
    assert result[-49:] == [OPTIONS.start_ns + 10_000_000 * k for k in range(1, 50)]


def test_a_pause_after_the_first_rows_is_none(tmp_path):
    """Of a log whose rows come unevenly the first one has the start time."""
    counts = [0, 13, 14, 40, 45, 300, 302, 309, 310, 333]
    table = "t,p\n" + "".join(f"{t},{1e5 + t}\n" for t in counts)
    result = stamps(read_table(tmp_path, table, FROM_START), "baro/pressure")
    assert result == [OPTIONS.start_ns + 1_000_000 * t for t in counts]


@pytest.mark.parametrize("place", [0, 1, 2, 50, 97, 98, 99])
@pytest.mark.parametrize("off_s", [-900.0, -1.5, 1.5, 900.0])
def test_a_stamp_that_jumps_alone(place, off_s):
    steady = np.arange(100) * S // 100
    stamps_ns = steady.copy()
    stamps_ns[place] += round(off_s * S)
    assert np.flatnonzero(lone_stamps(stamps_ns)).tolist() == [place]
    assert not lone_stamps(steady).any()


@pytest.mark.parametrize("step_s", [0.0025, 0.2, 1.0, 5.0])
def test_gaps_and_clocks_that_are_set_are_no_lone_jumps(step_s):
    steps = np.full(100, step_s)
    steps[[20, 60, 61]] = 10.0, 30.0, 40.0  # the last two about a single sample
    steps[[40, 80]] = -700.0, 0.0
    stamps_ns = 10**18 + np.cumsum(steps * S).astype(np.int64)
    assert not lone_stamps(stamps_ns).any()
    assert not lone_stamps(stamps_ns[:4]).any()
    assert not lone_stamps([]).any()
