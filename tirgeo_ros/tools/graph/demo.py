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
"""Run the node graph on a recorded flight and write a video, a still and a summary."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from pathlib import Path
from statistics import fmean, median
from typing import TextIO

import cv2

from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.types.errors import BagError, GraphError
from tirgeo_ros.core.types.missing_package import needed, needed_extra
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import check_outputs, named_files, write_files
from tirgeo_ros.io.maps import map_files
from tirgeo_ros.io.messages.topics import PICTURES
from tirgeo_ros.io.video.video_file import VideoFile
from tirgeo_ros.tools.graph import find_resource
from tirgeo_ros.tools.graph.node_graph import (
    AWAITED,
    GraphSetup,
    NodeProcess,
    free_domain,
    run_graph,
    show_graph,
)
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.graph_outputs import (
    OVERLAY,
    Outputs,
    differences,
    in_plane,
    read_outputs,
    read_pictures,
)
from tirgeo_ros.tools.replay.node_configs import node_configs

SAMPLE = "bags/sample"
_NAMES = ("recording.mcap", "overlay.mp4", "still.png", "summary.json")
#: Fraction of the flight at which the still is taken: the filter has settled and sees the map.
_STILL_AT = 2 / 3
#: Poses are compared with the truth only from this time on.
SETTLED_S = 10.0


def demonstrate(setup: GraphSetup, progress: Report = silent) -> dict[str, object]:
    """Run the graph, write video and still to ``setup.folder``, and return the summary.

    Its ``error`` is None, or tells what was lost of a damaged bag. Raise GraphError if a node
    fails, and BagError if the bag cannot be played.
    """
    reader = BagReader(setup.bag)
    absent = [f"/{topic}" for topic in AWAITED if f"/{topic}" not in reader.topics()]
    if absent:
        raise BagError(f"{setup.bag}: needed topic absent: {', '.join(absent)}")
    first_ns, last_ns = reader.span_ns
    run = run_graph(setup, (last_ns - first_ns) * 1e-9, progress)
    outputs = read_outputs(run.recording).earlier(run.shift_ns)
    files = make_pictures(run.recording, setup.folder, len(outputs.frame_stamps_ns))
    frames_in = sum(1 for _ in reader.messages([f"/{name}" for name in PICTURES]))
    result: dict[str, object] = {"bag": str(setup.bag), **files, "frames_in": frames_in}
    result["serial"] = setup.serial
    result |= summary(outputs, first_ns)
    cores = run.cores | {"total": sum(run.cores.values())}
    result |= {"play_s": run.play_s, "cpu_s": run.cpu_s, "cores": cores}
    result["camera_against_truth"] = against_truth(outputs, setup.bag.with_name("truth.mcap"))
    result["error"] = run.error
    text = json.dumps(result, indent=2) + "\n"
    write_files({setup.folder / "summary.json": text}, GraphError)
    return result


def show_page(setup: GraphSetup, listen: str, cot: str, out: TextIO) -> dict[str, object]:
    """Show the flight on the operator's page until Ctrl-C; return the folder of its targets.

    Write to ``out`` the page's address, and a line for each node that ended and is started again.
    Raise GraphError if a node does not start.
    """
    folder = setup.folder / "page"
    folder.mkdir(parents=True, exist_ok=True)
    values = {"listen": listen, "cot": cot}
    page: dict[str, object] = {name: value for name, value in values.items() if value}
    page |= {"targets": folder / "targets.gpkg", "record_to": folder / "recordings"}

    def on_ready(viewer: NodeProcess) -> None:
        lines = [line for line in viewer.text().splitlines() if not line.startswith("[")]
        out.write("\n".join([*lines, "Ctrl-C ends it\n"]))
        out.flush()

    with suppress(KeyboardInterrupt):
        show_graph(setup, page, on_ready, out.write)
    return {"page": str(folder), "bag": str(setup.bag)}


def demo_setup(
    bag: Path | None,
    folder: Path,
    params: Path | None,
    map_file: Path | None,
    method: str | None,
    rate: float,
    *,
    serial: bool,
    page: bool = False,
) -> GraphSetup:
    """Return the set-up of a bag (None: the sample flight) with the files beside it.

    Raise BagError if the sample is not installed, and GraphError if a map does not exist, an
    output would overwrite an input, or a package is missing for ``serial``, for ``page`` or, if
    there is none, for the video.
    """
    if serial:
        needed("serial", "--serial", GraphError)
    if page:
        needed_extra("page", "--page", GraphError)
    else:
        needed("av", f"writing {folder / 'overlay.mp4'}", GraphError)
    bag = bag or find_resource(f"{SAMPLE}/flight.mcap")
    if bag is None:
        raise BagError(f"{SAMPLE}/flight.mcap is not installed: give a bag with --bag")
    names = ("params.yaml", "map.geojson", "truth.mcap")
    beside = {name: path for name in names if (path := bag.with_name(name)).is_file()}
    params, map_file = params or beside.get("params.yaml"), map_file or beside.get("map.geojson")
    for name in named_files(str(map_file or "")):
        if not Path(name).exists():
            raise GraphError(f"{name}: there is no such map; check its name")
    files = (*node_configs(params).files, *map_files(str(map_file or "")))
    outputs = [folder / name for name in _NAMES]
    check_outputs((bag, *beside.values(), params, *files), outputs, GraphError)
    domain = {"ROS_DOMAIN_ID": str(free_domain())}
    options = ([params] if params else [], map_file, method, rate, serial)
    return GraphSetup(bag.absolute(), folder.absolute(), *options, environment=domain)


def make_pictures(recording: Path, folder: Path, frames: int) -> dict[str, object]:
    """Write ``overlay.mp4`` and ``still.png`` from a recording.

    Raise GraphError without a frame.
    """
    if not frames:
        raise GraphError(f"{recording}: has no {OVERLAY}: read the nodes' logs beside it")
    video, still = folder / "overlay.mp4", folder / "still.png"
    with VideoFile(video) as film:
        for number, (stamp_ns, pixels) in enumerate(read_pictures(recording)):
            film.add(stamp_ns, pixels)
            if number == int(frames * _STILL_AT):
                write_files({still: cv2.imencode(".png", pixels)[1].tobytes()}, GraphError)
    return {"video": str(video), "still": str(still), "frames_out": frames}


def summary(outputs: Outputs, begin_ns: int) -> dict[str, object]:
    """Return numbers from the nodes' states, with units in their names.

    ``begin_ns`` is the log time at which the bag begins.
    """
    first_ns = outputs.cameras[0].stamp_ns if outputs.cameras else math.inf
    mapped = [stamp for stamp in outputs.frame_stamps_ns if stamp >= first_ns]
    pictures = outputs.topic("overlay_node", "tirgeo/overlay/image")
    frame_ms = [topic.latency_ms for topic in pictures if topic.latency_ms is not None]
    navigation = outputs.navigation
    sigmas = [math.degrees(status.heading_sigma_rad) for status in navigation]
    sigmas = [sigma for sigma in sigmas if math.isfinite(sigma)]
    return {
        "method": navigation[-1].method if navigation else None,
        "state": navigation[-1].state.value if navigation else None,
        "overlay": dict(outputs.counts("overlay_node")),
        "first_map_after_s": (mapped[0] - begin_ns) * 1e-9 if mapped else None,
        "heading_sigma_deg": fmean(sigmas) if sigmas else None,
        "frame_latency_ms": median(frame_ms) if frame_ms else None,
    }


def against_truth(outputs: Outputs, truth: Path) -> dict[str, object] | None:
    """Return rms errors of the camera poses, or None without a truth."""
    if outputs.plane is None or not truth.is_file():
        return None
    true = read_outputs(truth)
    if true.plane is None or not true.cameras:
        return None
    settled_ns = outputs.cameras[0].stamp_ns + SETTLED_S * 1e9
    poses = [
        in_plane(pose, outputs.plane, true.plane)
        for pose in outputs.cameras
        if pose.stamp_ns >= settled_ns
    ]
    apart = differences(poses, true.cameras)
    if not apart.stamp_ns:
        return None
    return {
        "from_s": SETTLED_S,
        "poses": len(apart.stamp_ns),
        "position_rms_m": float(rms(apart.distance_m)),
        "attitude_rms_deg": math.degrees(float(rms(apart.angle_rad))),
        "heading_rms_deg": math.degrees(float(rms(apart.rotation_n[:, 2]))),
    }
