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
"""Serve the page in a process of its own, with pictures of a flight at 30 Hz, and view it."""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import aiohttp
import cv2
import numpy as np

from dev.graphs import memory_mib
from tirgeo_ros.core.config.viewer_parameters import ViewerConfig
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages import stamp_ns
from tirgeo_ros.io.messages.cdr import Cdr
from tirgeo_ros.io.messages.pictures import camera, compressed_pixels
from tirgeo_ros.io.messages.shapes_codec import written_shapes
from tirgeo_ros.io.targets.store import TargetStore
from tirgeo_ros.page.actions import Click, Pixel
from tirgeo_ros.page.server import PageServer
from tirgeo_ros.page.video import HEADER
from tirgeo_ros.tools.replay.graph_outputs import read_outputs
from tirgeo_ros.tools.replay.node_configs import configured_layers, node_configs
from tirgeo_ros.tools.replay.process import process

HZ = 30.0
MAP_NAME = "map.geojson"  # of the page, in the folder of a page that is served
_OPEN = replace(ViewerConfig(), listen="127.0.0.1:0")
_ANSWER_S = 0.005
_INFO, _FRAMES = "/thermal/camera_info", "/thermal/image_raw/compressed"
_LATE_NS = 1_000_000_000
_STATE = {
    "navigation": {"state": "running", "reason": ""},
    "position": [39.85, 116.7, 70.0],
    "footprint": [[39.85, 116.7], [39.851, 116.7], [39.851, 116.701], [39.85, 116.701]],
    "verdict": {"word": "GO", "tone": "good", "kind": "", "text": "", "more": "", "alarm": False},
}
_SETTLE_S = 4.0  # not counted: the link is found out
_CLICK_EVERY_S = 0.5
_SLEEP_S = 0.05


class ServedPage:
    """Be a process that serves the page until the end of the context."""

    def __init__(self, pictures: Path, work: Path, config: ViewerConfig = _OPEN) -> None:
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(pictures, work, config, theirs))

    def __enter__(self) -> ServedPage:
        """Start, and wait until the page can be opened."""
        self._process.start()
        self.url = str(self._ours.recv())
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self._ours.send("end")
        self._process.join(10)

    def cpu_s(self) -> float:
        """Return the CPU time of the process so far."""
        self._ours.send("cpu")
        return float(self._ours.recv())

    def memory_mib(self, field: str) -> float:
        """Return ``VmRSS`` or ``VmHWM`` of the process: what it has in memory, or had at most."""
        return memory_mib(self._process.pid or 0, field)


class _Level:
    """Answer clicks at once: what overlay_node takes is measured elsewhere."""

    def __init__(self, targets: TargetStore, vector_map: bytes) -> None:
        self.targets, self._map = targets, vector_map

    async def click(self, click: Click) -> Located | str:
        await asyncio.sleep(_ANSWER_S)
        place = (39.85 + click.v * 1e-6, 116.7 + click.u * 1e-6, 30.0)
        return Located(click.stamp_ns, *place, (0.1, 0, 0, 0, 0.1, 0, 0, 0, 0.1))

    async def where(self, aircraft: str, latitude_deg: float, longitude_deg: float) -> Pixel | str:
        return f"{aircraft} does not see {latitude_deg} {longitude_deg}"

    async def record(self, aircraft: str, on: bool) -> str:
        return f"{aircraft} records: {on}"

    async def share(self, on: bool) -> str:
        return f"shares: {on}"

    def vector_map(self, aircraft: str) -> bytes:
        return b"" if aircraft else self._map


