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
"""Write down what the graph gives, one JSON list a line, for ``make soak``.

    ["pose", TIME_S, STAMP_NS, north, east, down, w, x, y, z, six variances]
    ["picture", TIME_S, STAMP_NS, PIXELS_OF_LINES]
    ["frames", TIME_S, STAMP_NS, REFUSED, {count: number}]    what overlay_node reports

Poses are those of the optical frame in ``map``, NED; variances of position (m2) and rotation
(rad2) about north, east, down. Nothing is kept in memory.
"""

from __future__ import annotations

import json
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.overlay.written_text import status_box
from tirgeo_ros.io.messages import STATE_TOPIC, camera_pose, node_state, stamp_ns
from tirgeo_ros.io.messages.pictures import image_pixels
from tirgeo_ros.nodes.graph_node import GraphNode, latched, output
from tirgeo_ros.nodes.runner import run

#: A busy machine must lose nothing on this side.
_DEPTH = 1000
_PICTURES = 30
_VIDEO = "thermal/image_raw"  # and below it
#: Red less blue of a line's pixel: above what the coding of a grey picture makes.
_COLOUR = 50


def line_pixels(image: Any) -> int:
    """Pixels of a picture (h, w, 3) BGR, grey but for what is drawn, that lines have coloured.

    Lines are yellow, faded ones too: as much green as red. The notice is amber.
    """
    blue, green, red = (image[..., k].astype(np.int16) for k in range(3))
    colour = red - blue
    lines = (colour > _COLOUR) & (8 * (red - green) < colour)
    return int(lines[: status_box(image).top].sum())


class Witness(GraphNode):
    """Poses, pictures and counts of frames into a file."""

    def __init__(self) -> None:
        super().__init__("soak_witness")
        path = Path(self.declare_parameter("output", "").value)
        self.resources = path.open("w", buffering=1)
        self.listen("tirgeo/camera_pose", self._pose, output(_DEPTH))
        self.listen("tirgeo/overlay/image", self._picture, output(_PICTURES))
        self.listen(STATE_TOPIC, self._state, latched(_DEPTH))

    def _pose(self, message: Any) -> None:
        pose = camera_pose(message)
        numbers = [*pose.position_n, *pose.q_nc, *pose.covariance.diagonal()]
        self._write("pose", pose.stamp_ns, *(float(f"{number:.9g}") for number in numbers))

    def _picture(self, message: Any) -> None:
        self._write("picture", stamp_ns(message), line_pixels(image_pixels(message)))

    def _state(self, message: Any) -> None:
        state = node_state(message)
        if state.picture is not None:
            videos = [item for name, item in state.topics.items() if name.startswith(_VIDEO)]
            refused = sum(item.unreadable + item.failed for item in videos)
            self._write("frames", state.picture.newest_frame_ns, refused, dict(state.counts))

    def _write(self, kind: str, *values: Any) -> None:
        line = json.dumps([kind, round(time.monotonic(), 6), *values])
        self.resources.write(f"{line}\n")


main = partial(run, "soak_witness", Witness)
