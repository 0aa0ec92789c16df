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

# ruff: noqa: E402 what follows imports ROS, which may be absent
"""dji_node: psdk_ros2's topics to readings, and a port with an aircraft that hovers."""

from __future__ import annotations

import math
import time
from types import SimpleNamespace

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")
pytest.importorskip("serial", reason="needs pyserial")

from aircraft_on_port import HEADING_RAD, HEIGHT_M, LATITUDE_RAD, PITCH_RAD, AircraftOnPort
from geometry_msgs.msg import (
    QuaternionStamped,
    TwistStamped,
    TwistWithCovarianceStamped,
    Vector3Stamped,
)
from graph_helpers import await_words
from sensor_msgs.msg import Imu, JointState, NavSatFix
from std_msgs.msg import UInt8

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.messages import camera_attitude, imu_sample, joint_sample, stamp_ns as stamp_of
from tirgeo_ros.io.messages.sensor_messages import heading_sample
from tirgeo_ros.nodes import dji_node
from tirgeo_ros.nodes.dji_node import PsdkSource
from tirgeo_ros.nodes.graph_node import GraphNode
from tirgeo_ros.nodes.monitor import OK, WARN

pytestmark = pytest.mark.graph

STAMP_NS = 1_700_000_000_000_000_005


class Aircraft:
    """A node with a PsdkSource, as dji_node is one, that keeps what it is given."""

    def __init__(self, stranger, prefix: str = "psdk_ros2") -> None:
        self.node = GraphNode("aircraft", context=stranger.context)
        stranger.executor.add_node(self.node)
        self.readings = []
        config = DjiConfig(source="psdk", psdk_prefix=prefix)
        self.source = PsdkSource(self.node, config, self.readings.extend)


@pytest.fixture
def stranger(meet):
    return meet()


@pytest.fixture
def aircraft(stranger):
    return Aircraft(stranger)


def vector(kind: type, *xyz: float):
    message = kind()
    held = message.twist.linear if kind is TwistStamped else message.vector
    held.x, held.y, held.z = xyz
    return message


def place() -> NavSatFix:
    """As psdk_ros2 fills it: no status, no covariance."""
    return NavSatFix(latitude=52.0, longitude=-120.0, altitude=88.5)


def northward(message):
    """The nose to the north: 90 deg from the east against the clock."""
    held = message.quaternion if isinstance(message, QuaternionStamped) else message.orientation
    held.w, held.x, held.y, held.z = math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)
    return message


def imu() -> Imu:
    message = northward(Imu())
    rate = message.angular_velocity
    rate.x, rate.y, rate.z, message.linear_acceleration.z = 0.1, 0.2, 0.3, 9.8
    return message


#: psdk_interfaces' messages by their fields, without the package. -90 deg as it is sent.
HEADER = SimpleNamespace(stamp=SimpleNamespace(sec=1_700_000_000, nanosec=5))
YAW = SimpleNamespace(header=HEADER, yaw=65446)
DETAILS = SimpleNamespace(
    header=HEADER,
    fix_state=3.0,
    horizontal_accuracy=1500.0,
    vertical_accuracy=2500.0,
    speed_accuracy=40.0,
)
NORTH, HERE = (1.0, 0.0, 0.0, 0.0), (math.radians(52.0), math.radians(-120.0), 88.5)


@pytest.mark.parametrize(
    ("topic", "message", "expected"),
    [
        ("attitude", northward(QuaternionStamped()), {"q_nb": NORTH}),
        ("imu", imu(), {"acceleration_b": (0.0, 0.0, -1.0), "angular_rate_b": (0.1, -0.2, -0.3)}),
        ("imu", imu(), {"q_nb": NORTH}),
        (
            "gimbal_angles",
            vector(Vector3Stamped, 0.1, 0.5, 1.571),
            {"roll_rad": 0.1, "pitch_rad": -0.5, "yaw_rad": 0.0},
        ),
        ("gps_position", place(), {"place": HERE}),
        ("gps_velocity", vector(TwistStamped, 1.0, 2.0, 3.0), {"velocity_n": (1.0, 2.0, 3.0)}),
        ("rtk_yaw", YAW, {"yaw_deg": -90, "yaw_flag": 50}),
        (
            "gps_details",
            DETAILS,
            {
                "fix": 3,
                "horizontal_sigma_m": 1.5,
                "vertical_sigma_m": 2.5,
                "velocity_sigma_m_s": 0.4,
            },
        ),
    ],
)
def test_each_topic_becomes_its_reading(aircraft, stranger, topic, message, expected):
    aircraft.source.handle(topic, message)
    aircraft.source.handle("rtk_yaw_info", UInt8(data=50))

    def result() -> list:
        return [r for r in aircraft.readings if all(hasattr(r, name) for name in expected)]

    stranger.spin_until(result, timeout_s=10.0)  # an RTK epoch waits for its parts
    (reading,) = result()
    for name, value in expected.items():
        assert getattr(reading, name) == pytest.approx(value, rel=1e-11, abs=1e-15)


def test_an_rtk_position_without_its_flag_goes_on_by_the_timer(aircraft, stranger):
    position = place()
    position.header.stamp.sec, position.header.stamp.nanosec = divmod(STAMP_NS, 10**9)
    aircraft.source.handle("rtk_position", position)
    assert aircraft.readings == []
    stranger.spin_until(lambda: aircraft.readings, timeout_s=10.0)
    (reading,) = aircraft.readings
    assert (reading.stamp_ns, reading.position_flag) == (STAMP_NS, None)


