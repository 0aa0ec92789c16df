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
