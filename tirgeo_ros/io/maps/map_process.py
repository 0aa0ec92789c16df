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
"""Read a map, and compute its layout, in a separate process.

    layers = load_layers("roads.gpkg")     # of a command

    child = MapProcess()                   # of a node
    contents = child.read(config)          # raises what the reading raises
    draped = child.drape(plane)            # the map that was read; once after each ``read``

GDAL has no limits of memory and computing time, and may crash on a file: the process has limits,
and may crash alone. In a node the video does not wait for it, as it would for a thread that holds
the interpreter's lock. For the same reason the layers stay in the process: to transfer 100,000
features takes most of a second, the draped map made of them a twentieth of that.
"""

from __future__ import annotations

import gc
import json
import math
import os
import pickle
import signal
import threading
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import SEMI_MAJOR_AXIS_M
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.map.polylines import Polylines, worths
from tirgeo_ros.core.map.vector_map import GeoFeature, MapLayer, check_heights
from tirgeo_ros.core.overlay.map_shapes import DrapedMap, drape_layers
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import MapError, TirgeoError
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.bounded_reading import MOST_BYTES, MOST_S, bounded_memory
from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess, parent_pipes
from tirgeo_ros.io.maps.layers import read_layers

_RUN = "from tirgeo_ros.io.maps.map_process import main; main()"
_TOO_LARGE = (
    f"the map does not fit into memory ({MOST_BYTES >> 20} MB); cut out the area of the flight"
)
_TOO_LONG = (
    f"reading it takes more than {MOST_S} s of computing, perhaps for a view (stored query) that "
    "never ends; save its layers as tables"
)
#: What a tablet's browser draws fluently: parts (a line, an outline, a point) and their points.
MOST_PARTS, MOST_POINTS = 20_000, 150_000
_POINT_M = 10.0  # a point of the map matters as much as a building of this size
_DIGITS = 7  # of degrees: a centimetre

_Parts = list[tuple[int, GeoFeature]]  # each with the index of its layer


@dataclass(frozen=True, slots=True)
class MapContents:
    """Summarise a map that was read."""

    features: int
    left_out: tuple[str, ...]  # a line for each note on what was left out


def load_layers(
    map: str,  # noqa: A002  the parameter's name
    style: str = "",
    label_field: str = "name",
    *,
    network: bool = False,
) -> list[MapLayer]:
    """Call ``read_layers`` in a process of its own; return and raise what it does."""
    arguments = (map, style, label_field, network)
    with closing(MapProcess()) as child:
        layers: list[MapLayer] = child.answer(map or style, "layers", *arguments)
    return layers


class MapProcess:
    """Read one map at a time, then drape it; ``stop``, from another thread, ends the work.

    The process lives no longer than the thread that called ``read``.
    """

    def __init__(self) -> None:
        self.said = ""  # the last lines on stderr of the process that ended last
        self._stopped = False
        self._lock = threading.Lock()
        self._child: ChildProcess | None = None
        self._name = ""

    def stop(self) -> None:
        """End the task in progress; no task can begin after this."""
        with self._lock:
            self._stopped = True
            if self._child is not None:
                self._child.kill()

    def read(self, config: OverlayConfig) -> MapContents:
        """Read the map of a configuration, and drop the map that was read before.

        Raises the TirgeoError that the reading raised, and MapError if the process ended without
        an answer or was stopped, or if the map has nothing to draw.
        """
        self.close()
        contents: MapContents = self.answer(config.map, "contents", config)
        return contents

    def drape(self, plane: TangentPlane) -> DrapedMap:
        """Return the map draped in a tangent plane, once after ``read``. Raises as ``read``."""
        if self._child is None:
            raise MapError(f"{self._name}: nothing was read")
        draped: DrapedMap = self.answer(self._name, "layout", plane)
        self.close()
        return draped

    def answer(self, name: str, task: str, *arguments: object) -> Any:
        """Call a method of ``_Work`` in the process, started if necessary; return its result.

        Raises as ``read``; ``name`` is the map's, for messages.
        """
        with self._lock:
            self._name = name
            if self._stopped:
                raise MapError(f"{name}: not read: stopped")
            if self._child is None:
                self._child = ChildProcess(_RUN)
            child = self._child
        try:
            child.send((task, arguments))
            answer = child.receive()
        except ChildEndedError as error:
            self.close()
            crash = error.code in {-signal.SIGSEGV, -signal.SIGABRT}
            why = (
                f"the process that reads it ended (exit code {error.code})"
                f"{'; is the file damaged?' if crash else ''}{error.last}"
            )
            if error.code == -signal.SIGPROF:
                why = _TOO_LONG
            elif "bad_alloc" in error.said or "MemoryError" in error.said:
                why = _TOO_LARGE
            raise MapError(f"{name}: {why}") from None
        except BaseException:
            self.close()
            raise
        if isinstance(answer, TirgeoError | MemoryError):
            self.close()
            raise answer if isinstance(answer, TirgeoError) else MapError(f"{name}: {_TOO_LARGE}")
        return answer

    def close(self) -> None:
        """End the process, if there is one."""
        with self._lock:
            child, self._child = self._child, None
        if child is not None:
            child.close()
            self.said = child.said


