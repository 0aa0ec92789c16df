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
"""Subscribe to everything and never read, for ``make soak``."""

from __future__ import annotations

from functools import partial

import rclpy
from rclpy.node import Node

from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.nodes.graph_node import message_class, output
from tirgeo_ros.nodes.runner import run

TOPICS = (
    "tirgeo/odometry",
    "tirgeo/camera_pose",
    "tirgeo/overlay/image",
    "tirgeo/overlay/image/compressed",
    "/diagnostics",
)


class Mute(Node):
    """Holds a second node whose reliable subscriptions nobody spins."""

    def __init__(self) -> None:
        super().__init__("soak_mute")
        self._deaf = rclpy.create_node("soak_deaf", namespace=self.get_namespace())
        for topic in TOPICS:
            kind = message_class(TOPIC_TYPES[topic])
            self._deaf.create_subscription(kind, topic, self._never, output())

    def _never(self, _: object) -> None:
        raise AssertionError("nobody spins this")

    def destroy_node(self) -> None:
        """Both."""
        self._deaf.destroy_node()
        super().destroy_node()


main = partial(run, "soak_mute", Mute)
