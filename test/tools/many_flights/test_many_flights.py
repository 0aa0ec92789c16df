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
"""tirgeo process over many flights: bytes, what is kept, what fails, what it says at its end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time

import pytest
from process_bags import rewritten

from tirgeo_ros.io.files.child_process import python_command
from tirgeo_ros.tools.cli import main as command
from tirgeo_ros.tools.many_flights.flight_process import FlightProgress
from tirgeo_ros.tools.many_flights.flight_record import FlightTask
from tirgeo_ros.tools.many_flights.many_flights import flights_summary, only_run, summary_lines
from tirgeo_ros.tools.replay.process import process

NAMES = ["east_flight", "west_flight"]
#: A limit, not a wait.
LIMIT_S = 120.0


def parts(folder):
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


def test_each_flight_has_the_bytes_that_it_has_alone(season, flights, sample, tmp_path):
    folder, _, _ = season
    for name, bag in zip(NAMES, flights, strict=True):
        process(bag, tmp_path / "alone.mcap", params=sample / "params.yaml", images=False)
        assert (folder / f"{name}.mcap").read_bytes() == (tmp_path / "alone.mcap").read_bytes()


def test_a_broken_flight_has_its_line_and_stops_nothing(season, broken):
    folder, code, records = season
    assert code == 1
    assert sorted(records) == ["broken", *NAMES]
    assert records["broken"]["error"].startswith(f"{broken}: ")
    assert records["broken"]["output"] is None
    assert [records[name]["error"] for name in NAMES] == [None, None]
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        ["index.html", "broken.json", *(f"{n}{e}" for n in NAMES for e in (".json", ".mcap"))]
    )


def test_links_in_a_loop_and_pipes_fail_alone(flights, run, tmp_path, capsys):
    """Among flights and in the season's folder; a pipe that nobody writes to has no end."""
    loops, pipe, folder = [tmp_path / name for name in "ab"], tmp_path / "d.json", tmp_path / "out"
    for item, other in zip(loops, reversed(loops), strict=True):
        item.symlink_to(other)
    folder.mkdir()
    west = f"{flights[1].parent.name}_{flights[1].stem}"
    for name in ("stray.json", f"{west}.json", f"{west}.jpg"):
        os.mkfifo(folder / name)
    os.mkfifo(pipe)
    assert run([*flights, *loops, pipe], folder, "--json") == 1
    result = json.loads(capsys.readouterr().out)
    errors = {item["input"]: item["error"] for item in result["flights"]}
    assert errors.pop(str(flights[0])) is None
    assert "not a file" in errors.pop(str(flights[1]))
    assert [errors[str(item)].partition(": ")[2] for item in (*loops, pipe)] == [
        *["cannot be read: Too many levels of symbolic links"] * 2,
        "not a file: a pipe or a device cannot be read as a bag",
    ]


