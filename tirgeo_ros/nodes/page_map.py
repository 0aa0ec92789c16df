"""Hold the map of the operator's page, read again when its files change."""

from __future__ import annotations

import threading

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.maps import map_files
from tirgeo_ros.io.maps.map_process import MapProcess
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.map_watch import file_state
from tirgeo_ros.nodes.monitor import WARN


class PageMap:
    """Read ``map_text``'s files as GeoJSON, in a process of its own: the video does not wait."""

    def __init__(self, node: GraphNode, map_text: str) -> None:
        self.error = ""  # why there is none; empty if there is, or none is given
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
            state = [file_state(path) for path in map_files(self._map_text)]
            if state != self._state:
                self._state = state
                self._body = self._answer()
            return self._body

    def stop(self) -> None:
        """End a reading in progress."""
        self._child.stop()

    def _answer(self) -> bytes:
        try:
            found = self._child.answer(self._map_text, "page", self._map_text)
        except TirgeoError as error:
            self.error = str(error)
            self._node.log(WARN, f"the page has no map: {error}")
            return b""
        self._child.close()
        self.error = ""
        return bytes(found)