def draw_pictures(flight: Path, work: Path) -> Path:
    """Write a flight's clean pictures and their shapes to a folder below ``work``; return it."""
    bag, pictures = work / "poses.mcap", work / "pictures"
    params, map_file = flight / "params.yaml", flight / "map.geojson"
    process(flight / "flight.mcap", bag, params=params, images=False)
    config = node_configs(params, map=map_file).overlay
    outputs, cdr = read_outputs(bag), Cdr()
    overlay = Overlay(config, configured_layers(config))
    assert outputs.plane is not None
    overlay.set_plane(outputs.plane)
    pictures.mkdir()
    poses = iter(outputs.cameras)
    for item in BagReader(flight / "flight.mcap").messages([_INFO, _FRAMES]):
        message = cdr.deserialize(item.data, item.typename)
        if item.topic == _INFO:
            overlay.set_camera(camera(message))
            continue
        stamp = stamp_ns(message)
        for pose in poses:
            overlay.poses.add(pose)
            if pose.stamp_ns > stamp:
                break
        overlay.add_frame(stamp, compressed_pixels(message), stamp)
        if picture := overlay.take_unpainted(stamp + _LATE_NS):
            clean = overlay.painter.clean(picture)
            shapes = written_shapes(overlay.painter.shapes(picture), clean.pixels, clean.celsius)
            name = f"{len([*pictures.glob('*.jpg')]):05}"
            jpeg = cv2.imencode(".jpg", clean.pixels, [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
            (pictures / f"{name}.jpg").write_bytes(jpeg.tobytes())
            (pictures / f"{name}.shapes").write_bytes(shapes.to_bytes())
    return pictures


def pictures_in(folder: Path) -> list[tuple[bytes, bytes]]:
    """Return the JPEGs of a folder, each with its shapes, if it has any."""
    paths = [(path, path.with_suffix(".shapes")) for path in sorted(folder.glob("*.jpg"))]
    return [(jpeg.read_bytes(), s.read_bytes() if s.exists() else b"") for jpeg, s in paths]


def _serve(pictures: Path, work: Path, config: ViewerConfig, theirs: Connection) -> None:
    map_file = work / MAP_NAME
    vector_map = map_file.read_bytes() if map_file.exists() else b"{}"
    backend = _Level(TargetStore(work / "targets.gpkg"), vector_map)
    server = PageServer(backend, config, {"": "aircraft"})
    server.start()
    over = threading.Event()
    feeding = threading.Thread(target=_feed, args=(server, pictures_in(pictures), over))
    feeding.start()
    theirs.send(server.operator_url.partition("?")[0].rstrip("/"))
    while theirs.recv() == "cpu":
        theirs.send(time.process_time())
    over.set()
    feeding.join()
    server.stop()


def _feed(
    server: PageServer, pictures: Sequence[tuple[bytes, bytes]], over: threading.Event
) -> None:
    """Show a picture each 1/30 s and report at 5 Hz, as viewer_node does."""
    begun, count = time.monotonic(), 0
    while not over.wait(max(0.0, begun + count / HZ - time.monotonic())):
        jpeg, shapes = pictures[count % len(pictures)]
        server.show("", time.time_ns(), jpeg, shapes=shapes)
        if count % 6 == 0:
            server.report("", {**_STATE, "track": [[39.85, 116.7 + count * 1e-6]]})
        count += 1


class Job(NamedTuple):
    """Say what a viewer does."""

    url: str
    seconds: float
    clicks: bool = False


class Watched(NamedTuple):
    """Hold what a viewer saw."""

    ages_ms: list[float]  # of each picture when it is decoded
    clicks_ms: list[float]  # from click to answer
    late_ms: list[float]  # of a short sleep: what a busy machine alone does to all of these
    seconds: float

    @property
    def hz(self) -> float:
        """Return pictures a second."""
        return len(self.ages_ms) / self.seconds


def watch(job: Job) -> Watched:
    """Watch for a time."""
    return asyncio.run(_Viewer(job).watch())


def click_text(request: str, stamp_ns: int) -> str:
    """Return a click on the middle of a picture, as the page sends it."""
    click = {"type": "click", "request": request, "aircraft": "", "kind": "person"}
    place = {"stamp_ns": str(stamp_ns), "u": 320.0, "v": 256.0, "refine": None}
    return json.dumps(click | place)


async def oversleep(late_ms: list[float]) -> None:
    """Note how late short sleeps end, for ever: what a busy machine alone does to all figures."""
    while True:
        begun = time.monotonic()
        await asyncio.sleep(_SLEEP_S)
        late_ms.append((time.monotonic() - begun - _SLEEP_S) * 1e3)


class _Viewer:
    def __init__(self, job: Job) -> None:
        self._job = job
        self._stamp_ns = 0
        self._clicked: dict[str, float] = {}
        self._watched = Watched([], [], [], job.seconds)

    async def watch(self) -> Watched:
        origin = {"Origin": self._job.url}
        async with (
            aiohttp.ClientSession(headers=origin) as session,
            session.ws_connect(f"{self._job.url}/state") as state,
            session.ws_connect(f"{self._job.url}/video/") as video,
        ):
            work = (self._look(video), self._read(state), oversleep(self._watched.late_ms))
            tasks = [asyncio.create_task(part) for part in work]
            if self._job.clicks:
                tasks.append(asyncio.create_task(self._click(state)))
            await asyncio.sleep(_SETTLE_S + self._job.seconds)
            for task in tasks:
                task.cancel()
        return self._watched

    async def _look(self, video: aiohttp.ClientWebSocketResponse) -> None:
        begun = time.monotonic()
        async for message in video:
            self._stamp_ns, _, number, _, _, size = HEADER.unpack_from(message.data)
            jpeg = np.frombuffer(message.data, np.uint8, offset=HEADER.size + size)
            assert cv2.imdecode(jpeg, cv2.IMREAD_COLOR) is not None
            await video.send_str(f"shown {number}")
            if time.monotonic() - begun > _SETTLE_S:
                self._watched.ages_ms.append((time.time_ns() - self._stamp_ns) * 1e-6)

    async def _read(self, state: aiohttp.ClientWebSocketResponse) -> None:
        async for message in state:
            answer: dict[str, Any] = json.loads(message.data)
            if answer["type"] == "answer":
                assert answer["ok"], answer
                clicked_s = self._clicked.pop(answer["request"])
                self._watched.clicks_ms.append((time.monotonic() - clicked_s) * 1e3)

    async def _click(self, state: aiohttp.ClientWebSocketResponse) -> None:
        while True:
            await asyncio.sleep(_CLICK_EVERY_S)
            name = f"r{time.monotonic_ns()}"
            self._clicked[name] = time.monotonic()
            await state.send_str(click_text(name, self._stamp_ns))
