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
"""Measure the node graph: its processors and the age of its pictures."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dev.bench.overlay import ABOVE_M, PITCH_DEG, PLANE, beds
from dev.graphs import await_end, busy, read_json, started_graph
from dev.judging import Figure
from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.parameters.parameter_file import load_yaml
from tirgeo_ros.tools.graph.node_graph import GraphSetup, run_graph

#: On a busy machine the nodes find each other within 4 s.
_VIDEO_S, _SETTLED_S = 14.0, 5.0
_END_S = 44.0
_LEAST_PICTURES = 3
_OVERLAY, _JPEG = "tirgeo/overlay/image", "tirgeo/overlay/image/compressed"


def graph_figures(folder: Path, work: Path) -> Iterator[Figure]:
    """Yield all figures of the graph on the flight in ``folder``; ``work`` takes files."""
    cores = _cores_of(folder, work / "graph", folder / "params.yaml")
    for name, used in cores.items():
        yield Figure(f"graph: {name}", used, "cores")
    yield Figure("graph: whole, rate 1", sum(cores.values()), "cores", "<= 1.2")
    yield _serial(folder, work / "serial")
    for name, jpeg, times, spinning, wanted in (
        ("overlay over DDS", False, 1, 0, "<= 12"),
        ("overlay over DDS as JPEG", True, 1, 0, "<= 15"),
        ("overlay, 1280x1024", False, 2, 0, "<= 25"),
        ("overlay, 1280x1024 as JPEG", True, 2, 0, ""),
        ("overlay over DDS, busy", False, 1, 2, ""),
    ):
        measured = dds_times(work / name, jpeg=jpeg, spinning=spinning, times=times)
        yield from measured.figures(name, wanted)


def _serial(folder: Path, work: Path) -> Figure:
    """Return the CPU cores of dji_node with hard sync at 400 Hz and all broadcasts at 100 Hz."""
    work.mkdir()
    params = work / "serial.yaml"
    values = load_yaml(folder / "params.yaml")
    player = values.setdefault("/**/bag_player", {"ros__parameters": {}})["ros__parameters"]
    player.setdefault("simulated_aircraft", {})["pushes"] = True
    params.write_text(yaml.safe_dump(values))
    used = _cores_of(folder, work, params, serial=True)["dji_node"]
    return Figure("graph: dji_node, 400 Hz hard sync and 100 Hz", used, "cores", "<= 0.25")


def _cores_of(folder: Path, work: Path, params: Path, *, serial: bool = False) -> dict[str, float]:
    """Return the CPU cores of each process while the bag plays at rate 1."""
    bag, map_file = folder / "flight.mcap", folder / "map.geojson"
    first_ns, last_ns = BagReader(bag).span_ns
    setup = GraphSetup(bag, work, params=[params], map=map_file, serial=serial)
    return run_graph(setup, (last_ns - first_ns) * 1e-9).cores


@dataclass(frozen=True)
class DdsTimes:
    """Hold the times of the frames that were sent once all nodes had found each other."""

    p50_s: float  # from a frame's sending to its picture's arrival
    p95_s: float
    lost: int  # frames without a picture
    sent: int
    cpu_s: float  # processor time of the node a frame, with all that goes beside it

    def figures(self, name: str, wanted: str) -> Iterator[Figure]:
        """Yield the lines of the table."""
        yield Figure(f"{name}: median", self.p50_s * 1e3, "ms")
        yield Figure(f"{name}: 95 %", self.p95_s * 1e3, "ms", wanted)
        yield Figure(f"{name}: node, CPU a frame", self.cpu_s * 1e3, "ms")
        yield Figure(f"{name}: frames lost", 100 * self.lost / self.sent, "%")


def dds_times(work: Path, *, jpeg: bool = False, spinning: int = 0, times: int = 1) -> DdsTimes:
    """Send Mono8 at 30 Hz with poses at 50 Hz and 1e4 vertices in view through overlay_node.

    The pictures are 640x512 ``times`` as many pixels on each side. With ``jpeg`` the picture comes
    out compressed. ``spinning`` processes keep the machine busy meanwhile. ``work`` takes files.
    Raises GraphError where a node ends early or no pictures with lines come out.
    """
    work.mkdir(parents=True, exist_ok=True)
    features = []
    for bed in beds().features:
        ring = np.degrees(np.concatenate([bed.points, bed.points[:1]])[:, 1::-1]).tolist()
        geometry = {"type": "Polygon", "coordinates": [ring]}
        features.append(
            {"type": "Feature", "properties": {"name": bed.label}, "geometry": geometry}
        )
    collection = {"type": "FeatureCollection", "features": features}
    (work / "map.geojson").write_text(json.dumps(collection))
    overlay = {"map": work / "map.geojson", "ground_height_m": PLANE.height_m}
    topic = _JPEG if jpeg else _OVERLAY
    listener = {"topics": topic, "duration_s": _VIDEO_S + 2.0, "output": work / "shown.json"}
    source = {
        "duration_s": _VIDEO_S,
        "output": work / "sent.json",
        "origin_rad_m": [PLANE.latitude_rad, PLANE.longitude_rad, PLANE.height_m],
        "camera_m_deg": [ABOVE_M, PITCH_DEG],
        "times": times,
    }
    with started_graph(work) as graph, busy(spinning):
        measured = graph.start_ready("overlay_node", overlay)
        viewing = graph.start_ready("bench_listener", listener)
        sending = graph.start_ready("bench_video", source)
        before_s = measured.cpu_s()
        await_end(sending, _END_S)
        spent_s = measured.cpu_s() - before_s
        await_end(viewing, _END_S)
    return times_of(read_json(work / "sent.json"), read_json(work / "shown.json"), spent_s)


def times_of(sent: Mapping[str, Any], shown: Mapping[str, Any], spent_s: float) -> DdsTimes:
    """Return the times of a run from what ``bench_video`` and ``bench_listener`` wrote.

    ``spent_s`` is the processor time of the node meanwhile. Raises GraphError where it gave next
    to no pictures, or none with lines.
    """
    if not shown["lines"]:
        raise GraphError("overlay_node gave no picture with lines")
    stamps = np.array(sent["sent"], np.int64)
    counted = stamps[stamps > stamps[0] + _SETTLED_S * 1e9] if len(stamps) else stamps
    (arrivals,) = shown["arrivals"].values()
    pictures, came_ns = np.array(arrivals, np.int64).reshape(-1, 2).T
    ages_s = (came_ns - pictures)[np.isin(pictures, counted)] * 1e-9
    if len(ages_s) < _LEAST_PICTURES:
        raise GraphError("overlay_node gave next to no pictures")
    p50_s, p95_s = np.percentile(ages_s, [50, 95]).tolist()
    lost, cpu_s = len(counted) - len(ages_s), spent_s / len(stamps)
    return DdsTimes(p50_s, p95_s, lost, len(counted), cpu_s)
