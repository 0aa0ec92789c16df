"""One wrong digit in one time of a table: it costs its row, and moves no other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from foreign_logs import OPTIONS, by_topic, read_table
from project import PROJECT

from tirgeo_ros.core.streams.stamps import lone_stamps
from tirgeo_ros.io.logs.csv_log import read_csv

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
    found, right = airdata(path), airdata(whole)
    for topic in ("gps/fix", "gps/vel", "gimbal/attitude"):
        expected = stamps(right, topic)
        assert len(expected) == 651
        assert stamps(found, topic) == expected[: row - 1] + expected[row:]
    reason = "its date and count contradict those of most rows"
    names = ("gps_position", "gps_velocity", "gimbal_attitude")
    assert {found.refused[name, reason] for name in names} == {1}


@pytest.mark.parametrize("off_ms", [-20_000, -500, 20_000])
def test_a_wrong_count_in_the_first_row_does_not_move_the_others(tmp_path, off_ms):
    """``--start-time`` is the time of the first row, whose count others tell."""
    counts = [5000 + 10 * k for k in range(50)]
    counts[0] += off_ms
    table = "t,p\n" + "".join(f"{t},{1e5 + t}\n" for t in counts)
    found = stamps(read_table(tmp_path, table, FROM_START), "baro/pressure")
    assert found[-49:] == [OPTIONS.start_ns + 10_000_000 * k for k in range(1, 50)]


def test_a_pause_after_the_first_rows_is_none(tmp_path):
    """Of a log whose rows come unevenly the first one has the start time."""
    counts = [0, 13, 14, 40, 45, 300, 302, 309, 310, 333]
    table = "t,p\n" + "".join(f"{t},{1e5 + t}\n" for t in counts)
    found = stamps(read_table(tmp_path, table, FROM_START), "baro/pressure")
    assert found == [OPTIONS.start_ns + 1_000_000 * t for t in counts]


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
