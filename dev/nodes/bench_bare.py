"""Subscribe to the IMU and do nothing: the yardstick of ``python -m dev.bench.imu_load``."""

from __future__ import annotations

from functools import partial

from rclpy.node import Node
from sensor_msgs.msg import Imu

from tirgeo_ros.nodes.graph_node import sensor_input
from tirgeo_ros.nodes.runner import run


class BareSubscriber(Node):
    """Have rclpy decode each sample."""

    def __init__(self) -> None:
        super().__init__("bench_bare")
        self.create_subscription(Imu, "imu/data", lambda _: None, sensor_input())


main = partial(run, "bench_bare", BareSubscriber)