def test_with_psdk_interfaces_nothing_is_missing(stranger, monkeypatch):
    """Any type does for being there: its topics are not sent."""
    types = dict.fromkeys(dji_node._LOST, dji_node.PSDK_TOPICS["rtk_yaw_info"])
    monkeypatch.setattr(dji_node, "PSDK_TOPICS", dji_node.PSDK_TOPICS | types)
    item = Aircraft(stranger).source.report()
    assert (item.level, item.message) == (OK, "ok")


def test_silence_is_logged_and_so_is_its_end(aircraft, monkeypatch):
    monkeypatch.setattr(dji_node, "SILENT_S", 0.0)
    text = aircraft.source.report()
    assert text.level == WARN
    assert "nothing comes from psdk_ros2 on psdk_ros2/*" in text.message
    (finding,) = aircraft.source.findings()
    assert finding.evidence == text.message
    monkeypatch.setattr(dji_node, "SILENT_S", 60.0)
    aircraft.source.handle("rtk_yaw_info", UInt8(data=50))
    assert "nothing comes" not in aircraft.source.report().message


def test_a_prefix_that_names_no_topic_is_refused(stranger):
    with pytest.raises(
        ConfigError, match="psdk_prefix: '1 2' is not a valid prefix of topic names"
    ):
        Aircraft(stranger, prefix="1 2")


def test_dji_node_gives_the_graph_its_topics(spawn, meet):
    """Another process, with nothing but standard types."""
    node = spawn("dji_node", "-p", "source:=psdk", "-p", "geoid_undulation_m:=40.0")
    await_words(node, "ready")
    wanted = {
        "imu/data": Imu,
        "rtk/fix": NavSatFix,
        "rtk/vel": TwistWithCovarianceStamped,
        "gps/fix": NavSatFix,
        "gimbal/attitude": QuaternionStamped,
        "gimbal/joint_states": JointState,
    }
    stranger, fix = meet(**wanted), place()
    topics = {
        "imu": imu(),
        "rtk_position": fix,
        "rtk_velocity": vector(TwistStamped, 1.0, 2.0, 3.0),
        "rtk_position_info": UInt8(data=50),
        "gps_position": place(),
        "gimbal_angles": vector(Vector3Stamped, 0.0, 0.5, 1.571),
    }
    got = stranger.received

    def done() -> bool:
        fix.latitude += 1e-7  # a centimetre: what does not change is a repeat
        for message in topics.values():
            if hasattr(message, "header"):
                message.header.stamp = stranger.node.get_clock().now().to_msg()
        return all(map(got.get, wanted)) and got["rtk/fix"][-1].status.status == 2

    stranger.send({f"psdk_ros2/{topic}": [message] for topic, message in topics.items()}, done)
    rtk = got["rtk/fix"][-1]
    assert rtk.latitude == pytest.approx(52.0, abs=1e-3)
    assert rtk.altitude == pytest.approx(128.5)
    assert rtk.position_covariance_type != NavSatFix.COVARIANCE_TYPE_UNKNOWN
    assert rtk.position_covariance[0] == pytest.approx(0.01**2)
    linear = got["rtk/vel"][-1].twist.twist.linear
    assert (linear.x, linear.y, linear.z) == (2.0, 1.0, -3.0)
    # Half a radian down, seen along the nose.
    joints = got["gimbal/joint_states"][-1]
    angles = dict(zip(joints.name, joints.position, strict=True))
    assert angles["gimbal_pitch_joint"] == pytest.approx(0.5, abs=1e-9)
    assert angles["gimbal_yaw_joint"] == pytest.approx(0.0, abs=1e-9)
    assert got["imu/data"][-1].linear_acceleration.z == pytest.approx(9.80665)
    node.check_running()
    assert "Traceback" not in node.log.read_text()


def test_an_aircraft_on_a_port_becomes_topics_and_comes_back_after_a_pull(spawn, meet, tmp_path):
    stranger = meet(
        imu__data=Imu,
        rtk__fix=NavSatFix,
        rtk__heading=Imu,
        gimbal__attitude=QuaternionStamped,
        gimbal__joint_states=JointState,
    )
    received = stranger.received
    with AircraftOnPort(tmp_path / "aircraft") as aircraft:
        node = spawn(
            "dji_node", "-p", f"port:={tmp_path / 'aircraft'}", "-p", "geoid_undulation_m:=0.0"
        )
        stranger.spin_until(
            lambda: len(received["rtk/fix"]) >= 5 and len(received["imu/data"]) > 50
        )
        age_s = time.time() - stamp_of(received["imu/data"][-1]) * 1e-9
        assert -0.1 < age_s < 5.0  # of now, in the host's clock; the machine may be busy

        assert imu_sample(received["imu/data"][-1]).specific_force_b[2] == pytest.approx(-9.81)
        fix = received["rtk/fix"][-1]
        assert fix.latitude == pytest.approx(math.degrees(LATITUDE_RAD), abs=1e-9)
        assert fix.altitude == pytest.approx(HEIGHT_M, abs=0.1)
        assert fix.status.status == 2
        # The baseline in whole degrees: half of one.
        heading = heading_sample(received["rtk/heading"][-1]).heading_rad
        assert heading == pytest.approx(HEADING_RAD, abs=math.radians(0.5))
        joints = joint_sample(received["gimbal/joint_states"][-1])
        assert joints.pitch_rad == pytest.approx(PITCH_RAD, abs=1e-5)
        camera = euler_from_quat(camera_attitude(received["gimbal/attitude"][-1]).q_ng)
        # Angles of single precision, and the quaternion of the message.
        assert camera == pytest.approx([0.0, PITCH_RAD, HEADING_RAD], abs=1e-6)

        aircraft.pull()
        await_words(node, "the port is gone")
        aircraft.plug()
        count = len(received["imu/data"])
        stranger.spin_until(lambda: len(received["imu/data"]) > count + 100)
        assert node.poll() is None
