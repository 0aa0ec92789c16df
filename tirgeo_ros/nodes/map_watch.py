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
"""Read the map while a node runs, and again when its files change: for pictures and pages."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import final

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.overlay.map_shapes import DrapedMap
from tirgeo_ros.core.types.errors import MapError, TirgeoError
from tirgeo_ros.io.files.whole_files import named_files
from tirgeo_ros.io.maps import map_files
from tirgeo_ros.io.maps.map_process import MapContents, MapProcess
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.monitor import OK, WARN
from tirgeo_ros.nodes.runner import done_or_stopped

# ``stop`` kills the child; the thread can then only hang on a file that does not respond.
_JOIN_S = 1.0
Signature = list[tuple[str, int, int] | None]
_UNREAD: Signature = [("", 0, 0)]  # of no file: after a failed start the map is read again


@final
class MapWatch:
    """Hold ``config.map`` placed in the plane, and keep it up to date, as a context manager.

    Entering waits for the first reading, or a stop signal, and raises the errors of that reading.
    A MapError is not raised, but reported like a later one: the video goes on without a map.
    ``plane`` returns the tangent plane in which the map is placed, or None before it is known;
    call ``look`` when it may have changed. The map's files and its style are checked periodically.
    A thread with a child process does the reading, placing and waiting; ``changed`` returns the
    result. ``counts``: ``reloads`` and ``reload_errors``.
    """

    def __init__(
        self, node: GraphNode, config: OverlayConfig, plane: Callable[[], TangentPlane | None]
    ) -> None:
        self.counts = {"reloads": 0, "reload_errors": 0}
        self.error = ""  # of the newest change; empty if the map is up to date
        self.failure = ""  # the same in a few words, for the picture
        self._node, self._config, self._plane = node, config, plane
        # A placed map or an error, and what was read if the files have changed.
        self._results = SimpleQueue[tuple[DrapedMap | TirgeoError, MapContents | None]]()
        self._child = MapProcess()
        self._has_map = False  # a map was placed
        self._stop, self._wake = threading.Event(), threading.Event()
        self._first = threading.Event()  # the first reading has ended
        self._first_error: Exception | None = None  # what the first reading raised
        self._thread = threading.Thread(target=self._run, name="map watch", daemon=True)
        # The state of the files of the last attempt, and the plane in which they were placed.
        self._tried: tuple[Signature, TangentPlane | None] = (_UNREAD, None)

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
            result, contents = self._results.get_nowait()
        except Empty:
            return None
        if isinstance(result, TirgeoError):
            self.counts["reload_errors"] += 1
            if str(result) != self.error:
                stays = "the previous map stays in use" if self._has_map else "there is no map"
                self._node.log(WARN, f"{stays}: {result}")
            self.error = str(result)
            return None
        self.error, self._has_map = "", True
        if contents is not None:
            self.counts["reloads"] += 1
            self._log_contents("the map has changed and was read again", contents)
        return result

    def _log_contents(self, words: str, contents: MapContents) -> None:
        self._node.log(OK, f"{words}: {contents.features} features")
        for note in contents.left_out:
            self._node.log(WARN, note)

    def _run(self) -> None:
        # One thread for every reading: the child process ends with the thread that started it.
        try:
            signature = self._signature()
            self._log_contents(self._config.map, self._child.read(self._config))
            self._tried = signature, None
        except MapError as error:
            self._fail(error)
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
                self._fail(MapError(f"{self._config.map}: {fault!r}"))
            self._wake.wait(self._config.reload_s or None)
            self._wake.clear()

    def _watch(self) -> None:
        """Read the map if needed and place it in the plane, if files or plane have changed."""
        # The files' state is taken before they are read: a file may still be growing.
        signature, plane = self._signature(), self._plane()
        before, placed_in = self._tried
        if plane is None or (signature, plane) == self._tried:
            return
        self._tried, changed = (signature, plane), signature != before
        try:
            # A map is placed once: for another plane the child reads it again.
            reads = changed or placed_in is not None
            contents = self._child.read(self._config) if reads else None
            self._results.put((self._child.drape(plane), contents if changed else None))
        except TirgeoError as error:
            self._fail(error)

    def _fail(self, error: TirgeoError) -> None:
        """Report why there is no map, or no new one."""
        self._log_child_output()
        paths = map(Path, named_files(self._config.map))
        missing = next((path.name for path in paths if not path.exists()), "")
        self.failure = f"{missing} not found" if missing else "its reading failed"
        self._results.put((error, None))

    def _log_child_output(self) -> None:
        """Log the error output of a child that failed: it holds the traceback of a fault."""
        if self._child.said and not self._stop.is_set():
            self._node.get_logger().error(f"the map's reader printed:\n{self._child.said}")

    def _signature(self) -> Signature:
        """Return the state of the files of the map and its style; empty if never checked."""
        files = map_files(self._config.map, self._config.style) if self._config.reload_s else ()
        return [_file_state(path) for path in files]


class PageMap:
    """Read ``map_text``'s files as GeoJSON, in a process of its own, so that no video waits."""

    def __init__(self, node: GraphNode, map_text: str) -> None:
        self.error = ""  # why there is no map; empty if there is one, or none is set
        self._node, self._map_text = node, map_text
        self._child = MapProcess()
        self._lock = threading.Lock()
        self._state: object = None  # of the files that were read
        self._body = b""

    def read(self) -> bytes:
        """Return the map as it is in its files; empty without one. Any thread may call it."""
        if not self._map_text:
            return b""
        with self._lock:
            state = [_file_state(path) for path in map_files(self._map_text)]
            if state != self._state:
                self._state, self._body, self.error = state, b"", ""
                try:
                    self._body = self._child.answer(self._map_text, "page", self._map_text)
                    self._child.close()
                except TirgeoError as error:
                    self.error = str(error)
                    self._node.log(WARN, f"the page has no map: {error}")
            return self._body

    def stop(self) -> None:
        """End a reading in progress."""
        self._child.stop()


def _file_state(path: Path) -> tuple[str, int, int] | None:
    """Return name, modification time (ns) and size (bytes) of a file; None if it is absent."""
    try:
        status = path.stat()
    except OSError:
        return None
    return str(path), status.st_mtime_ns, status.st_size
