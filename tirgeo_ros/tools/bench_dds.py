"""How old the overlay's pictures are when they reach a viewer over DDS, also on a busy machine."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tirgeo_ros.core.errors import GraphError
from tirgeo_ros.core.samples import Array
from tirgeo_ros.tools.bench_overlay import ABOVE_M, PITCH_DEG, PLANE, beds
from tirgeo_ros.tools.graph import GraphSetup, await_words, graph_environment, node_processes
from tirgeo_ros.tools.node_process import NodeProcess

_RUN_S, _SETTLED_S = 12.0, 3.0
_END_S = 30.0


@dataclass(frozen=True)
class DdsTimes:
    """Of the frames that were sent once all had found each other."""

    p50_s: float  # from a frame's sending to its picture's arrival
    p95_s: float
    lost: int  # frames without a picture
    sent: int
    grown_s: float  # median age in the last third less that in the first


def dds_times(work: Path, spinning: int = 0) -> DdsTimes:
    """Mono8 640x512 at 30 Hz with poses at 50 Hz and 1e4 vertices in view, through overlay_node.

    ``spinning`` processes keep the machine busy meanwhile. ``work`` takes files. Raises GraphError
    where a node ends early or no picture with lines comes out.
    """
    work.mkdir(parents=True, exist_ok=True)
    _write_map(work / "map.geojson")
    environment = graph_environment(GraphSetup(work, work))
    with node_processes() as nodes, _busy(spinning):
        for name, values in _settings(work).items():
            words = [word for key, value in values.items() for word in ("-p", f"{key}:={value}")]
            nodes.append(NodeProcess(name, words, environment, work / f"{name}.log"))
            await_words(nodes, "ready")
        for node in nodes[1:]:
            if node.wait(_RUN_S + _END_S) is None:
                raise GraphError(f"{node.name} did not end: {node.last_line()}")
    return _times(work)


def _settings(work: Path) -> dict[str, dict[str, object]]:
    """The nodes in the order of their start, the one that is measured first."""
    origin = [PLANE.latitude_rad, PLANE.longitude_rad, PLANE.height_m]
    overlay = {"map": work / "map.geojson", "ground_height_m": PLANE.height_m}
    viewer = {"duration_s": _RUN_S + 2.0, "output": work / "shown.json"}
    source = {"duration_s": _RUN_S, "output": work / "sent.json", "origin_rad_m": origin}
    return {
        "overlay_node": overlay,
        "bench_viewer": viewer,
        "bench_video": {**source, "camera_m_deg": [ABOVE_M, PITCH_DEG]},
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
def _busy(number: int) -> Iterator[None]:
    spinning = [
        subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) for _ in range(number)
    ]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def _times(work: Path) -> DdsTimes:
    found = json.loads((work / "shown.json").read_text())
    if not found["lines"]:
        raise GraphError("overlay_node gave no picture with lines")
    sent = np.array(json.loads((work / "sent.json").read_text())["sent"])
    sent = sent[sent > sent[0] + _SETTLED_S * 1e9]
    stamps, ages = np.array(found["shown"]).T
    ages = ages[np.isin(stamps, sent)] * 1e-9
    third = len(ages) // 3
    if not third:
        raise GraphError("overlay_node gave next to no pictures")
    p50, p95 = np.percentile(ages, [50, 95])
    grown = np.median(ages[-third:]) - np.median(ages[:third])
    return DdsTimes(float(p50), float(p95), len(sent) - len(ages), len(sent), float(grown))
