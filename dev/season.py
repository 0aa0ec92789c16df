"""Measure ``tirgeo process`` over many flights: ``python -m dev.season FOLDER``.

Simulates flights without pictures into the folder (once), and processes them with one worker and
with two, in turn, several rounds: the quickest of each counts. Then it kills workers while they
work. All outputs must have the bytes of the flights processed one by one. The exit code is 1 if a
figure is missed.
"""

from __future__ import annotations

import argparse
import filecmp
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import date, timedelta
from functools import partial
from pathlib import Path
from typing import Any

from dev.judging import Figure, in_processes, print_figures
from tirgeo_ros.core.types.errors import ManyFlightsError
from tirgeo_ros.io.files.child_process import python_command
from tirgeo_ros.io.files.whole_files import made_folder
from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.replay.process import process
from tirgeo_ros.tools.simulate import simulate
from tirgeo_ros.tools.simulate.scenario import SHAPES

#: Asked of two workers: how much less time they take than one.
ASKED_RATIO = 1.7
_TIRGEO = "from tirgeo_ros.tools.cli.main import console; console()"
_SITES = ((47.40, 8.55), (39.84, 116.71), (-33.45, -70.66))  # degrees
_KILLS = 3
_POLL_S = 0.02


@dataclass(frozen=True)
class Run:
    """Hold what a run over all flights took, and its result."""

    elapsed_s: float
    cpu_s: float  # of all its processes, user and system
    result: dict[str, Any]


def scenario_of(number: int) -> dict[str, Any]:
    """Return the scenario of a flight by its number from 0: site, shape, heading and day."""
    latitude, longitude = _SITES[number % len(_SITES)]
    day = date(2026, 4, 3) + timedelta(days=4 * number)
    return {
        "start_utc": f"{day.isoformat()}T{8 + number % 9:02d}:30:00Z",
        "site": {"latitude_deg": latitude, "longitude_deg": longitude},
        "route": {
            "shape": SHAPES[number % len(SHAPES)],
            "heading_deg": 37.0 * number % 360.0,
        },
    }


def make_flight(folder: Path, seconds: float, number: int) -> Path:
    """Simulate a flight unless it is there; return its bag."""
    place = folder / f"flight_{number + 1:02d}"
    if not (place / "flight.mcap").is_file():
        path = made_folder(place, ManyFlightsError) / "scenario.yaml"
        path.write_text(json.dumps(scenario_of(number)))  # JSON is YAML
        simulate(path, place, seed=number, start_s=25.0, duration_s=seconds, images=False)
    return place / "flight.mcap"


def one_by_one(folder: Path, params: Path, bag: Path) -> Path:
    """Process a flight by itself; return its output."""
    out = made_folder(folder, ManyFlightsError) / f"{bag.parent.name}.mcap"
    process(bag, out, params=params, images=False)
    return out


def season_command(bags: Sequence[Path], out: Path, workers: int) -> list[str]:
    """Return the command that processes the flights without pictures."""
    words = ["--params", str(bags[0].with_name("params.yaml")), "--no-images", "--json"]
    flights = map(str, bags)
    return python_command(
        _TIRGEO, "process", *flights, "-o", str(out), "--workers", str(workers), *words
    )


def timed(bags: Sequence[Path], out: Path, workers: int) -> Run:
    """Process all flights into a new folder."""
    shutil.rmtree(out, ignore_errors=True)
    before, begun_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = season_command(bags, out, workers)
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True)  # noqa: S603  this Python
    elapsed_s, after = time.perf_counter() - begun_s, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return Run(elapsed_s, cpu_s, json.loads(done.stdout))


def with_kills(bags: Sequence[Path], out: Path) -> dict[str, Any]:
    """Process all flights with two workers, some of which are killed; return the result."""
    shutil.rmtree(out, ignore_errors=True)
    command = season_command(bags, out, 2)
    with subprocess.Popen(command, stdout=subprocess.PIPE) as running:  # noqa: S603  this Python
        killed: set[str] = set()  # flights: each loses its worker once
        while running.poll() is None and len(killed) < _KILLS:
            # What a worker has begun to write is named by its flight and its number.
            for path in out.glob(".*.mcap.*.part"):
                flight, number = path.name.split(".")[1], int(path.name.split(".")[3])
                if flight not in killed and len(killed) < _KILLS:
                    with suppress(ProcessLookupError):
                        os.kill(number, signal.SIGKILL)
                        killed.add(flight)
            time.sleep(_POLL_S)
        output, _ = running.communicate()
    result: dict[str, Any] = json.loads(output)
    return result


def different(result: dict[str, Any], alone: Sequence[Path], bags: Sequence[Path]) -> int:
    """Return how many flights have no output, or other bytes than when processed alone."""
    by_input = {one["input"]: one["output"] for one in result["flights"]}
    pairs = [(by_input[str(bag)], path) for bag, path in zip(bags, alone, strict=True)]
    return sum(made is None or not filecmp.cmp(made, path, shallow=False) for made, path in pairs)


def figures(folder: Path, bags: Sequence[Path], rounds: int) -> Iterator[Figure]:
    """Yield the figures of all runs."""
    work = partial(one_by_one, folder / "alone", bags[0].with_name("params.yaml"))
    alone = in_processes(work, bags, os.cpu_count() or 1)
    runs: dict[int, list[Run]] = {1: [], 2: []}
    for _ in range(rounds):
        for workers, timed_runs in runs.items():
            timed_runs.append(timed(bags, folder / f"season_{workers}", workers))
    for workers, timed_runs in runs.items():
        name = f"{workers} worker{'s' if workers > 1 else ''}"
        yield Figure(f"{name}: least time", min(one.elapsed_s for one in timed_runs), "s")
        yield Figure(f"{name}: least CPU", min(one.cpu_s for one in timed_runs), "s")
        other = different(timed_runs[-1].result, alone, bags)
        yield Figure(f"{name}: flights with other bytes", other, "", "= 0")
    one, two = (min(run.elapsed_s for run in runs[workers]) for workers in (1, 2))
    yield Figure("time of one worker over that of two", one / two, "", f">= {ASKED_RATIO:g}")
    result = with_kills(bags, folder / "season_killed")
    again = sum(each["attempts"] - 1 for each in result["flights"])
    yield Figure("workers killed, flights begun again", again, "", f"= {_KILLS}")
    other = different(result, alone, bags)
    yield Figure("after kills: flights lost or with other bytes", other, "", "= 0")


def main(argv: Sequence[str] | None = None) -> int:
    """Make the flights, measure, and print the figures."""
    parser = argparse.ArgumentParser(prog="python -m dev.season")
    parser.add_argument("folder", type=Path, help="for flights and outputs")
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each flight")
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args(argv)
    make = partial(make_flight, args.folder, args.seconds)
    with Progress("simulating", "flights") as bar:
        bags = in_processes(make, range(args.flights), os.cpu_count() or 1, bar)
    load = os.getloadavg()[0]
    sys.stdout.write(f"{len(bags)} flights of {args.seconds:g} s; load before {load:.1f}\n")
    printed = print_figures(figures(args.folder, bags, args.rounds))
    return 1 if any(figure.missed for figure in printed) else 0


if __name__ == "__main__":
    sys.exit(main())