def test_finished_flights_are_kept_and_a_folder_has_one_run(season, flights, run, capsys):
    folder, _, _ = season
    before = {path: path.stat().st_mtime_ns for path in folder.glob("*.mcap")}
    assert run(flights, folder, "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["kept"], result["processed"], result["error"]) == (2, 0, None)
    assert {path: path.stat().st_mtime_ns for path in folder.glob("*.mcap")} == before
    page = (folder / "index.html").read_text()
    assert all(name in page for name in [*NAMES, "broken"])  # of earlier runs too
    with only_run(folder):
        assert run(flights, folder) == 1
    assert "another tirgeo process works in this folder" in capsys.readouterr().err
    assert parts(folder) == []


def test_wrong_use_is_one_line(flights, run, tmp_path, capsys):
    assert run(flights[:1], flights[0].parent) == 1
    assert "would overwrite the input" in capsys.readouterr().err
    assert [path.name for path in flights[0].parent.iterdir()] == ["flight.mcap"]
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("ekf_node: {ros__parameters: {metod: ekf}}")
    argv = ["process", *map(str, flights), "-o", str(tmp_path / "out"), "--params", str(wrong)]
    assert command.main(argv) == 1
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    assert "unknown parameter metod" in text


@pytest.mark.slow
def test_pictures_and_videos_have_the_bytes_that_they_have_alone(sample, tmp_path, capsys):
    bags = [
        rewritten(sample / "flight.mcap", tmp_path / f"{name}.mcap", seconds=seconds)
        for name, seconds in (("long", 4.0), ("short", 3.0))
    ]
    arguments = {"params": sample / "params.yaml", "map": sample / "map.geojson"}
    options = [word for name, path in arguments.items() for word in (f"--{name}", str(path))]
    folder = tmp_path / "season"
    assert command.main(["process", *map(str, bags), "-o", str(folder), "--video", *options]) == 0
    for bag in bags:
        alone = tmp_path / f"alone_{bag.name}"
        process(bag, alone, video=alone.with_suffix(".mp4"), **arguments)
        for path in (alone, alone.with_suffix(".mp4")):
            made = folder / path.name.removeprefix("alone_")
            assert made.read_bytes() == path.read_bytes()
    # Without videos the same flights are others' results: they are made anew.
    argv = ["process", *map(str, bags), "-o", str(folder), "--json", *options]
    capsys.readouterr()
    assert command.main(argv) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["processed"] == 2
    (folder / "long.mcap").write_bytes(b"cut")  # an output that is no longer complete
    assert command.main(argv) == 0
    kept = {item["name"]: item["kept"] for item in json.loads(capsys.readouterr().out)["flights"]}
    assert kept == {"long": False, "short": True}


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_end_leaves_finished_files_only(sample, words, tmp_path, number):
    """The second flight is in work when the command is ended."""
    bags = [tmp_path / name for name in ("first.mcap", "second.mcap")]
    rewritten(sample / "flight.mcap", bags[0], seconds=3.0)
    os.link(sample / "flight.mcap", bags[1])
    folder = tmp_path / "season"
    code = "from tirgeo_ros.tools.cli.main import console; console()"
    flights = [*map(str, bags), "-o", str(folder), "--workers", "1"]
    argv = python_command(code, "process", *flights, *words)
    with subprocess.Popen(argv, stderr=subprocess.PIPE, text=True) as running:
        end_s = time.monotonic() + LIMIT_S
        # Not before its first chunk is written: it is well in work then.
        while not any(item.stat().st_size for item in folder.glob(".second.mcap.*.part")):
            assert time.monotonic() < end_s
            assert running.poll() is None
            time.sleep(0.01)
        running.send_signal(number)
        code = running.wait(LIMIT_S)
    assert code == {signal.SIGINT: 130, signal.SIGTERM: 143}.get(number, -number)
    while list(folder.glob(".*.part")):  # of a killed command the kernel tells the child
        assert time.monotonic() < end_s
        time.sleep(0.01)
    assert (folder / "first.mcap").exists()
    assert (folder / "first.json").exists()
    assert not (folder / "second.mcap").exists()
    if number != signal.SIGKILL:
        assert parts(folder) == []
        assert "first" in (folder / "index.html").read_text()


def task(name):
    return FlightTask(name, f"{name}.mcap", "out", ".", {}, "", {})


def record(name, *, output=True, error=None, attempts=1):
    result = {"output": f"out/{name}.mcap", "duration_s": 60.0, "elapsed_s": 4.0} if output else {}
    return {"output": None, "error": error, "season": {"attempts": attempts}} | result


def test_the_summary_counts_each_flight_once():
    records = {
        "a": record("a"),
        "b": record("b", attempts=2),
        "c": record("c"),
        "d": record("d", error="d.mcap: cut off"),
        "e": record("e", output=False, error="e.mcap: no bag"),
    }
    result = flights_summary([task(name) for name in records], ["c"], records)
    counts = {name: result[name] for name in ("processed", "kept", "in_part", "failed")}
    assert counts == {"processed": 2, "kept": 1, "in_part": 1, "failed": 1}
    assert result["error"] == "2 of 5 flights have an error: d, e"
    assert [flight["attempts"] for flight in result["flights"]] == [1, 2, 1, 1, 1]
    amounts = "2 processed, 1 already done, 1 in part, 1 failed"
    lines = summary_lines(result | {"elapsed_s": 12.0, "page": "out/index.html"}).splitlines()
    assert lines == [
        f"  flights  5: {amounts}; 180 s of flight in 12.0 s",
        "! d        d.mcap: cut off",
        "! e        e.mcap: no bag",
        "  page     out/index.html",
    ]
    failed = {name: record(name, output=False, error="x") for name in "abcdef"}
    result = flights_summary([task(name) for name in failed], [], failed)
    assert result["error"] == "6 of 6 flights have an error: a, b, c and 3 more"
    assert flights_summary([task("a")], [], {"a": record("a")})["error"] is None


def test_progress_counts_flights_and_the_parts_of_those_in_work():
    shown = []
    progress = FlightProgress(2, lambda *amounts: shown.append(amounts))
    for part in (0.25, 1.0):
        progress.part("a", part)
        progress.show()
    assert shown == [(0.25, 2), (1.0, 2)]
