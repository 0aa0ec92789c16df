"""Compare ``tirgeo run`` with a process for each node: the same flight through both, in turn."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dev.judging import Figure
from dev.nodes import package_of
from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.io.files.child_process import python_command
from tirgeo_ros.tools.graph.node_graph import (
    GraphSetup,
    await_words,
    graph_environment,
    node_processes,
    parameter_words,
)
from tirgeo_ros.tools.graph.node_process import NodeProcess
from tirgeo_ros.tools.graph.whole_graph import WholeGraph

_RUNS = 3
_END_S = 300.0
_TIRGEO = "from tirgeo_ros.tools.cli.main import console; console()"


@dataclass(frozen=True)
class Cost:
    """Hold what a run of the graph costs, with a viewer of the compressed picture."""

    cpu_s: float  # of all nodes, from start to end, user and system
    p95_s: float  # from a frame's arrival at another process to that of its picture
    lost: float  # fraction of the frames


def run_figures(folder: Path, work: Path) -> Iterator[Figure]:
    """Yield the figures of both ways to run the graph; the median of each way's runs."""
    graph = WholeGraph(folder / "flight.mcap", folder / "map.geojson", [folder / "params.yaml"])
    runs = [
        (_cost(graph, work, apart=False), _cost(graph, work, apart=True)) for _ in range(_RUNS)
    ]
    cpu_s = []
    for name, costs in zip(
        ("tirgeo run", "separate processes"), zip(*runs, strict=True), strict=True
    ):
        cpu_s.append(float(np.median([cost.cpu_s for cost in costs])))
        yield Figure(f"{name}: CPU on the flight", cpu_s[-1], "s")
        p95_s = float(np.median([cost.p95_s for cost in costs]))
        yield Figure(f"{name}: picture in to out, 95 %", p95_s * 1e3, "ms")
        yield Figure(f"{name}: frames lost", 100 * max(cost.lost for cost in costs), "%")
    share = 100 * cpu_s[0] / cpu_s[1]
    yield Figure("tirgeo run: CPU of the separate processes'", share, "%", "<= 80")


def _cost(graph: WholeGraph, work: Path, *, apart: bool) -> Cost:
    work.mkdir(parents=True, exist_ok=True)
    found = work / "pictures.json"
    environment = graph_environment(GraphSetup(work, work))
    with node_processes() as processes:
        words = parameter_words({"output": found})
        name, log = "bench_pictures", work / "pictures.log"
        processes.append(NodeProcess(name, words, environment, log, package_of(name)))
        await_words(processes, "ready")
        cpu_s = (_apart if apart else _together)(graph, environment, work)
    pictures = json.loads(found.read_text())
    took_s = pictures["took_s"]
    if not took_s:
        raise GraphError(f"no picture came through: see the logs in {work}")
    return Cost(cpu_s, float(np.percentile(took_s, 95)), 1 - len(took_s) / pictures["frames"])


def _together(graph: WholeGraph, environment: Mapping[str, str], work: Path) -> float:
    """Return the processor time (s) of the command, its own start included."""
    given = ("--bag", graph.bag, "--map", graph.map, "--params", *graph.params)
    command = python_command(_TIRGEO, "run", *map(str, given))
    with (work / "run.log").open("wb") as log:
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)  # noqa: S603
        _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise GraphError(f"tirgeo run failed: see {work / 'run.log'}")
    return usage.ru_utime + usage.ru_stime


def _apart(graph: WholeGraph, environment: Mapping[str, str], work: Path) -> float:
    """Return the processor time (s) of a process for each node."""
    with node_processes() as nodes:
        for name in graph.nodes:
            own = parameter_words({"use_sim_time": name != "bag_player"})
            log = work / f"{name}.log"
            nodes.append(NodeProcess(name, [*graph.arguments, *own], environment, log))
        if nodes[-1].wait(_END_S) is None:
            raise GraphError(f"{nodes[-1].name} did not end: {nodes[-1].last_line()}")
    return sum(node.cpu_s() for node in nodes)
