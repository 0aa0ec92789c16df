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
"""Record topics of the running graph into a bag, byte for byte, until it is stopped.

A process that is killed leaves a bag that can be read up to its last second or so.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from tirgeo_ros.core.config import RecorderConfig
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.bags.bag import BagWriter
from tirgeo_ros.io.messages import SENSED_TOPICS, TOPIC_TYPES
from tirgeo_ros.io.messages.topics import offered_qos
from tirgeo_ros.nodes.graph_node import (
    GraphNode,
    latched,
    message_class,
    output,
    sensor_input,
    topic_names,
)
from tirgeo_ros.nodes.runner import run

#: Deep enough for a pause of the disk.
_DEPTH = 500
_FLUSH_S = 1.0
_SENSED = {*SENSED_TOPICS, "thermal/image_raw", "thermal/image_raw/compressed"}
_CONTRACT = {topic.lstrip("/"): topic for topic in TOPIC_TYPES}


class Recorder(GraphNode):
    """Record raw subscriptions into one bag; log times are those of the node's clock."""

    def __init__(self) -> None:
        super().__init__("recorder")
        config = self.configured(RecorderConfig)
        if not config.output:
            raise ConfigError("parameter output: no bag given: set it to the MCAP file to write")
        topics = topic_names(config.topics)
        unknown = [name for name in topics if name not in _CONTRACT]
        if unknown or not topics:
            fault = f"unknown: {', '.join(unknown)}" if unknown else "it is empty"
            raise ConfigError(f"parameter topics: {fault}: choose from {', '.join(_CONTRACT)}")
        for name in topics:
            self._record(_CONTRACT[name])
        self.resources = BagWriter(Path(config.output), growing=True)
        self._flush_timer = self.steady_timer("flush", _FLUSH_S, self.resources.flush)

    def _record(self, topic: str) -> None:
        typename = TOPIC_TYPES[topic]
        resolved = self.resolve_topic_name(topic)

        def write(data: bytes) -> None:
            now_ns = self.get_clock().now().nanoseconds
            if now_ns > 0:  # before the first /clock message there is no valid time
                self.resources.write(resolved, typename, data, now_ns)

        qos = latched(_DEPTH) if offered_qos(topic).latched else output(_DEPTH)
        if topic in _SENSED:
            qos = sensor_input(_DEPTH)  # from other people's drivers
        self.create_subscription(message_class(typename), topic, write, qos, raw=True)


main = partial(run, "recorder", Recorder)
