"""Nodes that stand still for a while, as on a busy computer, find all that came meanwhile."""

from __future__ import annotations

import signal
import time
from contextlib import suppress

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import await_words
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState

from tirgeo_ros.core.types.measurements import ImuSample, JointSample
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.nodes.qos import STREAM_DEPTH, output
from tirgeo_ros.nodes.topics import message_class

# A stop may meet a node that holds the lock of its port of shared memory, the more so where many
# processes share a processor: Fast DDS then drops all that is sent meanwhile.
pytestmark = [pytest.mark.graph, pytest.mark.slow, pytest.mark.long]

IMU_HZ, GIMBAL_HZ = 200, 100
#: 540 samples: more than a port of shared memory holds by itself, 512. A queue holds 800: a node
#: that a busy machine resumes 1.3 s late still finds them all.
STOP_S = 2.7
NAVIGATION, CAMERA = "/ekf_node: navigation", "/gimbal_node: camera pose"
MESSAGES = Messages(message_class)


class Aircraft:
    """Publishes an IMU, and joints with the body's pose of the same stamp."""

    def __init__(self, stranger) -> None:
        self.stranger = stranger
        self.sent = {NAVIGATION: 0, CAMERA: 0}
        self._rng = np.random.default_rng(3)
        kinds = {"imu/data": Imu, "tirgeo/odometry": Odometry, "gimbal/joint_states": JointState}
        make, qos = stranger.node.create_publisher, output(STREAM_DEPTH)
        self._publishers = {topic: make(kind, topic, qos) for topic, kind in kinds.items()}

    def heard(self) -> bool:
        """Whether each topic has its reader."""
        return all(p.get_subscription_count() for p in self._publishers.values())

    def fly(self, duration_s: float) -> None:
        begin_s = time.monotonic()
        for number in range(round(duration_s * IMU_HZ)):
            time.sleep(max(0.0, begin_s + number / IMU_HZ - time.monotonic()))
            self._publish(time.time_ns(), gimbal=number % (IMU_HZ // GIMBAL_HZ) == 0)

    def _publish(self, now_ns: int, *, gimbal: bool) -> None:
        force_b, rate_b = self._rng.normal([[0, 0, -9.8], [0, 0, 0]], 0.01)
        self._publishers["imu/data"].publish(MESSAGES.imu(ImuSample(now_ns, force_b, rate_b)))
        self.sent[NAVIGATION] += 1
        if gimbal:
            body = Odometry()
            body.header.stamp.sec, body.header.stamp.nanosec = divmod(now_ns, 10**9)
            self._publishers["tirgeo/odometry"].publish(body)
            joints = MESSAGES.joints(JointSample(now_ns, 0.0, 0.0, -0.5))
            self._publishers["gimbal/joint_states"].publish(joints)
            self.sent[CAMERA] += 1

    def await_diagnostics(self) -> None:
        """Until there are some that were made later than now."""
        for _ in range(2):  # of which the first may be on its way
            self.stranger.received["/diagnostics"].clear()
            self.stranger.spin_until(lambda: all(self.counts().values()))

    def missing(self) -> dict[str, int]:
        """How much of what was sent is in no count."""
        counts = self.counts()
        return {name: number - counts[name] for name, number in self.sent.items()}

    def counts(self) -> dict[str, int]:
        """How many IMU samples have a verdict, and how many joints became a camera's pose."""
        found = {NAVIGATION: 0, CAMERA: 0}
        for name, numbers in self.status().items():
            counted = [k for k in numbers if k.startswith("count.imu.") or k == "composed"]
            found[name] = sum(int(numbers[key]) for key in counted)
        return found

    def status(self) -> dict[str, dict[str, str]]:
        """Return the newest values of both items."""
        return {name: self.stranger.diagnostic(name) for name in (NAVIGATION, CAMERA)}


def test_a_stop_loses_no_sample_of_the_imu_and_no_pose_of_the_gimbal(spawn, meet):
    nodes = [spawn("ekf_node"), spawn("gimbal_node", "-p", "composition:=encoders")]
    for node in nodes:
        await_words(node, "ready")
    aircraft = Aircraft(meet(**{"/diagnostics": DiagnosticArray}))
    aircraft.stranger.spin_until(aircraft.heard)

    def begun() -> bool:
        aircraft.fly(0.1)
        return all(aircraft.counts().values())

    aircraft.stranger.spin_until(begun)
    aircraft.await_diagnostics()
    lost = aircraft.missing()  # by a reader that was met late
    for number in (signal.SIGSTOP, signal.SIGCONT):
        for node in nodes:
            node.signal(number)
        aircraft.fly(STOP_S if number == signal.SIGSTOP else 0.2)

    def more_missing() -> dict[str, int]:
        # Fewer are missing where some of these were only waiting.
        return {name: n - lost[name] for name, n in aircraft.missing().items() if n > lost[name]}

    with suppress(AssertionError):
        aircraft.stranger.spin_until(lambda: not more_missing())
    assert not more_missing(), (aircraft.sent, lost, aircraft.status())
