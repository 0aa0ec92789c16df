"""Record topics of the running graph into a bag, byte for byte, until it is stopped."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from rclpy.node import Node

from tirgeo_ros.core.config import RecorderConfig
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.bags.bag import BagWriter
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.io.messages.offered_qos import offered_qos
from tirgeo_ros.nodes.graph_node import message_class
from tirgeo_ros.nodes.parameters import declare
from tirgeo_ros.nodes.playlist import names
from tirgeo_ros.nodes.qos import latched, output
from tirgeo_ros.nodes.runner import run

#: Deep enough for a pause of the disk.
_DEPTH = 500
_CONTRACT = {topic.lstrip("/"): topic for topic in TOPIC_TYPES}


class Recorder(Node):
    """Record raw subscriptions into one bag; log times are those of the node's clock."""

    def __init__(self) -> None:
        super().__init__("recorder")
        config = declare(self, RecorderConfig)
        if not config.output:
            raise ConfigError("parameter output: no bag given: set it to the MCAP file to write")
        topics = names(config.topics)
        unknown = [name for name in topics if name not in _CONTRACT]
        if unknown or not topics:
            known = ", ".join(_CONTRACT)
            raise ConfigError(
                f"parameter topics: {', '.join(unknown) or 'nothing'} to record (known: {known})"
            )
        for name in topics:
            self._record(_CONTRACT[name])
        self.resources = BagWriter(Path(config.output))

    def _record(self, topic: str) -> None:
        typename = TOPIC_TYPES[topic]
        resolved = self.resolve_topic_name(topic)

        def write(data: bytes) -> None:
            now_ns = self.get_clock().now().nanoseconds
            if now_ns > 0:  # before the first /clock message there is no valid time
                self.resources.write(resolved, typename, data, now_ns)

        qos = latched() if offered_qos(topic).latched else output(_DEPTH)
        self.create_subscription(message_class(typename), topic, write, qos, raw=True)


main = partial(run, "recorder", Recorder)
