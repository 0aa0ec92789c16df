# ruff: noqa: E402 what follows imports ROS, which may be absent
"""The gimbal node over DDS: what it listens to, and what it says of the gimbal's north."""

from __future__ import annotations

import math

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import QuaternionStamped
from graph_helpers import await_words
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState

pytestmark = pytest.mark.graph

STEP_NS = 100_000_000
ITEM, TOPICS = "/gimbal_node: camera pose", "/gimbal_node: topics"


class Aircraft:
    """Publishes a hover; its clock goes a tenth of a second with each step."""

    def __init__(self, stranger) -> None:
        kinds = {
            "imu/data": Imu,
            "gimbal/attitude": QuaternionStamped,
            "tirgeo/odometry": Odometry,
            "gimbal/joint_states": JointState,
        }
        node = stranger.node
        self._publishers = {t: node.create_publisher(kind, t, 10) for t, kind in kinds.items()}
        self._kinds = kinds
        self._now_ns = 1_700_000_000_000_000_000

    def step(self, *, joints: bool) -> None:
        self._now_ns += STEP_NS
        for topic, kind in self._kinds.items():
            message = kind()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(self._now_ns, 10**9)
            if kind is JointState:
                message.name = [f"gimbal_{axis}_joint" for axis in ("yaw", "roll", "pitch")]
                message.position = [0.0, 0.0, 0.5]
            if joints or kind is not JointState:
                self._publishers[topic].publish(message)


@pytest.mark.slow
def test_it_goes_back_to_the_reported_attitude_when_joints_fall_silent(spawn, meet):
    gimbal, observer = spawn("gimbal_node"), meet(**{"/diagnostics": DiagnosticArray})
    await_words(gimbal, "ready")
    aircraft = Aircraft(observer)

    def says(composition: str, listens: bool, joints: bool) -> bool:
        aircraft.step(joints=joints)
        heard = "imu/data age [s]" in observer.diagnostic(TOPICS)
        told = observer.diagnostic(ITEM).get("")
        return told == f"composition: {composition}" and heard == listens

    observer.spin_until(lambda: says("encoders", listens=False, joints=True))
    observer.spin_until(lambda: says("paper", listens=True, joints=False))
    values = observer.diagnostic(ITEM)
    assert (values["joints_steady"], values["joints_silent"]) == ("1", "1")
    assert float(values["north_sigma_deg"]) > 0
    assert math.isfinite(float(values["north_bias_deg"]))
    gimbal.check_running()
