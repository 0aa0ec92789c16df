"""A map read again by another process, so that a running video does not wait for it.

A thread would not do: readers and parsers hold the interpreter, and each frame stands behind them
at every call that it makes meanwhile.
"""

from __future__ import annotations

import math
import os
import pickle
import subprocess
import sys
import threading
from pathlib import Path

import tirgeo_ros
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.errors import MapError, TirgeoError
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_drawing import LaidMap, lay_layers
from tirgeo_ros.io.elevation import ground_of
from tirgeo_ros.io.maps import load_layers


class MapChild:
    """Reads and lays one map at a time; ``stop``, from another thread, ends that."""

    def __init__(self) -> None:
        self._stopped = False
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def stop(self) -> None:
        """End a reading that is under way; none begins from here on."""
        with self._lock:
            self._stopped = True
            if self._process is not None:
                self._process.kill()

    def read(self, config: OverlayConfig, plane: TangentPlane | None) -> LaidMap:
        """The map of a configuration, laid in a plane where one is given.

        Raises the TirgeoError that the reading raised, and MapError where the process ended
        without an answer, or was stopped.
        """
        process = self._started(config.map)
        answer, _ = process.communicate(pickle.dumps((config, plane)))
        if not answer:
            raise MapError(f"{config.map}: its reader ended (exit code {process.returncode})")
        found = pickle.loads(answer)  # noqa: S301  from our own child
        if isinstance(found, TirgeoError):
            raise found
        assert isinstance(found, LaidMap)
        return found

    def _started(self, name: str) -> subprocess.Popen[bytes]:
        with self._lock:
            if self._stopped:
                raise MapError(f"{name}: not read: stopped")
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tirgeo_ros.io.map_child"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=_environment(),
            )
            return self._process


def _environment() -> dict[str, str]:
    """The environment, with the package where it was found."""
    source = str(Path(tirgeo_ros.__file__).resolve().parents[1])
    paths = [source, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}


def main() -> int:
    """Read a task from stdin and write the map, or why there is none, to stdout."""
    config, plane = pickle.load(sys.stdin.buffer)  # noqa: S301  from our own parent
    answer: LaidMap | TirgeoError
    try:
        layers = load_layers(config.map, config.style, config.label_field)
        ground = ground_of(config)
        answer = lay_layers(layers, plane, math.nan if ground is None else ground)
    except TirgeoError as error:
        answer = error
    pickle.dump(answer, sys.stdout.buffer, protocol=pickle.HIGHEST_PROTOCOL)
    return 0


if __name__ == "__main__":
    os.nice(5)  # the video comes first
    sys.exit(main())
