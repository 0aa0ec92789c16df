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
"""Measure speed: ``make bench`` runs ``python -m dev.bench`` and prints one table."""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from dev.bench.dji import dji_speeds
from dev.bench.filters import filter_figures, smoother_figures
from dev.bench.graph import graph_figures
from dev.bench.overlay import overlay_times
from dev.bench.pyins import pyins_is_installed
from dev.judging import Figure, exit_code, print_figures
from tirgeo_ros.tools.graph import find_resource
from tirgeo_ros.tools.replay.process import process

#: The fastest of several runs is the one least slowed by other processes.
_RUNS = 3


def figures(folder: Path, work: Path, *, graph: bool) -> Iterator[Figure]:
    """Yield every figure of the flight in ``folder``; files are written to ``work``."""
    yield _process_speed(folder, work, images=False)
    yield _process_speed(folder, work, images=True)
    yield from filter_figures()
    yield from smoother_figures()
    yield from overlay_times()
    yield from dji_speeds()
    if graph:
        yield from graph_figures(folder, work)


def _process_speed(folder: Path, work: Path, *, images: bool) -> Figure:
    speeds = []
    for _ in range(_RUNS):
        begun = time.perf_counter()
        summary = process(
            folder / "flight.mcap",
            work / "out.mcap",
            params=folder / "params.yaml",
            map=folder / "map.geojson",
            images=images,
        )
        duration_s = summary["duration_s"]
        assert isinstance(duration_s, float)
        speeds.append(duration_s / (time.perf_counter() - begun))
    name = "process with images" if images else "process without images"
    return Figure(name, max(speeds), "x real time", ">= 6" if images else ">= 30")


def _run(folder: Path, *, graph: bool, wanted: bool) -> int:
    with tempfile.TemporaryDirectory() as work:
        sys.stdout.write(f"{folder}, {os.cpu_count()} CPUs\n")
        print_figures(figures(folder, Path(work), graph=graph))
    if not graph:
        sys.stdout.write("graph: left out" + (": ROS 2 is not installed\n" if wanted else "\n"))
    if not pyins_is_installed():
        sys.stdout.write("pyins: left out: install with make bench\n")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m dev.bench")
    parser.add_argument("folder", type=Path, nargs="?", metavar="DIR", help="a simulated flight")
    parser.add_argument("--no-graph", action="store_true", help="leave the node graph out")
    args = parser.parse_args(argv)
    folder = args.folder or find_resource("bags/sample")
    if folder is None:
        parser.error("no sample flight is installed: give a folder")
    wanted = not args.no_graph
    graph = wanted and importlib.util.find_spec("rclpy") is not None
    return exit_code("bench", lambda: _run(folder, graph=graph, wanted=wanted))


if __name__ == "__main__":
    sys.exit(main())
