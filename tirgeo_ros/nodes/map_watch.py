"""Looks after the map's files while a node runs, and has a changed map read again."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import final

from rclpy.node import Node

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.errors import TirgeoError
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_drawing import LaidMap
from tirgeo_ros.io.map_child import MapChild
from tirgeo_ros.io.maps import map_files

Signature = list[tuple[str, int, int] | None]


@final
class MapWatch:
    """A context in which the files of ``config.map`` and its style are looked at now and then.

    ``plane`` says where a map is to be laid. Looking and waiting happen in a thread of its own;
    ``changed`` hands over what came of it. ``counts``: ``reloads`` and ``reload_errors``.
    """

    def __init__(
        self, node: Node, config: OverlayConfig, plane: Callable[[], TangentPlane | None]
    ) -> None:
        self.counts = {"reloads": 0, "reload_errors": 0}
        self.error = ""  # of the newest change; empty where the map is as its files are
        self._node = node
        self._config = config
        self._plane = plane
        self._seen = _signature(config)
        self._found: SimpleQueue[LaidMap | TirgeoError] = SimpleQueue()
        self._child = MapChild()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="map watch", daemon=True)

    def __enter__(self) -> MapWatch:
        """Begin to look, unless the parameters say never."""
        if self._config.map and self._config.reload_s > 0:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop looking; a map that is being read is given up."""
        self._stop.set()
        self._child.stop()
        if self._thread.is_alive():
            self._thread.join()

    def changed(self) -> LaidMap | None:
        """The changed map, once; what has become wrong or right again is logged, once."""
        try:
            found = self._found.get_nowait()
        except Empty:
            return None
        if isinstance(found, TirgeoError):
            self.counts["reload_errors"] += 1
            if str(found) != self.error:
                self._node.get_logger().warning(f"the map stays as it was: {found}")
            self.error = str(found)
            return None
        self.counts["reloads"] += 1
        self.error = ""
        features = sum(len(layer.features) for layer in found.layers)
        self._node.get_logger().info(
            f"the map has changed and was read again: {features} features"
        )
        return found

    def _watch(self) -> None:
        while not self._stop.wait(self._config.reload_s):
            signature = _signature(self._config)
            if signature == self._seen:
                continue
            self._seen = signature  # from before the reading: a file may still be growing
            try:
                self._found.put(self._child.read(self._config, self._plane()))
            except TirgeoError as error:
                self._found.put(error)


def _signature(config: OverlayConfig) -> Signature:
    return [_state(path) for path in map_files(config.map, config.style)]


def _state(path: Path) -> tuple[str, int, int] | None:
    """Name, time of change and size of a file; None for one that is not there."""
    try:
        status = path.stat()
    except OSError:
        return None
    return str(path), status.st_mtime_ns, status.st_size
