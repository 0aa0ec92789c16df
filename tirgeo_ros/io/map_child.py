"""A map read and laid by another process, so that a running video does not wait for it.

A thread would not do: readers and parsers hold the interpreter, and each frame stands behind them
at every call that it makes meanwhile. For the same reason the layers stay over there: to take in
a hundred thousand features takes most of a second, the map that is made of them a twentieth.
"""

from __future__ import annotations

import math
import os
import pickle
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tirgeo_ros
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.draping import check_heights
from tirgeo_ros.core.errors import MapError, TirgeoError
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_drawing import LaidMap, lay_layers
from tirgeo_ros.io.elevation import ground_of
from tirgeo_ros.io.maps import load_layers


@dataclass(frozen=True, slots=True)
class MapContents:
    """What was read."""

    features: int
    left_out: tuple[str, ...]  # what of the files is not among them: a line each


class MapChild:
    """Reads one map at a time, then lays it; ``stop``, from another thread, ends either."""

    def __init__(self) -> None:
        self._stopped = False
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._name = ""

    def stop(self) -> None:
        """End what is under way; nothing begins from here on."""
        with self._lock:
            self._stopped = True
            if self._process is not None:
                self._process.kill()

    def read(self, config: OverlayConfig) -> MapContents:
        """Read the map of a configuration. One that was read before is given up.

        Raises the TirgeoError that the reading raised, and MapError where the process ended
        without an answer, or was stopped, or where there is nothing to lay.
        """
        self._end()
        with self._lock:
            self._name = config.map
            if self._stopped:
                raise MapError(f"{self._name}: not read: stopped")
            self._process = _started()
        contents = self._answer(config)
        assert isinstance(contents, MapContents)
        return contents

    def lay(self, plane: TangentPlane) -> LaidMap:
        """Lay the map that was read, once, in a plane. Raises as ``read``."""
        laid = self._answer(plane)
        assert isinstance(laid, LaidMap)
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
            # From the pipe, for the interpreter is free while it waits for each part.
            found = pickle.load(process.stdout)  # noqa: S301  from our own child
        except (EOFError, OSError, pickle.UnpicklingError):
            code = process.wait()  # for its end of a pipe is closed
            self._end()
            raise MapError(f"{self._name}: its reader ended (exit code {code})") from None
        if isinstance(found, TirgeoError):
            self._end()
            raise found
        return found

    def _end(self) -> None:
        """Be done with the process, if there is one."""
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            process.kill()
            with suppress(OSError):  # a task that it never took
                process.communicate()


def _started() -> subprocess.Popen[bytes]:
    # Imported, not run as a module: what it pickles must go by this module's name.
    return subprocess.Popen(
        [sys.executable, "-c", "from tirgeo_ros.io.map_child import main; main()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=_environment(),
    )


def _environment() -> dict[str, str]:
    """The environment, with the package where it was found."""
    source = str(Path(tirgeo_ros.__file__).resolve().parents[1])
    paths = [source, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}


def main() -> None:
    """Read the map of the configuration on stdin, then lay it in the plane that follows.

    To stdout goes what there is in the map, then the map as it lies, or why there is none.
    """
    os.nice(5)  # the video comes first
    try:
        _work(pickle.load(sys.stdin.buffer))  # noqa: S301  from our own parent
    except TirgeoError as error:
        _say(error)


def _work(config: OverlayConfig) -> None:
    layers = load_layers(config.map, config.style, config.label_field)
    found = ground_of(config)
    ground = math.nan if found is None else found
    check_heights(layers, ground)
    left_out = tuple(note for layer in layers for note in layer.left_out)
    _say(MapContents(sum(len(layer.features) for layer in layers), left_out))
    with suppress(EOFError):  # the node has ended
        _say(lay_layers(layers, pickle.load(sys.stdin.buffer), ground))  # noqa: S301  as above


def _say(answer: MapContents | LaidMap | TirgeoError) -> None:
    pickle.dump(answer, sys.stdout.buffer, protocol=pickle.HIGHEST_PROTOCOL)
    sys.stdout.buffer.flush()
