"""Fly several simulated aircraft through node graphs on this machine, without pictures.

``python -m dev.fleet --aircraft 10 --seconds 60``: each aircraft has a namespace, its own place
and heading, an IMU at 100 Hz, RTK and heading at 5 Hz, joints at 50 Hz. Exit code 1 where a sample
got no pose, or one that stems from another aircraft, or the nodes use more cores than ``--cores``.
"""

from __future__ import annotations

import argparse
import math
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
from dev.judging import MarkedTable, exit_code, print_report
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns
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


@dataclass
class Outputs:
    """Hold what one aircraft's graph gave: stamps (ns) by topic, and places."""

    stamps_ns: dict[str, list[int]] = field(default_factory=lambda: {_ODOMETRY: [], _CAMERA: []})
    place_n: list[Array] = field(default_factory=list)  # of odometry, in its own ``map``
    plane: TangentPlane | None = None


def read_outputs(recording: Path, names: Sequence[str]) -> dict[str, Outputs]:
    """Return what each aircraft's graph gave, from the witness's bag."""
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
    """Hold the verdict on one aircraft."""

    name: str
    imu_sent: int
    aligned_s: float  # from the first sample of the IMU to the first odometry; nan: never
    odometry: int
    odometry_lost: int  # samples of the IMU since then without odometry
    poses: int  # of the camera
    poses_lost: int  # joint samples between the first odometry and the last one without a pose
    crossed: int  # messages that stem from another aircraft's sample, or lie off the own truth
    error_m: float  # the largest distance from the truth; nan: no odometry


def judge(flight: FleetFlight, shift_ns: int, outputs: Outputs) -> Judged:
    """Compare what an aircraft's graph gave with what was played to it."""
    sent = _sent(flight, shift_ns)
    imu, joints = sent["/imu/data"], sent["/gimbal/joint_states"]
    odometry, cameras = outputs.stamps_ns[_ODOMETRY], outputs.stamps_ns[_CAMERA]
    first_ns = min(odometry, default=0)
    errors = _errors_m(flight, shift_ns, outputs)
    # A camera's pose needs the body's before and after it.
    due = {stamp for stamp in joints if first_ns <= stamp <= max(odometry, default=0)}
    foreign = len(set(odometry) - imu) + len(set(cameras) - joints)
    return Judged(
        flight.name,
        len(imu),
        (first_ns - min(imu)) * 1e-9 if odometry else math.nan,
        len(odometry),
        len({stamp for stamp in imu if stamp >= first_ns} - set(odometry)),
        len(cameras),
        len(due - set(cameras)),
        foreign + int((errors > _OFF_M).sum()),
        float(errors.max(initial=0.0)) if odometry else math.nan,
    )


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
    programs = {"one_process": ("--", *nodes)} if together else dict.fromkeys(nodes, ())
    recording, shifts = folder / "recording.mcap", folder / "shifts.json"
    names = [flight.name for flight in flights]
    bags = ",".join(str(flight.bag) for flight in flights)
    with started_graph(folder) as graph:
        for flight in flights:
            words = ("--params-file", str(flight.params), "-r", f"__ns:=/{flight.name}")
            for name, more in programs.items():
                graph.start(name, words=[*words, *more], log=f"{flight.name}_{name}")
        graph.start("fleet_witness", {"aircraft": ",".join(names), "output": recording})
        player = graph.start("fleet_player", {"bags": bags, "output": shifts, "rate": rate})
        await_words(graph.processes, "ready")
        cores, memory_mb = _watch(graph.processes, player, rate, progress)
    moved_ns, outputs = read_json(shifts), read_outputs(recording, names)
    judged = [judge(flight, moved_ns[flight.name], outputs[flight.name]) for flight in flights]
    return FleetRun(cores, memory_mb, judged)


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


_HEAD = ("IMU sent ", "aligned s ", "odometry ", "lost ", "poses ", "lost ", "crossed ", "off m ")


def report(run: FleetRun, cores: float) -> tuple[list[str], int]:
    """Return a line for each aircraft, the cost of all, and the number of missed figures."""
    table = MarkedTable(16, 12)
    lines = [table.row("aircraft", _HEAD)]
    for one in run.judged:
        cells = [f"{one.imu_sent} ", f"{one.aligned_s:.1f} "]
        for came, lost in ((one.odometry, one.odometry_lost), (one.poses, one.poses_lost)):
            cells += [table.cell(came, 1, digits=0), table.cell(lost, high=0, digits=0)]
        cells += [table.cell(one.crossed, high=0, digits=0), table.cell(one.error_m)]
        lines.append(table.row(one.name, cells))
    lines += [table.row(name, [f"{used:.2f} "]) + " cores" for name, used in run.cores.items()]
    whole = table.row("all nodes", [table.cell(run.node_cores, high=cores)])
    return [*lines, f"{whole} cores, {run.memory_mb:.0f} MB"], table.missed


def _run(args: argparse.Namespace) -> int:
    with tempfile.TemporaryDirectory() as made:
        folder = (args.out or Path(made)).absolute()
        with Progress("simulating the flights") as bar:
            flights = make_fleet(folder, args.aircraft, args.seconds, bar)
        nodes, how = args.nodes.split(","), {"together": args.together, "rate": args.rate}
        with Progress("flying", "s") as bar:
            run = run_fleet(folder, flights, nodes, **how, progress=bar)
    return print_report(*report(run, args.cores))


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
    return exit_code("fleet", lambda: _run(args))


if __name__ == "__main__":
    unwind_on_signals()
    sys.exit(main())
