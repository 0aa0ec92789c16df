"""How old the overlay's pictures are when they reach a viewer over DDS, also on a busy machine."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dev.bench_overlay import ABOVE_M, PITCH_DEG, PLANE, beds
from dev.nodes import package_of
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.io.files.child_process import python_command
from tirgeo_ros.tools.graph.node_graph import (
    GraphSetup,
    await_words,
    graph_environment,
    node_processes,
)
from tirgeo_ros.tools.graph.node_process import NodeProcess

#: On a busy machine the nodes find each other within 4 s.
_RUN_S, _SETTLED_S = 14.0, 5.0
_END_S = 30.0


@dataclass(frozen=True)
class DdsTimes:
    """Of the frames that were sent once all had found each other."""

    p50_s: float  # from a frame's sending to its picture's arrival
    p95_s: float
    lost: int  # frames without a picture
    sent: int
    grown_s: float  # median age in the last third less that in the first
    cpu_s: float  # processor time of the node a frame, with all that goes beside it
    inside_s: float  # 95 % of its newest pictures, from arrival to leaving; nan without a word


def dds_times(
    work: Path,
    node: str = "overlay_node",
    *,
    jpeg: bool = False,
    spinning: int = 0,
    times: int = 1,
) -> DdsTimes:
    """Mono8 640x512 at 30 Hz with poses at 50 Hz and 1e4 vertices in view, through a node.

    The pictures have as many ``times`` the pixels on each side.

    ``node`` is overlay_node, or bench_relay, which copies the picture and no more: what is left
    of the times is the way there and back. With ``jpeg`` the picture comes out compressed.
    ``spinning`` processes keep the machine busy meanwhile. ``work`` takes files. Raises GraphError
    where a node ends early or the pictures that come out are not those that are wanted.
    """
    work.mkdir(parents=True, exist_ok=True)
    _write_map(work / "map.geojson")
    environment = graph_environment(GraphSetup(work, work))
    with node_processes() as nodes, busy(spinning):
        for name, values in _settings(work, node, times, jpeg=jpeg).items():
            words = [word for key, value in values.items() for word in ("-p", f"{key}:={value}")]
            log = work / f"{name}.log"
            nodes.append(NodeProcess(name, words, environment, log, package_of(name)))
            await_words(nodes, "ready")
        measured, viewer, source = nodes
        before_s = measured.cpu_s()
        _await_end(source)
        spent_s = measured.cpu_s() - before_s
        _await_end(viewer)
    return times_of(_read(work / "sent.json"), _read(work / "shown.json"), node, spent_s)


def _await_end(node: NodeProcess) -> None:
    if node.wait(_RUN_S + _END_S) is None:
        raise GraphError(f"{node.name} did not end: {node.last_line()}")


def _settings(work: Path, node: str, times: int, *, jpeg: bool) -> dict[str, dict[str, object]]:
    """The nodes in the order of their start, the one that is measured first."""
    origin = [PLANE.latitude_rad, PLANE.longitude_rad, PLANE.height_m]
    overlay = {"map": work / "map.geojson", "ground_height_m": PLANE.height_m}
    viewer = {"duration_s": _RUN_S + 2.0, "output": work / "shown.json", "jpeg": jpeg}
    source = {"duration_s": _RUN_S, "output": work / "sent.json", "origin_rad_m": origin}
    return {
        node: overlay if node == "overlay_node" else {},
        "bench_viewer": viewer,
        "bench_video": {**source, "camera_m_deg": [ABOVE_M, PITCH_DEG], "times": times},
    }


def _write_map(path: Path) -> None:
    features = [_outline(feature.label, feature.points) for feature in beds().features]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))


def _outline(label: str, points: Array) -> dict[str, object]:
    """A GeoJSON feature of points (N, 3) latitude, longitude (rad), height."""
    ring = np.degrees(np.concatenate([points, points[:1]])[:, 1::-1]).tolist()
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "properties": {"name": label}, "geometry": geometry}


@contextmanager
def busy(number: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Keep so many processes busy with nothing for as long as the context lasts."""
    spin = python_command("while True: pass")
    spinning = [subprocess.Popen(spin) for _ in range(number)]  # noqa: S603  this very Python
    try:
        yield spinning
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def _read(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text())
    return found


def times_of(
    sent: Mapping[str, Any], shown: Mapping[str, Any], node: str, spent_s: float
) -> DdsTimes:
    """The figures of a run: what ``bench_video`` and ``bench_viewer`` wrote at their ends.

    ``spent_s`` is the processor time of the node meanwhile. Raises GraphError where it gave next
    to no pictures, or overlay_node none with lines.
    """
    if node == "overlay_node" and not shown["lines"]:
        raise GraphError("overlay_node gave no picture with lines")
    stamps = np.array(sent["sent"], np.int64)
    counted = stamps[stamps > stamps[0] + _SETTLED_S * 1e9] if len(stamps) else stamps
    seen, ages = np.array(shown["shown"], np.int64).reshape(-1, 2).T
    ages_s = ages[np.isin(seen, counted)] * 1e-9
    third = len(ages_s) // 3
    if not third:
        raise GraphError(f"{node} gave next to no pictures")
    p50_s, p95_s = np.percentile(ages_s, [50, 95]).tolist()
    grown_s = float(np.median(ages_s[-third:]) - np.median(ages_s[:third]))
    lost, cpu_s = len(counted) - len(ages_s), spent_s / len(stamps)
    inside_s = shown["inside_ms"] * 1e-3
    return DdsTimes(p50_s, p95_s, lost, len(counted), grown_s, cpu_s, inside_s)
