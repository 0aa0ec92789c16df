"""Read a map, and compute its layout, in a separate process.

    layers = load_layers("roads.gpkg")     # of a command

    child = MapProcess()                   # of a node
    contents = child.read(config)          # raises what the reading raises
    laid = child.lay(plane)                # of what was read; once after each ``read``

The process has bounds of memory and computing, and may die of a file: GDAL has none. In a node the
video does not wait for it, as it would for a thread that holds the interpreter. For the same
reason the layers stay in the process: to transfer a hundred thousand features takes most of a
second, the map that is made of them a twentieth of that.
"""

from __future__ import annotations

import gc
import math
import os
import pickle
import signal
import threading
from dataclasses import dataclass, field
from typing import Any

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.draping import Ground, check_heights
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.overlay.map_renderer import DrapedMap, lay_layers
from tirgeo_ros.core.types.errors import MapError, TirgeoError
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess, parent_pipes
from tirgeo_ros.io.files.memory_bound import MOST_BYTES, MOST_S, bounded_memory
from tirgeo_ros.io.maps.layers import read_layers
from tirgeo_ros.io.maps.page_map import page_map

_RUN = "from tirgeo_ros.io.maps.map_process import main; main()"
_TOO_LARGE = (
    f"the map does not fit into memory ({MOST_BYTES >> 20} MB); cut out the area of the flight"
)
_TOO_LONG = (
    f"reading it takes more than {MOST_S} s of computing, as a view that computes without end "
    "does; save its layers as tables"
)


@dataclass(frozen=True, slots=True)
class MapContents:
    """Hold a summary of what was read."""

    features: int
    left_out: tuple[str, ...]  # what of the files is not among them: a line each


def load_layers(
    map: str,  # noqa: A002  the parameter's name
    style: str = "",
    label_field: str = "name",
    *,
    network: bool = False,
) -> list[MapLayer]:
    """Return what ``read_layers`` returns, read by a process of its own; raise what it raises."""
    child = MapProcess()
    try:
        found = child.answer(map or style, "layers", map, style, label_field, network)
    finally:
        child.close()
    assert isinstance(found, list)
    return found


class MapProcess:
    """Read one map at a time, then lay it out; ``stop``, from another thread, ends either.

    The process lives no longer than the thread that called ``read``.
    """

    def __init__(self) -> None:
        self.said = ""  # the last lines on stderr of the process that ended last
        self._stopped = False
        self._lock = threading.Lock()
        self._child: ChildProcess | None = None
        self._name = ""

    def stop(self) -> None:
        """End what is in progress; nothing can begin after this."""
        with self._lock:
            self._stopped = True
            if self._child is not None:
                self._child.kill()

    def read(self, config: OverlayConfig) -> MapContents:
        """Read the map of a configuration. One that was read before is dropped.

        Raises the TirgeoError that the reading raised, and MapError if the process ended without
        an answer, or was stopped, or if the map has nothing to draw.
        """
        self.close()
        contents = self.answer(config.map, "contents", config)
        assert isinstance(contents, MapContents)
        return contents

    def lay(self, plane: TangentPlane) -> DrapedMap:
        """Return the map that was read, laid out in a plane; once. Raises as ``read``."""
        if self._child is None:
            raise MapError(f"{self._name}: nothing was read")
        laid = self.answer(self._name, "layout", plane)
        assert isinstance(laid, DrapedMap)
        self.close()
        return laid

    def answer(self, name: str, task: str, *arguments: object) -> Any:
        """Return what a method of the process's ``_Work`` returns; start it if there is none.

        Raises as ``read``; ``name`` is the map's.
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
            found = child.receive()
        except ChildEndedError as error:
            self.close()
            raise MapError(f"{name}: {_fault(error)}") from None
        except BaseException:
            self.close()
            raise
        if isinstance(found, TirgeoError | MemoryError):
            self.close()
            raise found if isinstance(found, TirgeoError) else MapError(f"{name}: {_TOO_LARGE}")
        return found

    def close(self) -> None:
        """End the process, if there is one."""
        with self._lock:
            child, self._child = self._child, None
        if child is not None:
            child.close()
            self.said = child.said


def _fault(ended: ChildEndedError) -> str:
    """Return why a process ended, by its exit code and its last words."""
    if ended.code == -signal.SIGXCPU:
        return _TOO_LONG
    if "bad_alloc" in ended.said or "MemoryError" in ended.said:
        return _TOO_LARGE
    crashed = "; is the file damaged?" if ended.code in {-signal.SIGSEGV, -signal.SIGABRT} else ""
    return f"the process that reads it ended (exit code {ended.code}){crashed}{ended.last}"


def main() -> None:
    """Do the tasks of the parent, (method of ``_Work``, arguments), and answer each."""
    # Imported, not run as a module: what it pickles must have this module's name.
    os.nice(5)  # the video has priority
    gc.disable()  # it takes half the time of a large map and frees nothing
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
    """Hold the map that was read, in the process."""

    kept: list[MapLayer] = field(default_factory=list)
    ground: Ground = math.nan

    def layers(self, map_text: str, style: str, label_field: str, network: bool) -> list[MapLayer]:
        return read_layers(map_text, style, label_field, network=network)

    def page(self, map_text: str) -> bytes:
        return page_map(read_layers(map_text))

    def contents(self, config: OverlayConfig) -> MapContents:
        network = config.network
        self.kept = read_layers(config.map, config.style, config.label_field, network=network)
        found = ground_of(config)
        self.ground = math.nan if found is None else found
        check_heights(self.kept, self.ground)
        left_out = tuple(note for layer in self.kept for note in layer.left_out)
        return MapContents(sum(len(layer.features) for layer in self.kept), left_out)

    def layout(self, plane: TangentPlane) -> DrapedMap:
        return lay_layers(self.kept, plane, self.ground)
