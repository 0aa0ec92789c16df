"""Note when frames and the overlay's pictures of them reach another process, for ``make bench``.

When it is stopped it writes to the file of its parameter ``output``, as JSON, the number of frames
and the times (s) from each frame's arrival to that of its picture.
"""

from __future__ import annotations

import json
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

from tirgeo_ros.io.messages import stamp_ns
from tirgeo_ros.io.messages.offered_qos import STREAM_DEPTH
from tirgeo_ros.nodes.graph_node import GraphNode, output
from tirgeo_ros.nodes.runner import run


class Pictures(GraphNode):
    """Take frames and pictures, both compressed."""

    def __init__(self) -> None:
        super().__init__("bench_pictures")
        self._output = self.declare_parameter("output", "").value
        self._frames: dict[int, float] = {}
        self._pictures: dict[int, float] = {}
        deep = output(STREAM_DEPTH)
        self.listen("thermal/image_raw/compressed", partial(_note, self._frames), deep)
        self.listen("tirgeo/overlay/image/compressed", partial(_note, self._pictures), deep)

    def write(self, stop: threading.Event) -> int:
        """Wait for the end and write."""
        stop.wait()
        both = self._frames.keys() & self._pictures.keys()
        took_s = [self._pictures[stamp] - self._frames[stamp] for stamp in sorted(both)]
        Path(self._output).write_text(json.dumps({"frames": len(self._frames), "took_s": took_s}))
        return 0


def _note(arrivals_s: dict[int, float], message: Any) -> None:
    arrivals_s[stamp_ns(message)] = time.monotonic()


main = partial(run, "bench_pictures", Pictures, Pictures.write)
