"""What a run says at its end, and while it goes on."""

from __future__ import annotations

import io

from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.season.flight_task import FlightTask
from tirgeo_ros.tools.season.local_workers import Board
from tirgeo_ros.tools.season.season_summary import season_lines, season_summary


def task(name):
    return FlightTask(name, f"{name}.mcap", "out", ".", {}, "", {})


def record(name, *, output=True, error=None, attempts=1):
    found = {"output": f"out/{name}.mcap", "duration_s": 60.0, "elapsed_s": 4.0} if output else {}
    return {"output": None, "error": error, "season": {"attempts": attempts}} | found


def test_the_summary_counts_each_flight_once():
    records = {
        "a": record("a"),
        "b": record("b", attempts=2),
        "c": record("c"),
        "d": record("d", error="d.mcap: cut off"),
        "e": record("e", output=False, error="e.mcap: no bag"),
    }
    found = season_summary([task(name) for name in records], ["c"], records)
    counts = {name: found[name] for name in ("processed", "kept", "in_part", "failed")}
    assert counts == {"processed": 2, "kept": 1, "in_part": 1, "failed": 1}
    assert found["error"] == "2 of 5 flights have an error: d, e"
    assert [one["attempts"] for one in found["flights"]] == [1, 2, 1, 1, 1]
    told = "2 processed, 1 already done, 1 in part, 1 failed"
    lines = season_lines(found | {"elapsed_s": 12.0, "page": "out/index.html"}).splitlines()
    assert lines == [
        f"  flights  5: {told}; 180 s of flight in 12.0 s",
        "! d        d.mcap: cut off",
        "! e        e.mcap: no bag",
        "  page     out/index.html",
    ]


def test_of_many_errors_the_first_are_named():
    names = "abcdef"
    records = {name: record(name, output=False, error="x") for name in names}
    found = season_summary([task(name) for name in names], [], records)
    assert found["error"] == "6 of 6 flights have an error: a, b, c and 3 more"
    good = season_summary([task("a")], [], {"a": record("a")})
    assert good["error"] is None


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_the_bar_has_all_flights_and_names_those_in_work():
    times = iter([0.0, 10.0, 20.0])
    terminal = Terminal()
    bar = Progress("processing", "flights", stream=terminal, clock=lambda: next(times))
    board = Board(8, bar)
    for name in ("one", "two"):
        board.done(name)
    for name in ("four", "three"):
        board.part(name, 0.5)
    board.show()
    assert "four, three [#######" in terminal.getvalue()
    assert "3.00 of 8.00 flights" in terminal.getvalue()
    board.in_work("abcde")
    board.show()
    assert "a, b, c and 2 more [#####" in terminal.getvalue()


def test_a_board_without_a_bar_reports_numbers():
    told = []
    board = Board(2, lambda *amounts: told.append(amounts))
    board.part("a", 0.25)
    board.show()
    board.done("a")
    board.show()
    assert told == [(0.25, 2), (1, 2)]
