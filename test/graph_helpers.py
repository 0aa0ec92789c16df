"""A node that knows nothing of this package, and waiting for processes."""

from __future__ import annotations

import time
from collections import defaultdict

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from tirgeo_ros.tools.node_process import NodeProcess


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
