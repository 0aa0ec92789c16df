"""Measure ekf_node with an IMU at 400 Hz: ``python -m dev.bench.imu_load --minutes 10``.

The age of a pose is from its stamp, that of the IMU sample, to its arrival in another process. It
holds what the sender is late by, which is shown too.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dev.flights import LoopedFlight
from dev.graphs import await_end, read_json, started_graph
from dev.judging import Figure, exit_code, percentile, print_figures
from tirgeo_ros.core.types.arrays import IntArray
from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.tools.graph.node_graph import NodeProcess
from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.simulate.files import parameters_text

#: Until then the nodes find each other and the filter aligns; counted is what comes later.
_SETTLED_S = 20.0
_AFTER_S = 5.0  # the viewer listens longer than the source sends
_POLL_S = 0.5
_ODOMETRY = "tirgeo/odometry"


class Load(NamedTuple):
    """Hold what a run gave, of the samples after the first 20 s."""

    ages_ns: IntArray  # (N,) from the stamp of a pose to its arrival, ns
    late_ns: IntArray  # (N,) from the stamp of an IMU sample to its sending, ns
    lost: int  # IMU samples without a pose
    cores: float  # of ekf_node


def measured(work: Path, duration_s: float, rate_hz: float) -> Load:
    """Run the filter, its source and a viewer; raise GraphError if one ends early."""
    params = work / "params.yaml"
    params.write_text(parameters_text(LoopedFlight(rate_hz).scenario))
    came, sent = work / "came.json", work / "sent.json"
    listened = {"topics": _ODOMETRY, "output": came, "duration_s": duration_s + _AFTER_S}
    played = {"output": sent, "duration_s": duration_s, "rate_hz": rate_hz}
    with started_graph(work) as graph:
        fast = {"publish_rate_hz": 1000.0}
        ekf = graph.start_ready("ekf_node", fast, "--params-file", str(params))
        viewer = graph.start_ready("bench_listener", listened)
        source = graph.start_ready("bench_imu", played)
        cores = _cores(ekf, source, duration_s)
        await_end(viewer, _AFTER_S + 30.0)
    arrived = read_json(came)["arrivals"][_ODOMETRY]
    return load_of(_pairs(read_json(sent)), _pairs(arrived), cores)


def _pairs(rows: Any) -> IntArray:
    return np.array(rows, np.int64).reshape(-1, 2)


def _cores(ekf: NodeProcess, source: NodeProcess, duration_s: float) -> float:
    """Return the cores that the filter uses from its settling until the source ends."""
    begun_s, settled = time.monotonic(), (0.0, 0.0)
    with Progress("the filter under load", unit="s") as bar:
        while source.poll() is None:
            ekf.check_running()
            now_s = time.monotonic() - begun_s
            bar(now_s, duration_s)
            if not settled[0] and now_s > _SETTLED_S:
                settled = now_s, ekf.cpu_s()
            time.sleep(_POLL_S)
    return (ekf.cpu_s() - settled[1]) / (time.monotonic() - begun_s - settled[0])


def load_of(sent: IntArray, came: IntArray, cores: float) -> Load:
    """Return the figures of (N, 2) stamps with times of sending, and of arrival, ns."""
    sent = sent[sent[:, 0] > sent[0, 0] + _SETTLED_S * 1e9]
    came = came[np.isin(came[:, 0], sent[:, 0])]
    if not len(came):
        raise GraphError("ekf_node gave no pose: make the run longer than 30 s")
    lost = len(sent) - len(np.unique(came[:, 0]))
    return Load(came[:, 1] - came[:, 0], sent[:, 1] - sent[:, 0], lost, cores)


def figures(load: Load, rate_hz: float) -> Iterator[Figure]:
    """Yield the table's lines."""
    name = f"ekf_node, IMU at {rate_hz:g} Hz"
    for share, wanted in ((50, ""), (99, "<= 5"), (100, "")):
        age_ms = percentile(load.ages_ns, share) * 1e-6
        yield Figure(f"{name}: stamp to odometry, {share} %", age_ms, "ms", wanted)
    late_ms = percentile(load.late_ns, 99) * 1e-6
    yield Figure("of this the sender's lateness, 99 %", late_ms, "ms")
    yield Figure(f"{name}: one core", 100 * load.cores, "%", "<= 30")
    yield Figure(f"{name}: samples without a pose", load.lost, f"of {len(load.late_ns)}", "= 0")


def _run(minutes: float, rate_hz: float) -> int:
    with tempfile.TemporaryDirectory() as work:
        load = measured(Path(work), 60 * minutes + _SETTLED_S, rate_hz)
    print_figures(figures(load, rate_hz))
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python -m dev.bench.imu_load", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--rate", type=float, default=400.0, metavar="HZ", help="of the IMU")
    args = parser.parse_args(argv)
    return exit_code("imu_load", lambda: _run(args.minutes, args.rate))


if __name__ == "__main__":
    sys.exit(main())
