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
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from typing import IO, Any

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.draping import Ground, check_heights
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.overlay.map_renderer import DrapedMap, lay_layers
from tirgeo_ros.core.types.errors import MapError, TirgeoError
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.child_python import end_with, python_command
from tirgeo_ros.io.files.memory_bound import MOST_BYTES, MOST_S, bounded_memory
from tirgeo_ros.io.maps.layers import read_layers
from tirgeo_ros.io.maps.page_map import page_map

_RUN = "from tirgeo_ros.io.maps.map_process import main; main()"
_SAID_BYTES = 4000  # of a child's last output; a traceback has as many
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
        self._process: subprocess.Popen[bytes] | None = None
        self._stderr: IO[bytes]
        self._name = ""

    def stop(self) -> None:
        """End what is in progress; nothing can begin after this."""
        with self._lock:
            self._stopped = True
            if self._process is not None:
                self._process.kill()

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
        if self._process is None:
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
            if self._process is None:
                self._stderr = tempfile.TemporaryFile()  # noqa: SIM115  until ``close``
                self._process = _started(self._stderr)
            process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(pickle.dumps((task, arguments)))
            process.stdin.flush()
            # From the pipe: the interpreter is free while it waits for each part.
            found = pickle.load(process.stdout)  # noqa: S301  from our own child
        except (EOFError, OSError, pickle.UnpicklingError):
            code = process.wait()  # its end of the pipe is closed, so it has ended
            self.close()
            raise MapError(f"{name}: {_fault(code, self.said)}") from None
        except BaseException:
            self.close()
            raise
        if isinstance(found, TirgeoError):
            self.close()
            raise found
        if isinstance(found, MemoryError):
            self.close()
            raise MapError(f"{name}: {_TOO_LARGE}")
        return found

    def close(self) -> None:
        """End the process, if there is one."""
        with self._lock:
            process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):  # for a task that it never took
                pipe.close()  # type: ignore[union-attr]
        with self._stderr as file:
            file.seek(max(file.seek(0, os.SEEK_END) - _SAID_BYTES, 0))
            lines = file.read().decode(errors="replace").strip().splitlines()
        # Without characters that a terminal would obey.
        self.said = "\n".join("".join(x if x.isprintable() else "?" for x in y) for y in lines)


def _started(stderr: IO[bytes]) -> subprocess.Popen[bytes]:
    # Imported, not run as a module: what it pickles must have this module's name.
    return subprocess.Popen(  # noqa: S603  this very Python
        python_command(_RUN, str(os.getpid())),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=stderr,
    )


def _fault(code: int, said: str) -> str:
    """Return why a process ended, by its exit code and its last words."""
    if code == -signal.SIGXCPU:
        return _TOO_LONG
    if "bad_alloc" in said or "MemoryError" in said:
        return _TOO_LARGE
    crashed = "; is the file damaged?" if code in {-signal.SIGSEGV, -signal.SIGABRT} else ""
    last = f": {said.splitlines()[-1]}" if said else ""
    return f"the process that reads it ended (exit code {code}){crashed}{last}"


def main() -> None:
    """Do the tasks on stdin, (method of ``_Work``, arguments), and answer each on stdout."""
    end_with(int(sys.argv[1]), signal.SIGKILL)
    os.nice(5)  # the video has priority
    gc.disable()  # it takes half the time of a large map and frees nothing
    work = _Work()
    # GDAL may read stdin (/vsistdin/) and print: it gets neither of the parent's pipes.
    tasks, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    with suppress(EOFError):  # the parent has ended
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
