"""Read the map and place it in the plane while a node runs, again when files or plane change."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import final

from rclpy.node import Node

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.overlay.map_renderer import DrapedMap
from tirgeo_ros.core.types.errors import MapError, TirgeoError, shown
from tirgeo_ros.io.maps import map_files
from tirgeo_ros.io.maps.map_process import MapContents, MapProcess
from tirgeo_ros.nodes.runner import done_or_stopped

# ``stop`` kills the child; the thread can then only hang on a file that does not respond.
_JOIN_S = 1.0
Signature = list[tuple[str, int, int] | None]


@dataclass(frozen=True, slots=True)
class _Found:
    """Hold the result of one attempt to place the map in the plane."""

    result: DrapedMap | TirgeoError
    contents: MapContents | None  # set if the files have changed, else None


@final
class MapWatch:
    """Hold the map of ``config.map`` and keep it up to date, as a context manager.

    Entering raises what the first reading raises; it returns early when a stop signal comes.
    ``plane`` returns the tangent plane in which the map is placed, or None before it is known;
    ``look`` says that it may have changed. The map's files and its style are checked periodically.
    A thread with a child process does the reading, placing and waiting; ``changed`` returns the
    result. ``counts``: ``reloads`` and ``reload_errors``.
    """

    def __init__(
        self, node: Node, config: OverlayConfig, plane: Callable[[], TangentPlane | None]
    ) -> None:
        self.counts = {"reloads": 0, "reload_errors": 0}
        self.error = ""  # of the newest change; empty if the map is up to date
        self._node = node
        self._config = config
        self._plane = plane
        self._found: SimpleQueue[_Found] = SimpleQueue()
        self._child = MapProcess()
        self._stop = threading.Event()
        self._wake = threading.Event()
        self._first = threading.Event()  # the first reading has ended
        self._first_error: Exception | None = None  # what the first reading raised
        self._thread = threading.Thread(target=self._run, name="map watch", daemon=True)
        self._seen: Signature = []
        self._tried: tuple[Signature, TangentPlane] | None = None
        self._unplaced = True  # the child holds a map that is not placed in a plane yet

    def __enter__(self) -> MapWatch:
        """Read the map, if there is one, and start to watch it."""
        if self._config.map:
            self._thread.start()
            if done_or_stopped(self._first) and self._first_error is not None:
                self._thread.join()
                raise self._first_error
        return self

    def __exit__(self, *_: object) -> None:
        """Stop watching; a reading in progress is abandoned."""
        self._stop.set()
        self._wake.set()
        self._child.stop()
        if self._thread.is_alive():
            self._thread.join(_JOIN_S)

    def look(self) -> None:
        """Check the map again soon: the plane may have changed."""
        self._wake.set()

    def changed(self) -> DrapedMap | None:
        """Return a newly placed map, once, or None; log each new error and each reload once."""
        try:
            found = self._found.get_nowait()
        except Empty:
            return None
        if isinstance(found.result, TirgeoError):
            self.counts["reload_errors"] += 1
            if str(found.result) != self.error:
                self._node.get_logger().warning(f"the map stays as it was: {found.result}")
            self.error = str(found.result)
            return None
        self.error = ""
        if found.contents is not None:
            self.counts["reloads"] += 1
            self._log_contents("the map has changed and was read again", found.contents)
        return found.result

    def _log_contents(self, words: str, contents: MapContents) -> None:
        self._node.get_logger().info(shown(f"{words}: {contents.features} features"))
        for note in contents.left_out:
            self._node.get_logger().warning(shown(note))

    def _run(self) -> None:
        # One thread for all: the child process ends with the thread that started it.
        try:
            self._seen = self._signature()
            self._log_contents(self._config.map, self._child.read(self._config))
        except Exception as error:  # noqa: BLE001  raised again where the node begins
            self._first_error = error
            self._log_child_output()
            return
        finally:
            self._first.set()
        while not self._stop.is_set():
            try:
                self._watch()
            except Exception as fault:  # noqa: BLE001  a fault of ours: the next change is read
                self._node.get_logger().error(traceback.format_exc())
                self._found.put(_Found(MapError(f"{self._config.map}: {fault!r}"), None))
            self._wake.wait(self._config.reload_s or None)
            self._wake.clear()

    def _watch(self) -> None:
        signature, plane = self._signature(), self._plane()
        if plane is not None and (signature, plane) != self._tried:
            self._tried = signature, plane
            self._found.put(self._laid(signature, plane))

    def _laid(self, signature: Signature, plane: TangentPlane) -> _Found:
        """Read the map if needed and place it in the plane.

        ``signature`` is the files' state before the reading. The state is taken before, because a
        file may still be growing.
        """
        changed, unplaced = signature != self._seen, self._unplaced
        self._seen, self._unplaced = signature, False
        try:
            contents = self._child.read(self._config) if changed or not unplaced else None
            return _Found(self._child.lay(plane), contents if changed else None)
        except TirgeoError as error:
            self._log_child_output()
            return _Found(error, None)

    def _log_child_output(self) -> None:
        """Log the error output of a child that failed: it holds the traceback of a fault."""
        if self._child.said and not self._stop.is_set():
            self._node.get_logger().error(f"the map's reader said:\n{self._child.said}")

    def _signature(self) -> Signature:
        """Return the state of the files of the map and its style.

        Empty if they are never checked.
        """
        if not self._config.reload_s:
            return []
        return [_state(path) for path in map_files(self._config.map, self._config.style)]


def _state(path: Path) -> tuple[str, int, int] | None:
    """Return name, modification time (ns) and size (bytes) of a file; None if it is absent."""
    try:
        status = path.stat()
    except OSError:
        return None
    return str(path), status.st_mtime_ns, status.st_size
