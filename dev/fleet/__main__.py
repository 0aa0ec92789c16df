"""Fly several simulated aircraft through node graphs on this machine, without pictures.

``python -m dev.fleet --aircraft 10 --seconds 60``: each aircraft has a namespace, its own place
and heading, an IMU at 100 Hz, RTK and heading at 5 Hz, joints at 50 Hz. Exit code 1 where a sample
got no pose, or one that stems from another aircraft, or the nodes use more cores than ``--cores``.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dev.fleet.flights import FleetFlight, make_fleet
from dev.fleet.judge import Judged, judge, read_heard
from dev.nodes import package_of
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.tools.cli.main import INTERRUPTED, unwind_on_signals
from tirgeo_ros.tools.graph.node_graph import (
    GraphSetup,
    NodeProcess,
    await_words,
    graph_environment,
    node_processes,
)
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent

NODES = ("ekf_node", "gimbal_node")
#: The last poses come within the wait of the gimbal; lost parts are sent again every 3 s.
_SETTLE_S = 3.5
_POLL_S = 0.1


@dataclass(frozen=True)
class FleetRun:
    """Hold what a fleet cost and what came of each aircraft."""

    cores: dict[str, float]  # by kind of process, while the flights were played
    memory_mb: float  # of all nodes, shared pages divided among those that share them
    judged: list[Judged]

    @property
    def node_cores(self) -> float:
        """Return the cores that the product's nodes used."""
        return sum(cores for name, cores in self.cores.items() if not name.startswith("fleet_"))


def run_fleet(
    folder: Path,
    flights: Sequence[FleetFlight],
    nodes: Sequence[str] = NODES,
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
    environment = graph_environment(GraphSetup(folder, folder))
    programs = {"one_process": ("--", *nodes)} if together else dict.fromkeys(nodes, ())
    recording, shifts = folder / "recording.mcap", folder / "shifts.json"
    with node_processes() as processes:

        def start(name: str, log: str, *words: str) -> NodeProcess:
            path = folder / f"{log}.log"
            processes.append(NodeProcess(name, words, environment, path, package_of(name)))
            return processes[-1]

        for flight in flights:
            words = ("--params-file", str(flight.params), "-r", f"__ns:=/{flight.name}")
            for name, more in programs.items():
                start(name, f"{flight.name}_{name}", *words, *more)
        names = [flight.name for flight in flights]
        bags = ",".join(str(flight.bag) for flight in flights)
        start("fleet_witness", "witness", *_words(aircraft=",".join(names), output=recording))
        player = start("fleet_player", "player", *_words(bags=bags, output=shifts, rate=rate))
        await_words(processes, "ready")
        cores, memory_mb = _watch(processes, player, rate, progress)
    moved_ns, heard = json.loads(shifts.read_text()), read_heard(recording, names)
    judged = [judge(flight, moved_ns[flight.name], heard[flight.name]) for flight in flights]
    return FleetRun(cores, memory_mb, judged)


def _words(**values: object) -> list[str]:
    return [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]


def _watch(
    processes: Sequence[NodeProcess], player: NodeProcess, rate: float, progress: Report
) -> tuple[dict[str, float], float]:
    """Wait for the end of the flights; return the cores by kind of node, and the memory (MB).

    Cores are processor time (s) by time flown (s).
    """
    begin_s, before = time.monotonic(), [0.0] * len(processes)
    playing = False
    while not player.said("played"):
        if not playing and player.said("playing"):
            playing, begin_s = True, time.monotonic()
            before = [process.cpu_s() for process in processes]
        for process in processes:
            process.check_running()
        progress(time.monotonic() - begin_s, None)
        time.sleep(_POLL_S)
    cores: dict[str, float] = {}
    flown_s = (time.monotonic() - begin_s) * rate
    for process, spent_s in zip(processes, before, strict=True):
        used = (process.cpu_s() - spent_s) / flown_s
        cores[process.name] = cores.get(process.name, 0.0) + used
    memory_mb = sum(map(_proportional_mb, processes))
    time.sleep(_SETTLE_S)
    return cores, memory_mb


def _proportional_mb(process: NodeProcess) -> float:
    """Return the memory of a product's node (proc(5), smaps_rollup: Pss); 0 of the others'."""
    if process.name.startswith("fleet_"):
        return 0.0
    text = Path(f"/proc/{process.pid}/smaps_rollup").read_text()
    return int(text.partition("\nPss:")[2].split()[0]) / 1024


_HEAD = ("aircraft", "IMU sent", "aligned [s]", "odometry", "lost", "poses", "lost", "crossed")


def table(run: FleetRun) -> str:
    """Return a line for each aircraft, and the cost of all."""
    rows = [f"{_HEAD[0]:<10}" + "".join(f"{word:>12}" for word in (*_HEAD[1:], "off [m]"))]
    for one in run.judged:
        counts = (one.odometry, one.odometry_lost, one.poses, one.poses_lost, one.crossed)
        cells = (one.imu_sent, f"{one.aligned_s:.1f}", *counts, f"{one.error_m:.2f}")
        rows.append(f"{one.name:<10}" + "".join(f"{cell:>12}" for cell in cells))
    rows += [f"{name:<16}{cores:>6.2f} cores" for name, cores in run.cores.items()]
    rows.append(f"{'all nodes':<16}{run.node_cores:>6.2f} cores, {run.memory_mb:.0f} MB")
    return "\n".join(rows) + "\n"


def faults(run: FleetRun, cores: float) -> list[str]:
    """Return what is not as it must be, a line each."""
    found = [f"the nodes use more than {cores:g} cores"] if run.node_cores > cores else []
    for one in run.judged:
        if not one.odometry or not one.poses:
            found.append(f"{one.name}: no poses")
        if lost := one.odometry_lost + one.poses_lost:
            found.append(f"{one.name}: {lost} samples without a pose")
        if one.crossed:
            found.append(f"{one.name}: {one.crossed} messages of another, or off the truth")
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m dev.fleet", description=__doc__)
    parser.add_argument("--aircraft", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=60.0, help="of flight")
    parser.add_argument("--cores", type=float, default=2.0, help="that the nodes may use in all")
    parser.add_argument(
        "--rate", type=float, default=1.0, help="less than 1 where the machine has other work"
    )
    parser.add_argument("--nodes", default=",".join(NODES), help="of each aircraft")
    parser.add_argument("--together", action="store_true", help="each aircraft's in one process")
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help="for logs and recording")
    args = parser.parse_args(argv)
    if args.aircraft < 1 or args.seconds < 10:
        parser.error("at least one --aircraft and ten --seconds")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        with tempfile.TemporaryDirectory() as made:
            folder = (args.out or Path(made)).absolute()
            with Progress("simulating the flights") as bar:
                flights = make_fleet(folder, args.aircraft, args.seconds, bar)
            with Progress("flying", "s") as bar:
                run = run_fleet(
                    folder,
                    flights,
                    args.nodes.split(","),
                    together=args.together,
                    rate=args.rate,
                    progress=bar,
                )
    except (TirgeoError, OSError) as error:
        sys.stderr.write(f"fleet: {error}\n")
        return 1
    except KeyboardInterrupt:
        sys.stderr.write("fleet: interrupted\n")
        return INTERRUPTED
    found = faults(run, args.cores)
    sys.stdout.write(table(run) + "".join(f"MISSED: {line}\n" for line in found))
    return 1 if found else 0


if __name__ == "__main__":
    unwind_on_signals()
    sys.exit(main())
