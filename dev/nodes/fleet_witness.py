"""Record what the graphs of several aircraft give, byte for byte, for ``python -m dev.fleet``."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from rclpy.qos import QoSProfile

from tirgeo_ros.io.bags.bag import BagWriter
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.nodes.graph_node import GraphNode, latched, message_class, output
from tirgeo_ros.nodes.runner import run

TOPICS = ("tirgeo/odometry", "tirgeo/camera_pose", "tirgeo/origin")
#: A busy machine must lose nothing on this side.
_DEPTH = 2000


class FleetWitness(GraphNode):
    """Hold raw subscriptions to every aircraft's outputs, and the bag that they go into."""

    def __init__(self) -> None:
        super().__init__("fleet_witness")
        aircraft = self.declare_parameter("aircraft", "").value.split(",")
        self.resources = BagWriter(Path(self.declare_parameter("output", "").value))
        for name in aircraft:
            for topic in TOPICS:
                qos = latched() if topic == "tirgeo/origin" else output(_DEPTH)
                self._record(f"/{name}/{topic}", TOPIC_TYPES[topic], qos)

    def _record(self, topic: str, kind: str, qos: QoSProfile) -> None:
        def write(data: bytes) -> None:
            self.resources.write(topic, kind, data, self.now_ns)

        self.create_subscription(message_class(kind), topic, write, qos, raw=True)


main = partial(run, "fleet_witness", FleetWitness)
