# ruff: noqa: E402 what follows imports ROS, which may be absent
"""Single nodes over DDS: bad messages, the reset service, the latched origin, notices."""

from __future__ import annotations

import math
import time
from itertools import groupby, pairwise

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import await_words
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CompressedImage, Image, Imu, JointState, NavSatFix
from std_srvs.srv import Trigger

from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import Messages, navigation_status
from tirgeo_ros.nodes.graph_node import message_class

pytestmark = pytest.mark.graph


def imu(stamp_s: int, **fields) -> Imu:
    message = Imu()
    message.header.stamp.sec = stamp_s
    message.linear_acceleration.z = fields.get("z", 9.8)
    message.orientation.w = fields.get("w", 1.0)
    return message


@pytest.mark.slow
def test_messages_without_use_or_stamp_are_counted_and_told(spawn, meet):
    """Bad samples, unreadable messages, samples without a stamp; a frame that nothing helps."""
    nodes = [spawn(name) for name in ("ekf_node", "gimbal_node", "overlay_node")]
    for node in nodes:
        await_words(node, "ready")
    observer = meet(**{"/diagnostics": DiagnosticArray, "tirgeo/overlay/image": Image})
    begin_s = time.monotonic()

    def until(topic: str, sent: list, item: str, key: str, most: int = 4) -> None:
        observer.send({topic: sent}, lambda: int(observer.diagnostic(item).get(key, 0)) > most)

    navigation, camera = "/ekf_node: navigation", "/gimbal_node: camera pose"
    bad = [imu(10, z=math.nan), imu(11, z=math.inf)]
    until("imu/data", bad, navigation, "count.imu.invalid", 2)
    until("imu/data", [imu(0)], navigation, "stamped_at_arrival.imu/data")
    # In the order of their arrival, each later than the one before.
    assert int(observer.diagnostic(navigation)["count.imu.waiting"]) > 3
    joints = "gimbal/joint_states"
    wrong = [JointState(name=["arm"], position=[0.0]), JointState(name=["gimbal_yaw_joint"])]
    until(joints, wrong, "/gimbal_node: topics", f"{joints} unreadable")
    names = ["gimbal_yaw_joint", "gimbal_roll_joint", "gimbal_pitch_joint"]
    right = JointState(name=names, position=[0.0, 0.0, -0.5])
    until(joints, [right], camera, f"stamped_at_arrival.{joints}")
    # Again after 10 s, if this machine takes that long.
    most = 1 + (time.monotonic() - begin_s) // 10.0
    assert 1 <= nodes[1].log.read_text().count("no position of") <= most
    raw = Image(height=2, width=2, step=2, encoding="bayer_rggb8", data=bytes(4))
    jpeg = CompressedImage(data=b"no jpeg")
    for topic, message in (("thermal/image_raw", raw), ("thermal/image_raw/compressed", jpeg)):
        until(topic, [message], "/overlay_node: topics", f"{topic} unreadable", 0)
    # A frame without a pose comes back with a notice, across the upper part of the grey picture.
    frame = Messages(message_class).image(5_000_000_000, np.full((512, 640), 90, np.uint8))
    got = observer.received["tirgeo/overlay/image"]
    observer.send({"thermal/image_raw": [frame]}, lambda: bool(got))
    assert got[0].encoding == "bgr8"
    assert (got[0].header.stamp.sec, got[0].height, got[0].width) == (5, 512, 640)
    assert np.any(np.frombuffer(got[0].data, np.uint8).reshape(512, 640, 3)[:200] != 90)
    for node in nodes:
        node.check_running()
        assert "Traceback" not in node.log.read_text()


#: What the filter needs to start: it may be found one after the other.
AWAITED = "imu/data,rtk/fix,rtk/vel,rtk/heading"


def player_of(bag) -> list[str]:
    """Half as fast as it was flown: a busy machine must not lag behind."""
    parameters = (f"bag:={bag}", f"wait_for:={AWAITED}", "rate:=0.5")
    return ["bag_player", *(word for each in parameters for word in ("-p", each))]


def test_the_origin_reaches_who_comes_late_and_reset_starts_again(spawn, meet, flight_bag):
    ekf = spawn("ekf_node", "-p", "use_sim_time:=true")
    await_words(ekf, "ready")
    player = spawn(*player_of(flight_bag))
    assert player.wait(60.0).exit_code == 0
    late = meet(**{"/diagnostics": DiagnosticArray})
    origins: list[NavSatFix] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    late.node.create_subscription(NavSatFix, "tirgeo/origin", origins.append, latched)
    late.spin_until(lambda: len(origins) == 1 and bool(state_of(late)))
    assert state_of(late) in {"running", "degraded"}  # the flight is over
    cdr = Cdr()
    fixes = [
        cdr.deserialize(item.data, item.typename)
        for item in BagReader(flight_bag).messages(["/rtk/fix"])
    ]
    assert origins[0].header.frame_id == "map"
    # A position of the receiver, to what radians and back cost in a double.
    assert min(abs(fix.latitude - origins[0].latitude) for fix in fixes) < 1e-12
    assert late.ask("ekf_node/reset", Trigger).success
    late.spin_until(lambda: state_of(late) in {"waiting", "aligning"})


@pytest.mark.slow
def test_each_state_is_told_once_in_the_log_and_at_once_in_diagnostics(spawn, meet, flight_bag):
    stranger = meet(**{"/diagnostics": DiagnosticArray})
    ekf = spawn("ekf_node", "-p", "use_sim_time:=true")
    await_words(ekf, "ready")
    stranger.spin_until(lambda: stranger.received["/diagnostics"])  # they have met
    player = spawn(*player_of(flight_bag))
    stranger.spin_until(lambda: player.poll() is not None)
    stranger.spin_until(lambda: "running" in states_of(stranger))  # late RTK may end it again
    # Beside those of every second, which have the topics too: one for each change of state.
    alone = [array for array in stranger.received["/diagnostics"] if is_state_alone(array)]
    states = [navigation_status(array.status[0]).state.value for array in alone]
    assert states[0] == "aligning"
    assert all(a != b for a, b in pairwise(states))
    said = [line.partition("ekf_heading: ")[2] for line in ekf.log.read_text().splitlines()]
    assert all(a != b for a, b in pairwise(filter(None, said)))
    # Of one state there may be several lines, for its reason may change.
    told = [state for state, _ in groupby(line.partition(":")[0] for line in said if line)]
    assert told == ["waiting", *states]


def is_state_alone(array: DiagnosticArray) -> bool:
    return [status.name for status in array.status] == ["/ekf_node: navigation"]


def states_of(stranger) -> list[str]:
    told = [status for array in stranger.received["/diagnostics"] for status in array.status]
    filters = [status for status in told if status.name.endswith("ekf_node: navigation")]
    return [navigation_status(status).state.value for status in filters]


def state_of(stranger) -> str:
    return (states_of(stranger) or [""])[-1]
