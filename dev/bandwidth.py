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
"""Measure what each topic takes on a network: bytes of a message, and kbit/s with all overhead.

The sample flight goes through the graph; then each topic is played again over UDP, without shared
memory, to one reader, and the bytes on the loopback are counted. Nobody else may use it meanwhile:

    unshare -rn sh -c 'ip link set lo up && python -m dev.bandwidth'
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from dev.graphs import started_graph
from dev.judging import exit_code, print_report
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.dds_profiles import PROFILES
from tirgeo_ros.tools.graph import find_resource
from tirgeo_ros.tools.graph.node_graph import GraphSetup, await_words, run_graph
from tirgeo_ros.tools.presentation.progress import Progress, Report

RECORDED = (
    *("tirgeo/odometry", "tirgeo/fix", "tirgeo/camera_pose", "tirgeo/overlay/image"),
    *("tirgeo/overlay/image/compressed", "tirgeo/locate/point"),
    *("tirgeo/state", "tirgeo/findings", "/diagnostics"),
)
_FASTER = 3.0  # than real time: what repeats by the clock (heartbeats) counts a third
_PLAYER_S = 120.0


def rows(bag: Path, folder: Path, progress: Report) -> list[str]:
    """Return a row of Markdown for each topic of a bag: rate, size, kbit/s."""
    reader = BagReader(bag)
    counts, sizes = Counter[str](), Counter[str]()
    for item in reader.messages():
        counts[item.topic] += 1
        sizes[item.topic] += len(item.data)
    span_s = (reader.span_ns[1] - reader.span_ns[0]) * 1e-9
    lines = []
    for done, topic in enumerate(sorted(counts), 1):
        rate_hz, mean = counts[topic] / span_s, sizes[topic] / counts[topic]
        on_wire = _bytes_on_loopback(bag, topic, folder) / counts[topic]
        kbit_s = rate_hz * on_wire * 8e-3
        cells = (f"{rate_hz:.1f}", f"{mean:.0f}", f"{on_wire:.0f}", f"{kbit_s:.0f}")
        lines.append(f"| `{topic.lstrip('/')}` | {' | '.join(cells)} |")
        progress(done, len(counts))
    return lines


def _bytes_on_loopback(bag: Path, topic: str, folder: Path) -> int:
    """Play one topic to one reader over UDP; return the bytes that the loopback carried."""
    output = folder / f"{topic.strip('/').replace('/', '_')}.mcap"
    with started_graph(folder) as graph:
        graph.environment[PROFILES[0]] = str(_udp_profile(folder))
        values = {"output": output, "topics": topic}
        graph.start("recorder", values, log=f"{output.stem}_recorder")
        values = {"bag": bag, "topics": topic, "rate": _FASTER}
        player = graph.start("bag_player", values, log=f"{output.stem}_player")
        await_words([player], "playing")
        before = _carried()
        player.wait(_PLAYER_S)
        carried = _carried() - before
    if "played" not in player.text():
        raise BagError(f"{topic} was not played: {player.last_line()}")
    return carried


def _udp_profile(folder: Path) -> Path:
    """Write the profile of localhost without shared memory, and with few peers to call."""
    profile = find_resource("config/fastdds_localhost.xml")
    assert profile is not None
    used = f"{' ' * 8}<transport_id>shared_memory</transport_id>\n"
    text = profile.read_text().replace(used, "").replace("Range>32<", "Range>2<")
    path = folder / "udp.xml"
    path.write_text(text)
    return path


def _carried() -> int:
    """Return the bytes that the loopback has sent so far (proc(5), net/dev)."""
    lines = Path("/proc/net/dev").read_text().splitlines()
    (loopback,) = (line for line in lines if line.strip().startswith("lo:"))
    return int(loopback.split()[9])


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return the exit code."""
    argparse.ArgumentParser(prog="python -m dev.bandwidth", description=__doc__).parse_args(argv)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    return exit_code("bandwidth", _run)


def _run() -> int:
    sample = find_resource("bags/sample")
    assert sample is not None
    with tempfile.TemporaryDirectory() as made, Progress("measuring") as bar:
        folder, bag = Path(made), sample / "flight.mcap"
        setup = GraphSetup(
            bag, folder, [sample / "params.yaml"], sample / "map.geojson", topics=RECORDED
        )
        run = run_graph(setup, 30.0)
        lines = rows(run.recording, folder, bar) + rows(bag, folder, bar)
    head = "| topic | Hz | bytes of a message | bytes on the network | kbit/s |"
    return print_report([head, "| --- | --- | --- | --- | --- |", *lines], 0)


if __name__ == "__main__":
    sys.exit(main())
