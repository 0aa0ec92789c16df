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
"""A node that knows nothing of this package, one that has only a log, waiting for processes."""

from __future__ import annotations

import json
import sys
import time
from collections import defaultdict
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import Messages, stamp_ns
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.monitor import Monitor
from tirgeo_ros.tools.graph.node_graph import NodeProcess

#: By default a reader that halts, as on a machine with other work, finds the samples of the last
#: two seconds, and the newest frame only. Here each one counts.
INPUTS = (
    "/imu/data",
    "/rtk/fix",
    "/rtk/vel",
    "/rtk/heading",
    "/gps/fix",
    "/gps/vel",
    "/gimbal/joint_states",
    "/gimbal/attitude",
    "/thermal/image_raw/compressed",
)
BETWEEN = ("/tirgeo/odometry", "/tirgeo/camera_pose")
PICTURES = ("/tirgeo/overlay/image", "/tirgeo/overlay/image/compressed")


def deep_queues() -> str:
    """A parameter file's part that lets no message be lost; the file itself may have /**."""
    deep, whole = {"depth": 300}, {"depth": 300, "reliability": "reliable"}
    overrides = {topic: {"publisher": deep, "subscription": whole} for topic in INPUTS}
    overrides |= {topic: {"publisher": deep, "subscription": deep} for topic in BETWEEN}
    overrides |= {topic: {"publisher": {"depth": 30}} for topic in PICTURES}
    return f"/**/*: {json.dumps({'ros__parameters': {'qos_overrides': overrides}})}\n"


class Stranger:
    """A node that knows nothing of this package."""

    def __init__(self, domain: int, topics: dict[str, type]) -> None:
        self.context = Context()
        rclpy.init(context=self.context, args=[], domain_id=domain)
        self.node = Node("stranger", context=self.context)
        self.received = defaultdict(list)
        for topic, kind in topics.items():
            # Deep enough that a busy machine loses nothing on this side.
            self.node.create_subscription(kind, topic, self.received[topic].append, 1000)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def spin_until(self, done, timeout_s: float = 60.0) -> None:
        end_s = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < end_s, {k: len(v) for k, v in self.received.items()}
            self.executor.spin_once(timeout_sec=0.1)

    def diagnostic(self, name: str) -> dict[str, str]:
        """Return the newest item of a name: its values, its message as "", its level."""
        for array in reversed(self.received["/diagnostics"]):
            for status in array.status:
                if status.name == name:
                    reports = {"": status.message, "level": str(status.level[0])}
                    return reports | {pair.key: pair.value for pair in status.values}
        return {}

    def send(self, messages: dict[str, list], done) -> None:
        """Publish each topic's messages round about until the answer is there.

        Best effort may lose some.
        """
        make = self.node.create_publisher
        publishers = {topic: make(type(sent[0]), topic, 10) for topic, sent in messages.items()}

        def step() -> bool:
            for topic, sent in messages.items():
                for message in sent:
                    publishers[topic].publish(message)
            return done()

        self.spin_until(step)

    def ask(self, service: str, kind: type, **request: Any) -> Any:
        """Return a service's answer to a request, by default an empty one.

        Asks again each second: ROS drops an answer where the server has not met the reader of it.
        """
        client = self.node.create_client(kind, service)
        asked = []

        def answered() -> bool:
            due_s = asked[-1][0] + 1.0 if asked else 0.0
            if client.service_is_ready() and time.monotonic() > due_s:
                asked.append((time.monotonic(), client.call_async(kind.Request(**request))))
            return any(answer.done() for _, answer in asked)

        self.spin_until(answered)
        return next(answer.result() for _, answer in asked if answer.done())

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


def await_words(process: NodeProcess, words: str, timeout_s: float = 60.0) -> None:
    end_s = time.monotonic() + timeout_s
    while not process.said(words):
        process.check_running()
        assert time.monotonic() < end_s, f"{process.name} never said {words!r}"
        time.sleep(0.02)


def sockets(pid: int) -> list[IPv4Address | IPv6Address]:
    """Local addresses of the UDP and TCP sockets of a process."""
    links = (str(link.readlink()) for link in Path(f"/proc/{pid}/fd").iterdir())
    inodes = {link[8:-1] for link in links if link.startswith("socket:[")}
    outcome = []
    for table in ("udp", "udp6", "tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            words = line.split()
            if words[9] in inodes:
                outcome.append(address(words[1].partition(":")[0]))
    return outcome


def address(words: str) -> IPv4Address | IPv6Address:
    """Read an address as /proc/net has it: 32-bit words in the byte order of the machine."""
    parts = (int(words[i : i + 8], 16) for i in range(0, len(words), 8))
    return ip_address(b"".join(part.to_bytes(4, sys.byteorder) for part in parts))


def stamps_of(bag: Path, topic: str) -> list[int]:
    """The stamps of a topic's messages in a bag (ns)."""
    cdr = Cdr()
    outcome = BagReader(bag).messages([topic])
    return [stamp_ns(cdr.deserialize(item.data, item.typename)) for item in outcome]


class KeptLog:
    """A node that has nothing but a logger, which keeps its ``lines``: (severity, text)."""

    log, guarded, item = GraphNode.log, GraphNode.guarded, GraphNode.item
    item_name, pause = GraphNode.item_name, GraphNode.pause
    messages, now_ns, executor = Messages(), 0, None

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []
        self.monitor = Monitor()
        self.published: list[Any] = []

    def advertise(self, topic: str, qos: Any) -> Any:  # noqa: ARG002 as GraphNode
        return SimpleNamespace(publish=self.published.append)

    def get_logger(self) -> KeptLog:
        return self

    def get_fully_qualified_name(self) -> str:
        return "/uav1/ekf_node"

    def info(self, text: str) -> None:
        self.lines.append(("info", text))

    def warning(self, text: str) -> None:
        self.lines.append(("warning", text))

    def error(self, text: str) -> None:
        self.lines.append(("error", text))

    def texts(self, severity: str = "") -> list[str]:
        """Return the texts of one severity, or all."""
        return [text for kind, text in self.lines if severity in ("", kind)]
