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
"""One of every message that tirgeo sends or reads, with no two numbers alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.testing import assert_allclose

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import canonical
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.ground_point import Located, enu_of
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.poses import BodyPose, CameraPose, NavSolution
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus, Outcome
from tirgeo_ros.io.messages import (
    Messages,
    NodeState,
    PictureState,
    TopicState,
    navigation_item,
)
from tirgeo_ros.io.messages.cdr import Cdr
from tirgeo_ros.io.messages.json_codec import answer_text, findings_text, state_text, targets_text

STAMP_NS = 1_700_000_000_123_456_789
Q = canonical(np.array([0.8, -0.3, 0.2, 0.4]))


def covariance(size: int, seed: int = 1) -> np.ndarray:
    """(size, size) positive definite, every entry its own."""
    root = np.random.default_rng(seed).normal(size=(size, size))
    return root @ root.T + np.eye(size)


IMU = ImuSample(STAMP_NS, np.array([0.1, -0.2, -9.8]), np.array([0.01, 0.02, -0.03]), Q)
POSITION = PositionSample(
    STAMP_NS, Source.RTK_POSITION, FixStatus.FIXED, 0.55, -2.1, 123.4, covariance(3)
)
VELOCITY = VelocitySample(
    STAMP_NS, Source.RTK_VELOCITY, np.array([1.0, 2.0, -0.5]), covariance(3, 2)
)
HEADING = HeadingSample(STAMP_NS, 5.5, 0.0003)
JOINTS = JointSample(STAMP_NS, yaw_rad=0.3, roll_rad=-0.1, pitch_rad=-0.6)
CAMERA_ATTITUDE = CameraAttitudeSample(STAMP_NS, Q)
SOLUTION = NavSolution(
    STAMP_NS,
    0.55,
    -2.1,
    123.4,
    np.array([2.0, -1.0, 0.3]),
    Q,
    np.array([0.02, -0.01, 0.3]),
    (1e-4, 2e-4, 3e-4),
    covariance(9),
)
BODY = BodyPose(STAMP_NS, np.array([10.0, -20.0, -30.0]), Q, covariance(6))
CAMERA_POSE = CameraPose(STAMP_NS, np.array([11.0, -21.0, -29.0]), Q, covariance(6, 3))
PLANE = TangentPlane(0.55, -2.1, 100.0)
BROWN = Camera(640, 512, 803.5, 797.6, 349.3, 251.8, (0.054, 0.3462, -0.0037, 0.0076))
RATIONAL = Camera(64, 48, 60.0, 61.0, 31.0, 23.0, (0.1, 0.02, 1e-3, 2e-3, 0.01, 0.2, 0.03, 0.01))
LOCATED = Located(
    STAMP_NS,
    31.5126787532,
    -120.32113697,
    99.5,
    enu_of(covariance(3, 5)),
    (12.25, 200.5),
    np.array([1.0, 2.0, 3.0]),
)
TARGET = Target("0" * 31 + "1", 1, "barn", "fire", "", "uav1", 7, STAMP_NS, (LOCATED,))
FINDING = Finding("rtk_vel_up", Severity.STOP, "up: 1 m/s", "rtk/vel", "ENU: z up; psdk: its key")
STATUS = NavigationStatus(
    "ekf_heading",
    FilterState.ALIGNING,
    "too slow",
    FixStatus.FLOAT,
    0.0123,
    {("rtk_position", "used"): 12, ("rtk_heading", "gated"): 3},
    {"rtk_position": 0.25, "rtk_heading": 1.75},
    state_s=3.75,
    resets={"rtk_position": 2, "rtk_heading": 1},
    last_reset="position by 3.21 m",
    clipped={"accelerometer x": 12},
    imu_delay_s=0.0045,
    imu_delay_sigma_s=0.0015,
    warnings=("imu/data: accelerometer x clipped", "another"),
    began_again=Outcome.GAP,
)
STATE = NodeState(
    "/uav1/overlay_node",
    STAMP_NS,
    STAMP_NS - 7,
    {
        "tirgeo/camera_pose": TopicState(50.0, 0.02, None, None, 3, 1, 2),
        "tirgeo/overlay/image": TopicState(9.0, None, 12.5, 14.5),
    },
    {"drawn": 7},
    STATUS,
    "encoders",
    PictureState(
        "NO MAP: no pose", 0.05, ConfidenceConfig(latency_sigma_s=0.01, focal_sigma=0.02), STAMP_NS
    ),
)
_GREY = np.arange(6 * 5, dtype=np.uint8).reshape(6, 5)
_COLOUR = np.arange(6 * 5 * 3, dtype=np.uint8).reshape(6, 5, 3)
_DEEP = np.arange(6 * 5, dtype="<u2").reshape(6, 5) * 700

#: Name to type and maker.
EVERY_MESSAGE: dict[str, tuple[str, Callable[[Messages], Any]]] = {
    "imu": ("sensor_msgs/msg/Imu", lambda m: m.imu(IMU)),
    "imu without attitude": (
        "sensor_msgs/msg/Imu",
        lambda m: m.imu(ImuSample(STAMP_NS, IMU.specific_force_b, IMU.angular_rate_b)),
    ),
    "position": ("sensor_msgs/msg/NavSatFix", lambda m: m.nav_sat_fix(POSITION, "rtk")),
    "velocity": (
        "geometry_msgs/msg/TwistWithCovarianceStamped",
        lambda m: m.velocity(VELOCITY, "rtk"),
    ),
    "heading": ("sensor_msgs/msg/Imu", lambda m: m.heading(HEADING)),
    "joints": ("sensor_msgs/msg/JointState", lambda m: m.joints(JOINTS)),
    "camera attitude": (
        "geometry_msgs/msg/QuaternionStamped",
        lambda m: m.camera_attitude(CAMERA_ATTITUDE),
    ),
    "odometry": ("nav_msgs/msg/Odometry", lambda m: m.odometry(SOLUTION, BODY)),
    "fix": ("sensor_msgs/msg/NavSatFix", lambda m: m.fix(SOLUTION)),
    "origin": ("sensor_msgs/msg/NavSatFix", lambda m: m.origin(PLANE, STAMP_NS)),
    "camera pose": (
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        lambda m: m.camera_pose(CAMERA_POSE),
    ),
    "mono8": ("sensor_msgs/msg/Image", lambda m: m.image(STAMP_NS, _GREY)),
    "mono16": ("sensor_msgs/msg/Image", lambda m: m.image(STAMP_NS, _DEEP)),
    "bgr8": ("sensor_msgs/msg/Image", lambda m: m.image(STAMP_NS, _COLOUR)),
    "compressed": (
        "sensor_msgs/msg/CompressedImage",
        lambda m: m.compressed(STAMP_NS, b"\xff\xd8 odd number of bytes"),
    ),
    "plumb_bob": ("sensor_msgs/msg/CameraInfo", lambda m: m.camera_info(BROWN, STAMP_NS)),
    "rational": ("sensor_msgs/msg/CameraInfo", lambda m: m.camera_info(RATIONAL, STAMP_NS)),
    "transforms": (
        "tf2_msgs/msg/TFMessage",
        lambda m: m.tf([m.body_transform(BODY), m.camera_transform(BODY, CAMERA_POSE)]),
    ),
    "footprint": (
        "geometry_msgs/msg/PolygonStamped",
        lambda m: m.footprint(STAMP_NS, np.arange(12.0).reshape(4, 3)),
    ),
    "path": ("nav_msgs/msg/Path", lambda m: m.path(STAMP_NS, [m.track_point(BODY)] * 2)),
    "targets": ("std_msgs/msg/String", lambda m: m.text(targets_text([TARGET] * 2))),
    "answer": ("std_msgs/msg/String", lambda m: m.text(answer_text(LOCATED))),
    "clock": ("rosgraph_msgs/msg/Clock", lambda m: m.clock(STAMP_NS)),
    "findings": (
        "std_msgs/msg/String",
        lambda m: m.text(findings_text("/ekf_node", STAMP_NS, [FINDING])),
    ),
    "state": ("std_msgs/msg/String", lambda m: m.text(state_text(STATE))),
    "diagnostics": (
        "diagnostic_msgs/msg/DiagnosticArray",
        lambda m: m.diagnostics(STAMP_NS, [navigation_item("ekf_node: state", STATUS)]),
    ),
}


# The only arithmetic between a sample and its twin is a rotation by 180 deg: a few roundings.
EXACT = 1e-14


cdr = Cdr()


builder = Messages()


def through_cdr(message):
    typename = message.__msgtype__
    return cdr.deserialize(cdr.serialize(message, typename), typename)


def assert_same_rotation(p, q, tolerance=EXACT):
    p, q = canonical(p), canonical(q)
    # Of a half turn both signs are canonical.
    assert_allclose(p * np.sign(p @ q), q, rtol=0, atol=tolerance)
