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
"""Play the flights of several aircraft at once, each in its namespace, for ``dev.fleet``.

All begin now. An aircraft's stamps are later than those of the one before by a millisecond, so
that not all speak in the same instant, and by a nanosecond: stamps of the flights are whole
milliseconds, so the nanoseconds below say whose sample it was, whatever comes of it.

When it starts it writes as JSON how much later (ns) each aircraft's stamps are than its bag's. It
records what the graphs give, byte for byte.
"""

from __future__ import annotations

import heapq
import json
import threading
import time
from functools import partial
from operator import itemgetter
from pathlib import Path

from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from dev.flights import stamped
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.io.messages.topics import STREAM_DEPTH
from tirgeo_ros.nodes.bag_player import PlayClock, await_readers
from tirgeo_ros.nodes.graph_node import GraphNode, latched, message_class, output
from tirgeo_ros.nodes.runner import run

_MS, _LEAD_NS = 1_000_000, 500_000_000
_OWN_NS = _MS + 1  # between the stamps of an aircraft and the next
_WAIT_S = 120.0
#: A busy machine must lose nothing on this side.
_DEPTH = 2000
_AWAITED = ("imu/data", "rtk/fix", "rtk/vel", "rtk/heading", "gimbal/joint_states")

Due = tuple[int, int, Publisher, bytearray]  # when, with which stamp (ns), by whom, what


class FleetPlayer(GraphNode):
    """Hold the flights in memory, with their publishers."""

    def __init__(self) -> None:
        super().__init__("fleet_player")
        bags = [Path(bag) for bag in self.declare_parameter("bags", "").value.split(",")]
        self._shifts = Path(self.declare_parameter("shifts", "").value)
        self.resources = BagWriter(Path(self.declare_parameter("recording", "").value))
        self._rate = self.declare_parameter("rate", 1.0).value
        self._names = [bag.stem for bag in bags]
        self._all: list[Publisher] = []
        flights = [self._flight(bag, number) for number, bag in enumerate(bags, 1)]
        self._due = list(heapq.merge(*flights, key=itemgetter(0)))
        for name in self._names:
            self._record(f"/{name}/tirgeo/odometry", "tirgeo/odometry", output(_DEPTH))
            self._record(f"/{name}/tirgeo/camera_pose", "tirgeo/camera_pose", output(_DEPTH))
            self._record(f"/{name}/tirgeo/origin", "tirgeo/origin", latched())

    def _record(self, name: str, topic: str, qos: QoSProfile) -> None:
        kind = TOPIC_TYPES[topic]

        def write(data: bytes) -> None:
            self.resources.write(name, kind, data, self.now_ns)

        self.create_subscription(message_class(kind), name, write, qos, raw=True)

    def _flight(self, bag: Path, number: int) -> list[Due]:
        """Return an aircraft's messages in order; their times are the bag's, moved a little."""
        reader, by_topic = BagReader(bag), {}
        for topic, kind in reader.topics().items():
            name, qos = f"{bag.stem}{topic}", output(STREAM_DEPTH)
            by_topic[topic] = self.create_publisher(message_class(kind), name, qos)
        self._all += by_topic.values()
        own_ns = number * _OWN_NS
        return [
            (
                item.log_time_ns + own_ns,
                header_stamp_ns(item.data) + own_ns,
                by_topic[item.topic],
                bytearray(item.data),
            )
            for item in reader.messages()
        ]

    def play(self, stop: threading.Event) -> int:
        """Wait for the graphs, play all to the end, stay until stopped; return the exit code."""
        wanted = ",".join(f"{name}/{topic}" for name in self._names for topic in _AWAITED)
        missing = await_readers(self, self._all, wanted, _WAIT_S, stop)
        if missing:
            self.get_logger().error(f"no {missing}")
            return 1
        first_ns = self._due[0][0]
        moved_ns = (time.time_ns() - first_ns) // _MS * _MS + _LEAD_NS
        shifts = {name: moved_ns + n * _OWN_NS for n, name in enumerate(self._names, 1)}
        self._shifts.write_text(json.dumps(shifts))
        self.get_logger().info("playing")
        clock = PlayClock(self._rate, lambda _: None)
        clock.begin(first_ns, _LEAD_NS * 1e-9)
        for due_ns, stamp_ns, publisher, data in self._due:
            if not clock.wait_until(due_ns, stop):
                return 0
            publisher.publish(stamped(data, stamp_ns + moved_ns))
        self.get_logger().info("played")
        stop.wait()
        return 0


main = partial(run, "fleet_player", FleetPlayer, FleetPlayer.play)
