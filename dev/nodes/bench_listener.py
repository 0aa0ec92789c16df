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
"""Note when messages of some topics arrive, for ``make bench`` and ``dev.bench.imu_load``.

After ``duration_s``, or when it is stopped, it writes as JSON stamp and time of arrival (ns) of
each message by topic, and whether the overlay's last picture has lines.
"""

from __future__ import annotations

import json
import math
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.io.messages.pictures import compressed_pixels, image_pixels
from tirgeo_ros.io.messages.topics import STREAM_DEPTH
from tirgeo_ros.nodes.graph_node import GraphNode, output
from tirgeo_ros.nodes.runner import run

_LARGE = "tirgeo/overlay/image"
_PIXELS = {_LARGE: image_pixels, "tirgeo/overlay/image/compressed": compressed_pixels}
_LEAST_INK = 1000  # coloured pixels of a picture with lines


class Listener(GraphNode):
    """Subscribe to the topics of the parameter ``topics``, which commas separate."""

    def __init__(self) -> None:
        super().__init__("bench_listener")
        topics = self.declare_parameter("topics", "").value.split(",")
        self.duration_s = self.declare_parameter("duration_s", math.inf).value
        self.output = self.declare_parameter("output", "").value
        self._arrivals: dict[str, list[tuple[int, int]]] = {topic: [] for topic in topics}
        self._has_lines = lambda: False
        for topic in topics:
            depth = (
                () if topic in _PIXELS and not topic.endswith("compressed") else (STREAM_DEPTH,)
            )
            self.listen(topic, partial(self._note, topic), output(*depth), decoded=False)

    def _note(self, topic: str, data: bytes) -> None:
        self._arrivals[topic].append((header_stamp_ns(data), time.time_ns()))
        if topic in _PIXELS:
            self._has_lines = lambda: _has_ink(_PIXELS[topic](self.decoded(data, topic)))

    def found(self) -> dict[str, Any]:
        """Return what is written at the end."""
        return {"arrivals": self._arrivals, "lines": self._has_lines()}


def _has_ink(pixels: Any) -> bool:
    image = pixels.astype(int)
    return int((image[..., 2] - image[..., 0] > 50).sum()) > _LEAST_INK


def until_over(node: Any, stop: threading.Event) -> int:
    """Let a node work for its ``duration_s``, then write what it found to its ``output``."""
    stop.wait(None if math.isinf(node.duration_s) else node.duration_s)
    Path(node.output).write_text(json.dumps(node.found()))
    return 0


main = partial(run, "bench_listener", Listener, until_over)
