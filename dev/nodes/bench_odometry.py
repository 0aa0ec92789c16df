"""Note when each pose of the filter arrives, for ``python -m dev.imu_load``.

At the end stamps and times of arrival (ns) are written as JSON.
"""

from __future__ import annotations

import time
from functools import partial
from typing import Any

from dev.nodes.bench_video import until_over
from tirgeo_ros.io.messages import stamp_ns
from tirgeo_ros.io.messages.offered_qos import STREAM_DEPTH
from tirgeo_ros.nodes.graph_node import GraphNode, output
from tirgeo_ros.nodes.runner import run


class OdometryViewer(GraphNode):
    """Takes ``tirgeo/odometry``."""

    def __init__(self) -> None:
        super().__init__("bench_odometry")
        self.duration_s = self.declare_parameter("duration_s", 60.0).value
        self.output = self.declare_parameter("output", "").value
        self._came: list[tuple[int, int]] = []
        self.listen("tirgeo/odometry", self._take, output(STREAM_DEPTH))

    def _take(self, message: Any) -> None:
        came_ns = time.time_ns()
        self._came.append((stamp_ns(message), came_ns))

    def found(self) -> list[tuple[int, int]]:
        """What is written at the end."""
        return self._came


main = partial(run, "bench_odometry", OdometryViewer, until_over)
