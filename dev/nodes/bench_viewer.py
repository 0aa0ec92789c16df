"""Watch the overlay's pictures, for ``make bench``.

When it ends it writes as JSON stamp and age (ns) of each picture that reached it, whether the last
one had lines, and what overlay_node says of its own share of the time.
"""

from __future__ import annotations

import math
import time
from functools import partial
from typing import Any

from dev.nodes.bench_video import until_over
from tirgeo_ros.io.messages import compressed_pixels, image_pixels, stamp_ns
from tirgeo_ros.nodes.graph_node import GraphNode, output
from tirgeo_ros.nodes.runner import run

_LEAST_INK = 1000  # coloured pixels of a picture with lines
_INSIDE = "latency p95 [ms]"


class VideoViewer(GraphNode):
    """Takes the overlay's pictures and notes how old they are."""

    def __init__(self) -> None:
        super().__init__("bench_viewer")
        self.duration_s = self.declare_parameter("duration_s", 10.0).value
        self.output = self.declare_parameter("output", "").value
        self._jpeg = self.declare_parameter("jpeg", value=False).value
        self._shown: list[tuple[int, int]] = []
        self._last: Any = None
        self._inside_ms = math.nan
        topic = "tirgeo/overlay/image" + ("/compressed" if self._jpeg else "")
        self.listen(topic, self._take, output())
        self.listen("/diagnostics", self._take_diagnostics, output())

    def _take(self, message: Any) -> None:
        stamp = stamp_ns(message)
        self._shown.append((stamp, time.time_ns() - stamp))
        self._last = message

    def _take_diagnostics(self, message: Any) -> None:
        for pair in (pair for status in message.status for pair in status.values):
            if pair.key == _INSIDE:
                self._inside_ms = float(pair.value)

    def found(self) -> dict[str, Any]:
        """What is written at the end."""
        lines = self._last is not None and self._has_ink(self._last)
        return {"shown": self._shown, "lines": lines, "inside_ms": self._inside_ms}

    def _has_ink(self, message: Any) -> bool:
        image = (compressed_pixels if self._jpeg else image_pixels)(message).astype(int)
        return int((image[..., 2] - image[..., 0] > 50).sum()) > _LEAST_INK


main = partial(run, "bench_viewer", VideoViewer, until_over)
