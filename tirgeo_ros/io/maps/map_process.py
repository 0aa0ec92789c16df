"""Read a map and compute its layout in a separate process, so that the video does not wait.

    child = MapChild()
    contents = child.read(config)      # raises what the reading raises
    laid = child.lay(plane)            # of what was read; once after each ``read``

A thread would not do: readers and parsers hold the interpreter lock, and each frame would wait for
them at every call. For the same reason the layers stay in the process: to transfer a hundred
thousand features takes most of a second, the map that is made of them a twentieth of that.
"""

from __future__ import annotations

import ctypes
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.draping import check_heights
from tirgeo_ros.core.overlay.map_renderer import DrapedMap, lay_layers
from tirgeo_ros.core.types.errors import MapError, TirgeoError
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.child_python import python_command
from tirgeo_ros.io.files.memory_bound import bounded_memory
from tirgeo_ros.io.maps import load_layers

_RUN = "from tirgeo_ros.io.maps.map_process import main; main()"
_SAID_BYTES = 4000  # of a child's last output; a traceback has as many
_PR_SET_PDEATHSIG = 1  # of prctl (linux/prctl.h)


@dataclass(frozen=True, slots=True)
class MapContents:
    """Hold a summary of what was read."""

    features: int
    left_out: tuple[str, ...]  # what of the files is not among them: a line each


class MapProcess:
    """Read one map at a time, then lay it out; ``stop``, from another thread, ends either.

    The process lives no longer than the thread that called ``read``.
    """

    def __init__(self) -> None:
        self._stopped = False
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._listener: _Listener | None = None
        self._name = ""

    @property
    def said(self) -> str:
        """Return the last stderr output of the process of the last reading."""
        return "" if self._listener is None else self._listener.text()

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
        self._end()
        with self._lock:
            self._name = config.map
            if self._stopped:
                raise MapError(f"{self._name}: not read: stopped")
            self._process = _started()
            self._listener = _Listener(self._process)
        contents = self._answer(config)
        assert isinstance(contents, MapContents)
        return contents

    def lay(self, plane: TangentPlane) -> DrapedMap:
        """Return the map that was read, laid out in a plane; once. Raises as ``read``."""
        laid = self._answer(plane)
        assert isinstance(laid, DrapedMap)
        self._end()
        return laid

    def _answer(self, task: OverlayConfig | TangentPlane) -> Any:
        process = self._process
        if process is None:
            raise MapError(f"{self._name}: nothing was read")
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(pickle.dumps(task))
            process.stdin.flush()
            # From the pipe: the interpreter is free while it waits for each part.
            found = pickle.load(process.stdout)  # noqa: S301  from our own child
        except (EOFError, OSError, pickle.UnpicklingError):
            code = process.wait()  # its end of the pipe is closed, so it has ended
            self._end()
            last = f": {self.said.splitlines()[-1]}" if self.said else ""
            raise MapError(f"{self._name}: its reader ended (exit code {code}){last}") from None
        if isinstance(found, TirgeoError):
            self._end()
            raise found
        return found

    def _end(self) -> None:
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
        if self._listener is not None:
            self._listener.join()


class _Listener(threading.Thread):
    """Read a process's stderr, however long it is, and keep the end of it."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        super().__init__(name="map reader's words", daemon=True)
        assert process.stderr is not None
        self._pipe = process.stderr
        self._kept = b""
        self.start()

    def run(self) -> None:
        """Read until the process has ended."""
        with self._pipe as pipe:
            while said := os.read(pipe.fileno(), _SAID_BYTES):
                self._kept = (self._kept + said)[-_SAID_BYTES:]

    def text(self) -> str:
        """Return the lines without characters that a terminal would obey."""
        lines = self._kept.decode(errors="replace").strip().splitlines()
        return "\n".join("".join(x if x.isprintable() else "?" for x in line) for line in lines)


def _started() -> subprocess.Popen[bytes]:
    # Imported, not run as a module: what it pickles must have this module's name.
    return subprocess.Popen(  # noqa: S603  this very Python
        python_command(_RUN, str(os.getpid())),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def main() -> None:
    """Read the map of the configuration on stdin, then lay it out in the plane that follows.

    Writes to stdout a summary of the map, then the map's layout, or the error.
    """
    _end_with(int(sys.argv[1]))
    os.nice(5)  # the video has priority
    config = pickle.load(sys.stdin.buffer)  # noqa: S301  from our own parent
    try:
        with bounded_memory():
            _work(config)
    except TirgeoError as error:
        _say(error)
    except MemoryError:
        _say(MapError(f"{config.map}: the map does not fit into memory"))


def _end_with(parent: int) -> None:
    """Let the kernel end this process when its parent ends, for whatever reason (Linux)."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it has ended already
        sys.exit(1)


def _work(config: OverlayConfig) -> None:
    layers = load_layers(config.map, config.style, config.label_field, network=config.network)
    found = ground_of(config)
    ground = math.nan if found is None else found
    check_heights(layers, ground)
    left_out = tuple(note for layer in layers for note in layer.left_out)
    _say(MapContents(sum(len(layer.features) for layer in layers), left_out))
    with suppress(EOFError):  # the node has ended
        _say(lay_layers(layers, pickle.load(sys.stdin.buffer), ground))  # noqa: S301  as above


def _say(answer: MapContents | DrapedMap | TirgeoError) -> None:
    pickle.dump(answer, sys.stdout.buffer, protocol=pickle.HIGHEST_PROTOCOL)
    sys.stdout.buffer.flush()
