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
"""Measure ekf_node with an IMU at 400 Hz: ``python -m dev.bench.imu_load --minutes 10``.

The age of a pose is from its stamp, that of the IMU sample, to its arrival in another process. It
holds what the sender is late by, which is shown too. With ``--odometry 0`` nobody listens.
For another minute a bare subscriber of rclpy, which takes the same samples and does nothing, runs
beside the filter: a computer that others share changes its speed from minute to minute, but hardly
their ratio. The ages are of the time before.
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
from dev.graphs import await_end, memory_mib, read_json, started_graph
from dev.judging import Figure, exit_code, percentile, print_figures
from tirgeo_ros.core.types.arrays import IntArray
from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.tools.graph.node_graph import NodeProcess
from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.simulate.files import parameters_text

#: Until then the nodes find each other and the filter aligns; counted is what comes later.
_SETTLED_S = 20.0
_BESIDE_S = 60.0  # with the bare subscriber
_AFTER_S = 5.0  # the viewer listens longer than the source sends
_POLL_S = 0.5
_ODOMETRY = "tirgeo/odometry"


class Load(NamedTuple):
    """Hold what a run gave, of the samples after the first 20 s, before the bare subscriber."""

    ages_ns: IntArray  # (N,) from the stamp of a pose to its arrival, ns; empty if nobody listens
    late_ns: IntArray  # (N,) from the stamp of an IMU sample to its sending, ns
    lost: int  # IMU samples, of all that were sent, of which the filter reports no verdict
    cores: float  # of ekf_node
    resident_mib: float  # memory of ekf_node at the end, shared memory of DDS in it
    cores_beside: float  # of ekf_node beside the bare subscriber
    bare_cores: float


def measured(work: Path, duration_s: float, rate_hz: float, odometry_hz: float) -> Load:
    """Run the filter, its source and a viewer; raise GraphError if one ends early."""
    params = work / "params.yaml"
    params.write_text(parameters_text(LoopedFlight(rate_hz).scenario))
    came, sent = work / "came.json", work / "sent.json"
    whole_s = _SETTLED_S + duration_s + _SETTLED_S + _BESIDE_S
    listened = {"topics": _ODOMETRY, "output": came, "duration_s": whole_s + 2 * _AFTER_S}
    played = {"output": sent, "duration_s": whole_s + _AFTER_S, "rate_hz": rate_hz}
    with started_graph(work) as graph:
        rates = {"publish_rate_hz": odometry_hz} if odometry_hz else {}
        ekf = graph.start_ready("ekf_node", rates, "--params-file", str(params))
        viewer = graph.start_ready("bench_listener", listened) if odometry_hz else None
        source = graph.start_ready("bench_imu", played)
        (cores,) = _cores([ekf], source, _SETTLED_S, duration_s)
        bare = graph.start("bench_bare")
        beside = _cores([ekf, bare], source, _SETTLED_S, _BESIDE_S)
        resident_mib = memory_mib(ekf.pid)
        await_end(source, _AFTER_S + 30.0)
        if viewer is not None:
            await_end(viewer, _AFTER_S + 30.0)
    arrived = read_json(came)["arrivals"][_ODOMETRY] if odometry_hz else ()
    source_wrote = read_json(sent)
    rows, use = _pairs(source_wrote["sent"]), (cores, resident_mib, *beside)
    return load_of(rows, _pairs(arrived), source_wrote["counted"], duration_s, *use)


def _pairs(rows: Any) -> IntArray:
    return np.array(rows, np.int64).reshape(-1, 2)


def _cores(
    nodes: Sequence[NodeProcess], source: NodeProcess, settled_s: float, duration_s: float
) -> list[float]:
    """Return the cores that nodes use in ``duration_s``, after the first ``settled_s``."""
    begun_s, before = time.monotonic(), np.zeros(1 + len(nodes))
    with Progress("the filter under load", unit="s") as bar:
        while (passed_s := time.monotonic() - begun_s) < settled_s + duration_s:
            for node in (*nodes, source):
                node.check_running()
            bar(passed_s, settled_s + duration_s)
            now = np.array([passed_s, *(node.cpu_s() for node in nodes)])
            if not before[0] and passed_s >= settled_s:
                before = now
            time.sleep(_POLL_S)
    spent_s, *used_s = (now - before).tolist()
    return [used / spent_s for used in used_s]


def load_of(sent: IntArray, came: IntArray, counted: int, duration_s: float, *use: float) -> Load:
    """Return the figures of (N, 2) stamps with times of sending, and of arrival, ns.

    ``counted`` is the number of IMU samples of which the filter reports a verdict, ``use`` are the
    last fields of ``Load``. Only what was sent in ``duration_s`` after the first 20 s is timed.
    """
    since_s = (sent[:, 0] - sent[0, 0]) * 1e-9 - _SETTLED_S
    settled = sent[(since_s > 0) & (since_s < duration_s)]
    if not len(settled):
        raise GraphError("next to nothing was sent: make the run longer than 30 s")
    came = came[np.isin(came[:, 0], settled[:, 0])]
    late_ns = settled[:, 1] - settled[:, 0]
    return Load(came[:, 1] - came[:, 0], late_ns, len(sent) - counted, *use)


def figures(load: Load, rate_hz: float) -> Iterator[Figure]:
    """Yield the table's lines."""
    name, is_heard = f"ekf_node, IMU at {rate_hz:g} Hz", bool(len(load.ages_ns))
    for share, wanted in ((50, ""), (99, "<= 4"), (100, "")) if is_heard else ():
        age_ms = percentile(load.ages_ns, share) * 1e-6
        yield Figure(f"{name}: stamp to odometry, {share} %", age_ms, "ms", wanted)
    late_ms = percentile(load.late_ns, 99) * 1e-6
    yield Figure("the sender's lateness, 99 %", late_ms, "ms")
    yield Figure(f"{name}: one core", 100 * load.cores, "%", "<= 18" if is_heard else "<= 14")
    yield Figure("a bare subscriber beside it: one core", 100 * load.bare_cores, "%")
    ratio = load.cores_beside / load.bare_cores
    yield Figure(f"{name}: over the bare one", ratio, "", "<= 3" if is_heard else "<= 2.33")
    yield Figure(f"{name}: samples lost", load.lost, "", "= 0")
    yield Figure(f"{name}: memory", load.resident_mib, "MiB", "<= 90")


def _run(minutes: float, rate_hz: float, odometry_hz: float) -> int:
    with tempfile.TemporaryDirectory() as work:
        load = measured(Path(work), 60 * minutes, rate_hz, odometry_hz)
    print_figures(figures(load, rate_hz))
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python -m dev.bench.imu_load", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--rate", type=float, default=400.0, metavar="HZ", help="of the IMU")
    parser.add_argument(
        "--odometry", type=float, default=100.0, metavar="HZ", help="rate of poses; 0: unheard"
    )
    args = parser.parse_args(argv)
    return exit_code("imu_load", lambda: _run(args.minutes, args.rate, args.odometry))


if __name__ == "__main__":
    sys.exit(main())
