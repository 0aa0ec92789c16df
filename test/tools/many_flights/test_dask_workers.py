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
"""Flights on a Dask cluster of real processes, one of which is killed; what cannot work."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from process_bags import IMAGES, rewritten
from project import PROJECT, wait_until

from tirgeo_ros.io.files.child_process import python_command
from tirgeo_ros.tools.many_flights import dask_workers
from tirgeo_ros.tools.many_flights.flight_process import FlightProgress
from tirgeo_ros.tools.replay.process import process

LIMIT_S = 240.0


@contextmanager
def dask_cluster(folder, workers=2):
    """Run a scheduler and workers of one thread; yield its address and the workers' processes.

    Without a nanny: a worker that is killed is gone.
    """
    path, place = folder / "scheduler.json", ["--host", "127.0.0.1", "--port", "0"]
    with ExitStack() as stack:

        def begin(name, *words):
            log = folder / f"{name}{len(words)}.log"
            return stack.enter_context(_process(log, name, *words))

        begin("dask_scheduler", *place, "--scheduler-file", str(path))
        wait_until(lambda: path.exists() and path.read_text().endswith("}"), LIMIT_S)
        address = json.loads(path.read_text())["address"]
        worker = ("dask_worker", address, "--nthreads", "1", "--no-nanny")
        yield address, [begin(*worker) for _ in range(workers)]


@contextmanager
def _process(log, program, *words):
    command = [sys.executable, "-m", f"distributed.cli.{program}", *words, "--no-dashboard"]
    with log.open("ab") as out:
        # The project's folder is where a worker finds tirgeo.
        process = subprocess.Popen(command, cwd=PROJECT, stdout=out, stderr=out)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    pytest.importorskip("distributed")
    with dask_cluster(tmp_path_factory.mktemp("cluster")) as result:
        yield result


def parent_of(number):
    status = Path(f"/proc/{number}/status").read_text()
    return int(re.search(r"^PPid:\s+(\d+)", status, re.MULTILINE)[1])


def written_by(folder):
    """The processes that have a flight in the midst: part of its bag is written."""
    for path in folder.glob(".*.mcap.*.part"):
        with suppress(OSError):
            if path.stat().st_size:
                yield int(path.name.split(".")[-2])


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(cluster, sample, words, tmp_path):
    address, workers = cluster
    bags = [tmp_path / f"{name}.mcap" for name in "abcd"]
    rewritten(sample / "flight.mcap", bags[0], seconds=25.0, without=[IMAGES])
    for bag in bags[1:]:
        os.link(bags[0], bag)
    folder = tmp_path / "season"
    code = "from tirgeo_ros.tools.cli.main import console; console()"
    flights = [*map(str, bags), "-o", str(folder), "--scheduler", address]
    command = python_command(code, "process", *flights, *words, "--json")
    killed = None
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        end_s = time.monotonic() + LIMIT_S
        while killed is None:
            assert time.monotonic() < end_s
            assert running.poll() is None
            for child in written_by(folder):
                killed = parent_of(child)
                os.kill(killed, signal.SIGKILL)
                break
            time.sleep(0.005)
        text, _ = running.communicate(timeout=LIMIT_S)
    assert running.returncode == 0
    assert killed in {worker.pid for worker in workers}
    assert [worker.poll() for worker in workers if worker.pid == killed] == [-signal.SIGKILL]
    assert json.loads(text)["processed"] == len(bags)
    process(bags[0], tmp_path / "alone.mcap", params=sample / "params.yaml", images=False)
    alone = (tmp_path / "alone.mcap").read_bytes()
    for bag in bags:
        assert (folder / bag.name).read_bytes() == alone
    expected = {"index.html", *(f"{n}.{e}" for n in "abcd" for e in ("mcap", "json"))}
    assert {path.name for path in folder.iterdir()} == expected


@pytest.mark.slow
def test_workers_of_another_version_are_refused(
    cluster, run, flights, tmp_path, monkeypatch, capsys
):
    """Before a flight begins; the worker that is left has the version of this tree."""
    monkeypatch.setattr(dask_workers, "__version__", "99.0")
    assert run(flights, tmp_path / "out", "--scheduler", cluster[0]) == 1
    text = capsys.readouterr().err
    assert re.search(r"worker tcp://\S+: has tirgeo \d+\.\S+, another version than this", text)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["index.html"]


def test_a_worker_that_does_not_see_the_folder_is_absent_or_came_later_is_refused(tmp_path):
    class Elsewhere:
        """A cluster whose worker has a file system of its own."""

        def wait_for_workers(self, number, timeout):
            pass

        def run(self, function, folder, on_error):
            assert on_error == "return"
            return {"tcp://10.0.0.9:1": function(folder)}

    with pytest.raises(
        dask_workers.ManyFlightsError, match=r"10.0.0.9:1 does not see .*all workers"
    ):
        dask_workers._check(Elsewhere(), str(tmp_path))

    def wait(number, timeout):
        raise asyncio.TimeoutError

    with pytest.raises(dask_workers.ManyFlightsError, match="the scheduler has no worker"):
        dask_workers._check(SimpleNamespace(wait_for_workers=wait), str(tmp_path))
    came_later = dask_workers.FlightTask("a", "a", str(tmp_path), ".", {}, "", {"version": "99.0"})
    with pytest.raises(dask_workers.ManyFlightsError, match="another version"):
        dask_workers.run_on_worker(came_later)


def test_a_lost_scheduler_is_reported_in_one_line(tmp_path, monkeypatch):
    """The client cancels all flights as soon as it has noticed."""

    def lost(*_):
        raise ConnectionResetError(104, "Connection reset by peer")

    cancelled = Future()
    cancelled.cancel()
    client = SimpleNamespace(
        wait_for_workers=lambda *_, **__: None,
        run=lambda *_, **__: {},
        submit=lambda *_, **__: cancelled,
        cancel=lost,
        status="connecting",
    )
    monkeypatch.setattr(dask_workers, "_client", lambda _: nullcontext(client))
    monkeypatch.setattr(dask_workers, "_SHOW_S", 0.0)
    task = dask_workers.FlightTask("a", "a", str(tmp_path), ".", {}, "", {})
    running = dask_workers.run_on_cluster([task], "tcp://10.0.0.9:8786", FlightProgress(1))
    text = "--scheduler tcp://10.0.0.9:8786: the connection is lost; .* run the same command"
    with pytest.raises(dask_workers.ManyFlightsError, match=text):
        next(running)
    assert not list(tmp_path.iterdir())  # no flight has failed


def test_without_an_address_or_the_package_one_line_says_what_to_do(
    run, flights, tmp_path, monkeypatch, capsys
):
    assert run(flights, tmp_path / "out", "--scheduler", "nonsense") == 1
    assert "--scheduler nonsense: give an address, as tcp://192.168." in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run(flights, tmp_path / "out", "--scheduler", "tcp://127.0.0.1:8786") == 1
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    assert text.endswith('8786 needs distributed: pip install "tirgeo[cluster]"\n')
