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
"""Fly several simulated aircraft through node graphs on this machine, without pictures.

``python -m dev.fleet --aircraft 10 --seconds 60``: each aircraft has a namespace, its own place
and heading, an IMU at 100 Hz, RTK and heading at 5 Hz, joints at 50 Hz. Exit code 1 where a sample
got no pose, or one that stems from another aircraft, or the nodes use more than two cores.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dev.flights import FleetFlight, make_fleet
from dev.graphs import read_json, started_graph
from dev.judging import Figure, exit_code, print_figures
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.tools.cli.main import unwind_on_signals
from tirgeo_ros.tools.graph.node_graph import NodeProcess, await_words
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent

NODES = ("ekf_node", "gimbal_node")
_ODOMETRY, _CAMERA, _ORIGIN = "tirgeo/odometry", "tirgeo/camera_pose", "tirgeo/origin"
#: Farther from its own truth than this, an aircraft is not where it flies.
_OFF_M = 1.0
#: The last poses come within the wait of the gimbal; lost parts are sent again every 3 s.
_SETTLE_S = 3.5
_POLL_S = 0.1
_MOST_CORES = 2.0
_SUMMED = ("imu", "odometry_lost", "joints", "poses_lost", "crossed")


@dataclass
class Outputs:
    """Hold what one aircraft's graph gave: stamps (ns) by topic, and places."""

    stamps_ns: dict[str, list[int]] = field(default_factory=lambda: {_ODOMETRY: [], _CAMERA: []})
    place_n: list[Array] = field(default_factory=list)  # of odometry, in its own ``map``
    plane: TangentPlane | None = None


def read_outputs(recording: Path, names: Sequence[str]) -> dict[str, Outputs]:
    """Return what each aircraft's graph gave, from the recording."""
    cdr, fleet = Cdr(), {name: Outputs() for name in names}
    for item in BagReader(recording).messages():
        name, _, topic = item.topic.lstrip("/").partition("/")
        message = cdr.deserialize(item.data, item.typename)
        if topic == _ORIGIN:
            fleet[name].plane = convert.tangent_plane(message)
            continue
        fleet[name].stamps_ns[topic].append(header_stamp_ns(item.data))
        if topic == _ODOMETRY:
            fleet[name].place_n.append(convert.body_pose(message).position_n)
    return fleet


@dataclass(frozen=True)
class Judged:
    """Hold what an aircraft's graph gave of what was played to it."""

    imu: int
    odometry: int
    odometry_lost: int  # samples of the IMU since the first odometry without one
    joints: int
    poses_lost: int  # of joint samples between the first odometry and the last
    crossed: int  # messages of another aircraft's sample, or off the own truth
    off_m: float  # the largest distance from the truth


def judge(flight: FleetFlight, shift_ns: int, outputs: Outputs) -> Judged:
    """Compare what an aircraft's graph gave with what was played to it."""
    sent = _sent(flight, shift_ns)
    imu, joints = sent["/imu/data"], sent["/gimbal/joint_states"]
    odometry, cameras = (set(outputs.stamps_ns[topic]) for topic in (_ODOMETRY, _CAMERA))
    first_ns, last_ns = min(odometry, default=0), max(odometry, default=0)
    errors = _errors_m(flight, shift_ns, outputs)
    # A camera's pose needs the body's before and after it.
    due = {stamp for stamp in joints if first_ns <= stamp <= last_ns}
    lost = {stamp for stamp in imu if stamp >= first_ns} - odometry
    foreign = len(odometry - imu) + len(cameras - joints) + int((errors > _OFF_M).sum())
    sizes = len(imu), len(odometry), len(lost), len(due), len(due - cameras)
    return Judged(*sizes, foreign, float(errors.max(initial=0.0)))


def _sent(flight: FleetFlight, shift_ns: int) -> dict[str, set[int]]:
    """Return the stamps (ns) of all that was played, by topic."""
    sent: dict[str, set[int]] = {}
    for item in BagReader(flight.bag).messages():
        sent.setdefault(item.topic, set()).add(header_stamp_ns(item.data) + shift_ns)
    return sent


def _errors_m(flight: FleetFlight, shift_ns: int, outputs: Outputs) -> Array:
    """Return how far each odometry lies from the truth at its stamp, m; 0 for another's."""
    if outputs.plane is None or not outputs.place_n:
        return np.zeros(0)
    at = {stamp_ns + shift_ns: row for row, stamp_ns in enumerate(flight.stamp_ns)}
    rows = [at.get(stamp_ns, -1) for stamp_ns in outputs.stamps_ns[_ODOMETRY]]
    place_e = ecef_from_geodetic(*outputs.plane.geodetic_from_ned(np.array(outputs.place_n)))
    off_m = np.linalg.norm(np.asarray(place_e) - flight.place_e[rows], axis=1)
    return np.where(np.array(rows) < 0, 0.0, off_m)


