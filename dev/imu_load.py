"""Measure ekf_node with an IMU at 400 Hz: ``python -m dev.imu_load --minutes 10``.

The age of a pose is from its stamp, that of the IMU sample, to its arrival in another process. It
holds what the sender is late by, which is shown too.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dev.judging import Figure, line
from dev.looped_flight import hover
from dev.nodes import package_of
from tirgeo_ros.core.types.arrays import IntArray
from tirgeo_ros.core.types.errors import GraphError, TirgeoError
from tirgeo_ros.tools.graph.node_graph import (
    GraphSetup,
    NodeProcess,
    await_words,
    graph_environment,
    node_processes,
)
from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.simulate.files import parameters_text

#: Until then the nodes find each other and the filter aligns; counted is what comes later.
_SETTLED_S = 20.0
_AFTER_S = 5.0  # the viewer listens longer than the source sends
_POLL_S = 0.5


class Load(NamedTuple):
    """Hold what a run gave, of the samples after the first 20 s."""

    ages_ns: IntArray  # (N,) from the stamp of a pose to its arrival, ns
    late_ns: IntArray  # (N,) from the stamp of an IMU sample to its sending, ns
    lost: int  # IMU samples without a pose
    cores: float  # of ekf_node


def measured(work: Path, duration_s: float, rate_hz: float) -> Load:
    """Run the filter, its source and a viewer; raise GraphError if one ends early."""
    params = work / "params.yaml"
    params.write_text(parameters_text(hover(rate_hz)))
    environment = graph_environment(GraphSetup(work, work))
    nodes: dict[str, list[object]] = {
        "ekf_node": ["--params-file", params, "-p", "publish_rate_hz:=1000.0"],
        "bench_odometry": _settings(work / "came.json", duration_s + _AFTER_S),
        "bench_imu": [*_settings(work / "sent.json", duration_s), "-p", f"rate_hz:={rate_hz}"],
    }
    with node_processes() as running:
        for name, words in nodes.items():
            log = work / f"{name}.log"
            given = [str(word) for word in words]
            running.append(NodeProcess(name, given, environment, log, package_of(name)))
            await_words(running, "ready")
        ekf, viewer, source = running
        cores = _cores(ekf, source, duration_s)
        if viewer.wait(_AFTER_S + 30.0) is None:
            raise GraphError(f"bench_odometry did not end: {viewer.last_line()}")
    return load_of(_read(work / "sent.json"), _read(work / "came.json"), cores)


def _settings(written: Path, duration_s: float) -> list[object]:
    return ["-p", f"output:={written}", "-p", f"duration_s:={duration_s}"]


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


def _read(path: Path) -> IntArray:
    return np.array(json.loads(path.read_text()), np.int64).reshape(-1, 2)


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
        age_ms = float(np.percentile(load.ages_ns, share)) * 1e-6
        yield Figure(f"{name}: stamp to odometry, {share} %", age_ms, "ms", wanted)
    late_ms = float(np.percentile(load.late_ns, 99)) * 1e-6
    yield Figure("of this the sender's lateness, 99 %", late_ms, "ms")
    yield Figure(f"{name}: one core", 100 * load.cores, "%", "<= 30")
    yield Figure(f"{name}: samples without a pose", load.lost, f"of {len(load.late_ns)}", "0")


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python -m dev.imu_load", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--rate", type=float, default=400.0, metavar="HZ", help="of the IMU")
    args = parser.parse_args(argv)
    try:
        with tempfile.TemporaryDirectory() as work:
            load = measured(Path(work), 60 * args.minutes + _SETTLED_S, args.rate)
    except (TirgeoError, OSError) as error:
        sys.stderr.write(f"imu_load: {error}\n")
        return 1
    for figure in figures(load, args.rate):
        sys.stdout.write(line(figure) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
