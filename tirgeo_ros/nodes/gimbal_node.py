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
"""Compose the camera's pose: the body's pose and the gimbal's angles in; the camera's pose out."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.subscription import Subscription

from tirgeo_ros.core.checks.gimbal_checks import GimbalChecks
from tirgeo_ros.core.checks.input_checks import parameter_findings
from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.gimbal.composer import GimbalComposer
from tirgeo_ros.core.streams.stamps import Arrivals
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.messages import (
    DiagnosticItem,
    body_pose,
    camera_attitude,
    imu_sample,
    joint_sample,
)
from tirgeo_ros.io.messages.topics import STREAM_DEPTH
from tirgeo_ros.nodes.graph_node import GraphNode, Transforms, output, sensor_input
from tirgeo_ros.nodes.monitor import OK
from tirgeo_ros.nodes.parameters import given_names
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.nodes.setup_checks import InputChecks, OtherPublishers, SetupChecks


class GimbalNode(GraphNode):
    """Connect one GimbalComposer with its topics."""

    def __init__(self) -> None:
        super().__init__("gimbal_node")
        config = self.configured(GimbalConfig, self._reconfigure)
        self._composer = GimbalComposer(config)
        set_names = given_names(self, GimbalConfig)
        self._checks = GimbalChecks(config, set_names)
        at_start = parameter_findings(set_names, (), "", pictures=True, option="--params-file")
        inputs = InputChecks(self, ("gimbal/joint_states", "gimbal/attitude"))
        self._setup = SetupChecks(
            self, inputs, OtherPublishers(self), self._checks, at_start=at_start
        )
        self._arrivals = Arrivals()
        stream = output(STREAM_DEPTH)
        self._camera_pose = self.advertise("tirgeo/camera_pose", stream)
        self._transforms = Transforms(self, config)
        self.listen("tirgeo/odometry", self._take_body, stream)
        self.monitor.expects("tirgeo/odometry")
        if config.composition != "paper":
            self.listen("gimbal/joint_states", self._take_joints, sensor_input())
        self.listen("gimbal/attitude", self._take_attitude, sensor_input())
        self._autopilot: Subscription | None = None
        self._follow_composition()
        self._logged_composition = ""
        self.report_each_second(
            self._items,
            self._setup.findings,
            composition=lambda: self._composer.composition,
            counts=lambda: self._composer.counts,
        )

    def _reconfigure(self, config: GimbalConfig) -> None:
        self._composer.configure(config)
        self._setup.take(self._checks.configure, config)

    def _follow_composition(self) -> None:
        """Listen to the IMU only while its attitude is needed: it is the fastest topic."""
        needed = self._composer.composition != "encoders"
        if needed and self._autopilot is None:
            self._autopilot = self.listen("imu/data", self._take_autopilot, sensor_input())
        elif self._autopilot is not None and not needed:
            self.destroy_subscription(self._autopilot)
            self._autopilot = None

    def _take_body(self, message: Any) -> None:
        pose = body_pose(message)
        self._publish(self._composer.add_body(pose))
        self._follow_composition()
        self._setup.take(self._checks.body, pose)

    def _take_joints(self, message: Any) -> None:
        sample = self._stamped("gimbal/joint_states", joint_sample(message))
        self._publish(self._composer.add_joints(sample))
        self._setup.take(self._checks.joints, sample)

    def _take_attitude(self, message: Any) -> None:
        sample = self._stamped("gimbal/attitude", camera_attitude(message))
        if self._composer.composition != "encoders":  # the checks compare it in any case
            self._publish(self._composer.add_attitude(sample))
        self._setup.take(self._checks.reported, sample)

    def _take_autopilot(self, message: Any) -> None:
        sample = self._stamped("imu/data", imu_sample(message))
        if sample.autopilot_q_nb is not None:
            self._publish(self._composer.add_autopilot(sample.stamp_ns, sample.autopilot_q_nb))
            self._setup.take(self._checks.autopilot, sample.stamp_ns, sample.autopilot_q_nb)
            if sample.is_attitude_alone:
                take = self._checks.autopilot_alone
                self._setup.take(take, sample.stamp_ns, sample.autopilot_q_nb)

    def _stamped(self, topic: str, sample: Any) -> Any:
        return self._arrivals.stamped(topic, sample, self.now_ns)

    def _publish(self, poses: list[CameraPose]) -> None:
        for pose in poses:
            self._transforms.camera(pose, self._composer.body_at)
            if self._camera_pose.is_wanted:
                self._camera_pose.publish(self.messages.camera_pose(pose))
                self.monitor.published("tirgeo/camera_pose", 1e-9 * (self.now_ns - pose.stamp_ns))

    def _items(self) -> list[DiagnosticItem]:
        composition = self._composer.composition
        if composition != self._logged_composition:
            self.log(OK, f"composition: {composition}")
            self._logged_composition = composition
        values = self._composer.diagnostics | self._arrivals.diagnostics
        item = self.item("camera pose", values, f"composition: {composition}")
        return [item, self._setup.report()]


main = partial(run, "gimbal_node", GimbalNode)