@dataclass(frozen=True)
class FleetRun:
    """Hold what a fleet cost and what came of each aircraft."""

    cores: float  # of all nodes, while the flights were played
    memory_mb: float  # of all nodes, shared pages divided among those that share them
    judged: list[Judged]


def run_fleet(
    folder: Path,
    flights: Sequence[FleetFlight],
    *,
    together: bool = False,
    rate: float = 1.0,
    progress: Report = silent,
) -> FleetRun:
    """Start each aircraft's nodes in its namespace, play the flights, judge what came.

    ``folder`` takes logs and recording; ``rate`` is how fast the flights are played, as a multiple
    of real time. The nodes of an aircraft are a process each, or one ``together``, as ``tirgeo
    run`` has them. Raise GraphError for a node that ends early.
    """
    programs = {"one_process": ("--", *NODES)} if together else dict.fromkeys(NODES, ())
    recording, shifts = folder / "recording.mcap", folder / "shifts.json"
    bags = ",".join(str(flight.bag) for flight in flights)
    with started_graph(folder) as graph:
        for flight in flights:
            words = ("--params-file", str(flight.params), "-r", f"__ns:=/{flight.name}")
            for name, more in programs.items():
                graph.start(name, words=[*words, *more], log=f"{flight.name}_{name}")
        values = {"bags": bags, "shifts": shifts, "recording": recording, "rate": rate}
        player = graph.start("fleet_player", values)
        await_words(graph.processes, "ready")
        cores, memory_mb = _watch(graph.processes[:-1], player, rate, progress)
    moved_ns = read_json(shifts)
    outputs = read_outputs(recording, [flight.name for flight in flights])
    judged = [judge(f, moved_ns[f.name], outputs[f.name]) for f in flights]
    return FleetRun(cores, memory_mb, judged)


def _watch(
    nodes: Sequence[NodeProcess], player: NodeProcess, rate: float, progress: Report
) -> tuple[float, float]:
    """Wait for the end of the flights; return the nodes' cores and memory (MB).

    Cores are processor time (s) by time flown (s).
    """

    def until(word: str) -> tuple[float, float]:
        """Return when the player said a word, and the nodes' processor time by then (s)."""
        while not player.said(word):
            for process in (*nodes, player):
                process.check_running()
            progress(time.monotonic() - begin_s, None)
            time.sleep(_POLL_S)
        return time.monotonic(), sum(process.cpu_s() for process in nodes)

    begin_s = time.monotonic()
    (begin_s, used_s), (end_s, used_at_end_s) = until("playing"), until("played")
    memory_mb = sum(map(_proportional_mb, nodes))
    time.sleep(_SETTLE_S)
    return (used_at_end_s - used_s) / ((end_s - begin_s) * rate), memory_mb


def _proportional_mb(process: NodeProcess) -> float:
    """Return the memory of a process (proc(5), smaps_rollup: Pss)."""
    text = Path(f"/proc/{process.pid}/smaps_rollup").read_text()
    return int(text.partition("\nPss:")[2].split()[0]) / 1024


def figures(run: FleetRun) -> list[Figure]:
    """Return what all aircraft lost and crossed, and what they cost."""
    total = {name: sum(getattr(entry, name) for entry in run.judged) for name in _SUMMED}
    silent = sum(not entry.odometry for entry in run.judged)
    off_m = max(entry.off_m for entry in run.judged)
    return [
        Figure("aircraft without odometry", silent, "", "= 0"),
        Figure("IMU samples", total["imu"]),
        Figure("  without odometry, from the first one on", total["odometry_lost"], "", "= 0"),
        Figure("joint samples between the first odometry and the last", total["joints"]),
        Figure("  without a camera's pose", total["poses_lost"], "", "= 0"),
        Figure("messages crossed", total["crossed"], "", "= 0"),
        Figure("farthest from the truth", off_m, "m"),
        Figure("nodes", run.cores, "cores", f"<= {_MOST_CORES:g}"),
        Figure("nodes, memory", run.memory_mb, "MB"),
    ]


def _run(aircraft: int, seconds: float, *, together: bool) -> int:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        with Progress("simulating the flights") as bar:
            flights = make_fleet(folder, aircraft, seconds, bar)
        with Progress("flying", "s") as bar:
            run = run_fleet(folder, flights, together=together, progress=bar)
    return int(any(figure.missed for figure in print_figures(figures(run))))


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m dev.fleet", description=__doc__)
    parser.add_argument("--aircraft", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=60.0, help="of flight")
    parser.add_argument("--together", action="store_true", help="each aircraft's in one process")
    args = parser.parse_args(argv)
    if args.aircraft < 1 or args.seconds < 10:
        parser.error("at least one --aircraft and ten --seconds")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    return exit_code("fleet", lambda: _run(args.aircraft, args.seconds, together=args.together))


if __name__ == "__main__":
    unwind_on_signals()
    sys.exit(main())