def main() -> None:
    """Run the parent's tasks, (method of ``_Work``, arguments), and send each result."""
    # Imported, not run as a module: the classes that it pickles must carry this module's name.
    os.nice(5)  # the video has priority
    gc.disable()  # it takes half of the time for a large map and frees nothing
    work = _Work()
    with parent_pipes() as (tasks, answers):  # GDAL may read stdin (/vsistdin/) and print
        while True:
            task, arguments = pickle.load(tasks)  # noqa: S301  from our own parent
            answer: object
            try:
                with bounded_memory():
                    answer = getattr(work, task)(*arguments)
            except (TirgeoError, MemoryError) as error:
                answer = error
            pickle.dump(answer, answers, protocol=pickle.HIGHEST_PROTOCOL)
            answers.flush()


@dataclass(slots=True)
class _Work:
    """Hold the map that was read, and do the process's tasks."""

    kept: list[MapLayer] = field(default_factory=list)
    ground: Ground = math.nan

    def layers(self, map_text: str, style: str, label_field: str, network: bool) -> list[MapLayer]:
        return read_layers(map_text, style, label_field, network=network)

    def page(self, map_text: str) -> bytes:
        return page_map(read_layers(map_text))

    def contents(self, config: OverlayConfig) -> MapContents:
        network = config.network
        self.kept = read_layers(config.map, config.style, config.label_field, network=network)
        ground = ground_of(config)
        self.ground = math.nan if ground is None else ground
        check_heights(self.kept, self.ground)
        left_out = tuple(note for layer in self.kept for note in layer.left_out)
        return MapContents(sum(len(layer.features) for layer in self.kept), left_out)

    def layout(self, plane: TangentPlane) -> DrapedMap:
        return drape_layers(self.kept, plane, self.ground)


def page_map(layers: Sequence[MapLayer]) -> bytes:
    """Return layers as GeoJSON, in the order of drawing, simplified to what a browser can draw.

    ``simplified`` says in words what is changed, and is empty if nothing is.
    """
    parts = [(number, part) for number, layer in enumerate(layers) for part in layer.features]
    fewer = ""
    if len(parts) > MOST_PARTS:
        fewer = f"{MOST_PARTS:,} of {len(parts):,} shapes"
        sizes_m = [
            math.hypot(*np.ptp(_metres(part), axis=0)) if len(part.points) > 1 else _POINT_M
            for _, part in parts
        ]
        rank = np.argsort(np.negative(sizes_m), kind="stable")
        parts = [parts[i] for i in np.sort(rank[:MOST_PARTS]).tolist()]
    parts, coarser = _thinned(parts)
    features = [
        {
            "type": "Feature",
            "properties": {"layer": layers[number].name, "name": part.label},
            "geometry": geometry,
        }
        for number, of_layer in groupby(parts, key=itemgetter(0))
        for part, geometry in _shapes([part for _, part in of_layer])
    ]
    words = ", ".join(filter(None, (fewer, coarser)))
    collection = {"type": "FeatureCollection", "simplified": words, "features": features}
    return json.dumps(collection, separators=(",", ":")).encode()


def _thinned(parts: _Parts) -> tuple[_Parts, str]:
    """Return the parts, simplified by Douglas and Peucker's rule if too many, and a remark."""
    lines = [_metres(part) for _, part in parts]
    starts = np.append(0, np.cumsum([len(line) for line in lines]))
    if starts[-1] <= MOST_POINTS:
        return parts, ""
    worth_m = worths(Polylines(np.concatenate(lines).T, starts, np.arange(len(lines))))
    tolerance_m, thinned = np.sort(worth_m)[-MOST_POINTS], []
    for (number, part), own_m in zip(parts, np.split(worth_m, starts[1:-1]), strict=True):
        fifth_m = np.sort(own_m)[-5:][0]  # with it a small outline keeps four corners
        stays = (own_m >= min(tolerance_m, fifth_m))[: len(part.points)]
        thinned.append((number, replace(part, points=part.points[stays])))
    return thinned, f"lines within {tolerance_m:.2g} m"


def _metres(part: GeoFeature) -> Array:
    """Return a part's points (N, 2), m; those of an outline end where it begins."""
    points = np.concatenate([part.points, part.points[:1]]) if part.closed else part.points
    return SEMI_MAJOR_AXIS_M * points[:, :2] * [1.0, math.cos(points[0, 0])]


def _shapes(features: Sequence[GeoFeature]) -> Iterable[tuple[GeoFeature, dict[str, Any]]]:
    """Yield each geometry with a part of its feature; outlines of one group are one polygon."""
    numbered = enumerate(features)
    for _, pairs in groupby(
        numbered, key=lambda each: (each[1].group, each[1].group < 0 and each[0])
    ):
        parts = [part for _, part in pairs]
        outlines = [part for part in parts if part.closed]
        if outlines:
            rings = [_positions(part) for part in outlines]
            yield outlines[0], {"type": "Polygon", "coordinates": rings}
        for part in (part for part in parts if not part.closed):
            line = _positions(part)
            several = len(line) > 1
            kind, coordinates = ("LineString", line) if several else ("Point", line[0])
            yield part, {"type": kind, "coordinates": coordinates}


def _positions(part: GeoFeature) -> list[list[float]]:
    """Return longitude and latitude (deg) of a part's points; an outline ends where it begins."""
    places: list[list[float]] = np.degrees(part.points[:, 1::-1]).round(_DIGITS).tolist()
    return [*places, places[0]] if part.closed and places[0] != places[-1] else places
