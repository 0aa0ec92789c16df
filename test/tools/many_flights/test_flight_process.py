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
"""A flight in a process of its own: killed, killed each time, stopped, with its cores."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path

import pytest
from process_bags import rewritten

from tirgeo_ros.tools.many_flights.flight_process import (
    ATTEMPTS,
    Stopped,
    core_shares,
    remove_parts,
    run_flight,
)
from tirgeo_ros.tools.many_flights.flight_record import FlightTask, bag_stamps, made_from
from tirgeo_ros.tools.replay.process import process


@pytest.fixture
def task(flights, sample, tmp_path):
    return task_of(flights[0], sample, tmp_path)


def task_of(bag, sample, folder):
    options = {"params": str(sample / "params.yaml"), "images": False, "namespace": ""}
    made = made_from(bag_stamps(bag), options, {})
    return FlightTask("one", str(bag), str(folder), str(Path.cwd()), options, "", made)


def child_of(folder):
    """The number of the process that writes the flight's bag."""
    (part,) = folder.glob(".one.mcap.*.part")
    return int(re.fullmatch(r"\.one\.mcap\.(\d+)\.part", part.name)[1])


def killer(folder, times):
    """Return a report that kills the flight's process, some times; and whom it killed."""
    killed = []

    def report(part):
        if len(killed) < times and 0 <= part < 1:
            killed.append(child_of(folder))
            os.kill(killed[-1], signal.SIGKILL)

    return report, killed


@pytest.mark.slow
def test_a_killed_process_is_started_again(task, sample, tmp_path):
    report, killed = killer(tmp_path, 1)
    record = run_flight(task, lambda: False, report)
    assert len(killed) == 1
    assert (record["error"], record["season"]["attempts"]) == (None, 2)
    process(task.bag, tmp_path / "alone.mcap", params=sample / "params.yaml", images=False)
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "alone.mcap").read_bytes()
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"alone.mcap", "one.json", "one.mcap"}


@pytest.mark.slow
def test_a_process_that_is_killed_each_time_is_an_error(task, tmp_path):
    report, killed = killer(tmp_path, 99)
    record = run_flight(task, lambda: False, report)
    assert len(killed) == ATTEMPTS
    assert f"ended {ATTEMPTS} times without a result: signal 9 (SIGKILL)" in record["error"]
    assert record["output"] is None
    assert [path.name for path in tmp_path.iterdir()] == ["one.json"]


def painters_of(number):
    """The processes that paint a process's pictures."""
    for children in Path(f"/proc/{number}/task").glob("*/children"):
        for child in map(int, children.read_text().split()):
            if "picture_stage" in Path(f"/proc/{child}/cmdline").read_text():
                yield child


@pytest.mark.slow
@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core: no process for pictures")
def test_a_flight_whose_picture_process_is_killed_is_started_again(sample, tmp_path):
    """This process has the most memory, so a system that is short of it kills it first."""
    bag = rewritten(sample / "flight.mcap", tmp_path / "flight.mcap", seconds=4.0)
    task = task_of(bag, sample, tmp_path)
    task.options.update(images=True, map=str(sample / "map.geojson"))
    killed = []

    def report(_part):
        if not killed:
            killed.extend(painters_of(child_of(tmp_path)))
            os.kill(killed[0], signal.SIGKILL)

    record = run_flight(task, lambda: False, report, sorted(os.sched_getaffinity(0)))
    assert killed
    assert (record["error"], record["season"]["attempts"]) == (None, 2)
    assert record["overlay"]["drawn"] > 10


@pytest.mark.slow
def test_a_stopped_flight_leaves_nothing(sample, tmp_path):
    """Half a minute of flight: it is stopped long before its end."""
    task, begun = task_of(sample / "flight.mcap", sample, tmp_path), []

    def report(_part):
        begun.append(child_of(tmp_path))

    with pytest.raises(Stopped):
        run_flight(task, lambda: bool(begun), report)
    assert begun
    assert list(tmp_path.iterdir()) == []
    assert not Path(f"/proc/{begun[0]}").exists()


def test_only_a_flights_own_unfinished_files_are_removed(task, tmp_path):
    own = [".one.mcap.12.part", ".one.mp4.7.mp4", ".one.json.8.part"]
    others = [".one.two.mcap.12.part", ".oneb.mcap.12.part", "one.mcap", ".one.mcap", ".one.x.1.y"]
    for name in (*own, *others):
        (tmp_path / name).touch()
    remove_parts(task, 12)
    assert {path.name for path in tmp_path.iterdir()} == {*own[1:], *others}
    remove_parts(task)
    assert {path.name for path in tmp_path.iterdir()} == set(others)


@pytest.mark.parametrize(
    ("workers", "flights", "shares"),
    [
        (None, 9, [[0], [1], [4], [5]]),
        (2, 9, [[0, 4], [1, 5]]),
        (3, 9, [[0, 5], [1], [4]]),
        (1, 9, [[0, 1, 4, 5]]),
        (6, 9, [[0], [1], [4], [5], [0], [1]]),
        (None, 2, [[0, 4], [1, 5]]),
    ],
)
def test_workers_share_the_cores(monkeypatch, workers, flights, shares):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 4, 5})
    assert core_shares(workers, flights) == shares
