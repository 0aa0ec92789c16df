"""Keep the live streams of the videos running, each in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import final
from urllib.parse import urlsplit

from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.io.video.live_stream import stream_url
from tirgeo_ros.nodes.child_node import ChildNode, ground_values
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.monitor import WARN

_RETRY_S = 5.0


@final
class PageStreams:
    """Run a video_writer for each aircraft, the first at the given port, a context manager.

    ``troubles`` says of each aircraft why its stream ended. Raises VideoError for an address that
    is none.
    """

    def __init__(
        self, node: GraphNode, config: ViewerConfig, namespaces: Mapping[str, str]
    ) -> None:
        self.troubles: dict[str, str] = {}
        self._node, self._config, self._namespaces = node, config, namespaces
        if config.stream:
            stream_url(config.stream)
        self._children: dict[str, ChildNode] = {}
        self._retry_s = 0.0

    def __enter__(self) -> PageStreams:
        """Begin."""
        return self

    def __exit__(self, *_: object) -> None:
        """End all."""
        for child in self._children.values():
            child.end()

    def watch(self) -> None:
        """Start what does not run; call each second, in a thread that lasts."""
        if not self._config.stream or time.monotonic() < self._retry_s:
            return
        for number, (name, namespace) in enumerate(self._namespaces.items()):
            fault = self._children[name].fault if name in self._children else ""
            if fault:
                self.troubles[name] = fault
                self._node.log(WARN, f"the stream begins again: {fault}")
                self._retry_s = time.monotonic() + _RETRY_S
            if fault or name not in self._children:
                self._children[name] = self._started(number, name, namespace)

    def _started(self, number: int, name: str, namespace: str) -> ChildNode:
        own = {"stream": _next_port(self._config.stream, number), "platform": name}
        values = own | ground_values(self._config)
        return ChildNode(self._node, "video_writer", values, namespace)


def _next_port(address: str, number: int) -> str:
    parts = urlsplit(address)
    assert parts.port is not None
    host, _, _ = parts.netloc.rpartition(":")
    return parts._replace(netloc=f"{host}:{parts.port + number}").geturl()
