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
"""Write the overlay as H.264 with MISB metadata: into a file, or live over UDP."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from tirgeo_ros.core.config import VideoWriterConfig
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.types.errors import ConfigError, VideoError
from tirgeo_ros.io.messages import DiagnosticItem
from tirgeo_ros.io.messages.pictures import MOST_OF_VIDEO, unpacked
from tirgeo_ros.io.video.frame_metadata import FrameMetadata
from tirgeo_ros.io.video.live_stream import LiveStream
from tirgeo_ros.io.video.video_file import VideoFile
from tirgeo_ros.nodes.aircraft_topics import AircraftTopics, terrain_of
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.monitor import OK, WARN
from tirgeo_ros.nodes.runner import run


class VideoWriter(GraphNode):
    """Write each picture of one aircraft, with camera and pose, to a file and to a stream."""

    def __init__(self) -> None:
        super().__init__("video_writer")
        config = self.configured(VideoWriterConfig)
        if not config.output and not config.stream:
            raise ConfigError(
                "parameter output: nothing to write: set it to a file, or set stream"
            )
        fixed = ConfidenceConfig(), config.geoid_undulation_m, config.platform
        self._metadata = FrameMetadata(*fixed)
        self._film = VideoFile(Path(config.output), growing=True) if config.output else None
        self._stream = LiveStream(config.stream, self._metadata) if config.stream else None
        self._aircraft = AircraftTopics(self, "", terrain_of(config), self._take)
        self.report_each_second(self._items)
        self.resources = ExitStack()
        if self._stream is not None:
            self.resources.callback(self._stream.close)
        if self._film is not None:
            self.resources.enter_context(self._film)

    def _take(self, stamp_ns: int, jpeg: bytes) -> None:
        exposure_ns = self._aircraft.exposure_ns(stamp_ns)
        time_ns = stamp_ns if exposure_ns is None else exposure_ns
        sight = self._aircraft.sight(stamp_ns)
        self._metadata.confidence = self._aircraft.confidence
        if self._stream is not None:
            self._stream.add(time_ns, jpeg, sight)
        if self._film is not None:
            pixels = unpacked(jpeg, cv2.IMREAD_COLOR, MOST_OF_VIDEO)
            if pixels is None:
                raise VideoError("tirgeo/overlay/image/compressed: the message holds no JPEG")
            packet = self._metadata.packet(time_ns, sight)
            self._film.add(stamp_ns, np.asarray(pixels, np.uint8), packet)

    def _items(self) -> list[DiagnosticItem]:
        values = {"written": str(self._film.frames)} if self._film else {}
        error = self._stream.error if self._stream else ""
        if self._stream:
            values |= {name: str(number) for name, number in self._stream.counts.items()}
        return [self.item("video", values, error or "ok", WARN if error else OK)]


main = partial(run, "video_writer", VideoWriter)
