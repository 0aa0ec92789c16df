# ruff: noqa: E402 what follows imports ROS, which may be absent
"""psdk_ros2's topics over DDS to readings, and what a person is told of them."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from geometry_msgs.msg import (
    QuaternionStamped,
    TwistStamped,
    TwistWithCovarianceStamped,
    Vector3Stamped,
)
from graph_helpers import await_words
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState, NavSatFix
from std_msgs.msg import UInt8

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.dji.sources.readings import (
    AttitudeReading,
    GimbalReading,
    GpsReading,
    ImuReading,
    RtkReading,
)
from tirgeo_ros.nodes import psdk_source
from tirgeo_ros.nodes.monitor import OK, WARN, Monitor
from tirgeo_ros.nodes.psdk_source import PsdkSource

pytestmark = pytest.mark.graph

SECOND = 1_000_000_000


class Aircraft:
    """A node with a PsdkSource, as dji_node is one, that keeps what it is given."""

    def __init__(self, stranger, prefix: str = "psdk_ros2") -> None:
        self.stranger = stranger
        self.node = Node("aircraft", context=stranger.context)
        stranger.executor.add_node(self.node)
        self.readings = []
        self.monitor = Monitor()
        config = DjiConfig(source="psdk", psdk_prefix=prefix)
        self.source = PsdkSource(self.node, config, self.readings.extend, self.monitor)

    def of(self, kind: type, *parts: str) -> list:
        """The readings of a kind that have these parts."""
        of_kind = (r for r in self.readings if isinstance(r, kind))
        return [r for r in of_kind if all(getattr(r, part) is not None for part in parts)]

    def item(self):
        (item,) = self.source.items()
        return item

    def send(self, messages: dict, done, prefix: str = "psdk_ros2") -> None:
        send(self.stranger, messages, done, prefix)


def send(stranger, messages: dict, done, prefix: str = "psdk_ros2") -> None:
    """Each message in this order, again and again: best effort may lose some."""
    sender = stranger.node
    publishers = {
        topic: sender.create_publisher(type(message), f"{prefix}/{topic}", 10)
        for topic, message in messages.items()
    }

    def step() -> bool:
        for topic, message in messages.items():
            if hasattr(message, "header"):
                message.header.stamp = sender.get_clock().now().to_msg()
            publishers[topic].publish(message)
        return done()

    stranger.spin_until(step)


@pytest.fixture
def aircraft(meet):
    return Aircraft(meet())


def vector(kind: type, xyz: tuple[float, float, float]):
    message = kind()
    held = message.twist.linear if kind is TwistStamped else message.vector
    held.x, held.y, held.z = xyz
    return message


def place(latitude: float) -> NavSatFix:
    """As psdk_ros2 fills it: no status, no covariance."""
    return NavSatFix(latitude=latitude, longitude=-120.0, altitude=88.5)


def attitude_of(message) -> None:
    """The nose to the north: 90 deg from the east against the clock."""
    message.w, message.x, message.y, message.z = math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)


def test_inertial_topics_and_the_gimbal(aircraft):
    attitude, imu = QuaternionStamped(), Imu()
    attitude_of(attitude.quaternion)
    attitude_of(imu.orientation)
    imu.angular_velocity.x, imu.angular_velocity.y, imu.angular_velocity.z = 0.1, 0.2, 0.3
    imu.linear_acceleration.z = 9.8
    gimbal = vector(Vector3Stamped, (0.1, 0.5, 1.571))
    kinds = (AttitudeReading, ImuReading, GimbalReading)
    topics = {"attitude": attitude, "imu": imu, "gimbal_angles": gimbal}
    before_ns = aircraft.node.get_clock().now().nanoseconds
    aircraft.send(topics, lambda: all(map(aircraft.of, kinds)))
    after_ns = aircraft.node.get_clock().now().nanoseconds
    body, sensed, camera = (aircraft.of(kind)[0] for kind in kinds)
    assert body.q_nb == pytest.approx((1.0, 0.0, 0.0, 0.0), abs=1e-15)
    assert sensed.q_nb == pytest.approx((1.0, 0.0, 0.0, 0.0), abs=1e-15)
    assert sensed.acceleration_b == pytest.approx((0.0, 0.0, -1.0))
    assert sensed.angular_rate_b == (0.1, -0.2, -0.3)
    assert (camera.roll_rad, camera.pitch_rad, camera.yaw_rad) == (0.1, -0.5, 0.0)
    assert all(before_ns <= r.stamp_ns <= after_ns for r in (body, sensed, camera))


def test_the_ordinary_gps(aircraft):
    topics = {
        "gps_position": place(52.0),
        "gps_velocity": vector(TwistStamped, (1.0, 2.0, 3.0)),
    }
    parts = ("place", "velocity_n")
    aircraft.send(topics, lambda: all(aircraft.of(GpsReading, part) for part in parts))
    where = aircraft.of(GpsReading, "place")[0].place
    assert where == (math.radians(52.0), math.radians(-120.0), 88.5)
    assert aircraft.of(GpsReading, "velocity_n")[0].velocity_n == (1.0, 2.0, 3.0)


def test_fused_values_stand_in_where_nothing_else_comes(aircraft):
    topics = {
        "gps_position_fused": place(52.0),
        "velocity_ground_fused": vector(Vector3Stamped, (2.0, 1.0, -3.0)),
    }
    parts = ("place", "velocity_n")
    aircraft.send(topics, lambda: all(aircraft.of(GpsReading, part) for part in parts))
    # By the other pi it is 2.8e-8 more.
    where = aircraft.of(GpsReading, "place")[0].place
    assert where.latitude_rad == pytest.approx(math.radians(52.0) * (1 + 2.783e-8), rel=1e-11)
    assert aircraft.of(GpsReading, "velocity_n")[0].velocity_n == (1.0, 2.0, 3.0)


def test_an_rtk_position_without_its_flag_goes_on_by_the_timer(aircraft):
    position = place(52.0)
    position.header.stamp.sec = 1_700_000_000
    aircraft.source.handle("rtk_position", position)
    assert aircraft.readings == []
    aircraft.stranger.spin_until(lambda: aircraft.readings, timeout_s=10.0)
    (reading,) = aircraft.readings
    assert reading.stamp_ns == 1_700_000_000 * SECOND
    assert reading.position_flag is None


def test_the_yaw_of_psdk_interfaces(aircraft):
    """Its fields, without the package: -90 as it is sent."""
    stamp = SimpleNamespace(sec=1_700_000_000, nanosec=5)
    yaw = SimpleNamespace(header=SimpleNamespace(stamp=stamp), yaw=65446)
    aircraft.source.handle("rtk_yaw", yaw)
    aircraft.source.handle("rtk_yaw_info", UInt8(data=50))
    aircraft.stranger.spin_until(lambda: aircraft.readings, timeout_s=10.0)
    (reading,) = aircraft.of(RtkReading, "yaw_deg")
    assert (reading.yaw_deg, reading.yaw_flag) == (-90, 50)
    assert reading.stamp_ns == 1_700_000_000 * SECOND + 5


def test_the_accuracies_of_psdk_interfaces(aircraft):
    details = SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=1_700_000_000, nanosec=0)),
        fix_state=3.0,
        horizontal_accuracy=1500.0,
        vertical_accuracy=2500.0,
        speed_accuracy=40.0,
    )
    aircraft.source.handle("gps_details", details)
    (reading,) = aircraft.of(GpsReading, "fix")
    assert reading.fix == 3
    assert (reading.horizontal_sigma_m, reading.vertical_sigma_m) == (1.5, 2.5)
    assert reading.velocity_sigma_m_s == pytest.approx(0.4)


def test_with_psdk_interfaces_nothing_is_missing(meet, monkeypatch):
    """Any type does for being there: its topics are not sent."""
    types = {topic: ("std_msgs/msg/UInt8", lambda m: m.data) for topic in psdk_source._LOST}
    monkeypatch.setattr(psdk_source, "_TOPICS", psdk_source._TOPICS | types)
    item = Aircraft(meet()).item()
    assert (item.level, item.message) == (OK, "ok")


def test_silence_is_said_and_taken_back(aircraft, monkeypatch):
    monkeypatch.setattr(psdk_source, "SILENT_S", 0.0)
    said = aircraft.item()
    assert said.level == WARN
    assert "nothing comes from psdk_ros2 on psdk_ros2/*" in said.message
    monkeypatch.setattr(psdk_source, "SILENT_S", 60.0)
    aircraft.send({"rtk_yaw_info": UInt8(data=50)}, lambda: aircraft.readings)
    assert "nothing comes" not in aircraft.item().message


def test_a_prefix_that_names_no_topic_is_refused(meet):
    with pytest.raises(ConfigError, match="psdk_prefix: '1 2' cannot stand in front of topics"):
        Aircraft(meet(), prefix="1 2")


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
    stranger = meet(**wanted)
    imu, fix = Imu(), place(52.0)
    attitude_of(imu.orientation)
    imu.linear_acceleration.z = 9.8
    topics = {
        "imu": imu,
        "rtk_position": fix,
        "rtk_velocity": vector(TwistStamped, (1.0, 2.0, 3.0)),
        "rtk_position_info": UInt8(data=50),
        "gps_position": place(52.0),
        "gimbal_angles": vector(Vector3Stamped, (0.0, 0.5, 1.571)),
    }
    got = stranger.received

    def done() -> bool:
        fix.latitude += 1e-7  # a centimetre: what does not change is a repeat
        return all(map(got.get, wanted)) and got["rtk/fix"][-1].status.status == 2

    send(stranger, topics, done)
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
