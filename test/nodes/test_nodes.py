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
"""Single nodes over DDS: bad messages, reset, latched origin, notices, other names."""

from __future__ import annotations

import math
import time

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import QuaternionStamped
from graph_helpers import await_words
from nav_msgs.msg import Odometry
from overlay_flight import Flight, write_map
from overlays import SQUARE_N
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu, JointState, NavSatFix
from std_srvs.srv import Trigger

from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.nodes.graph_node import Output

pytestmark = pytest.mark.graph


def imu(stamp_s: int, **fields) -> Imu:
    message = Imu()
    message.header.stamp.sec = stamp_s
    message.linear_acceleration.z = fields.get("z", 9.8)
    message.orientation.w = fields.get("w", 1.0)
    return message


@pytest.mark.slow
def test_useless_messages_and_missing_stamps_are_counted_and_reported(spawn, meet):
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
    grey = np.full((512, 640), 90, np.uint8).tobytes()
    frame = Image(height=512, width=640, step=640, encoding="mono8", data=grey)
    frame.header.stamp.sec = 5
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


def state_of(stranger) -> str:
    return stranger.diagnostic("/ekf_node: navigation").get("state", "")


STEP_NS = 100_000_000
ITEM = "/gimbal_node: camera pose"


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

    def says(composition: str, joints: bool) -> bool:
        aircraft.step(joints=joints)
        return observer.diagnostic(ITEM).get("") == f"composition: {composition}"

    observer.spin_until(lambda: says("encoders", joints=True))
    observer.spin_until(lambda: says("paper", joints=False))
    values = observer.diagnostic(ITEM)
    assert (values["joints_steady"], values["joints_silent"]) == ("1", "1")
    assert float(values["north_sigma_deg"]) > 0
    assert math.isfinite(float(values["north_bias_deg"]))
    gimbal.check_running()


CLOCK = ["-r", "__ns:=/uav1", "-r", "/clock:=clock"]
CAMERA = {
    "thermal/image_raw": "/flir/image_raw",
    "thermal/image_raw/compressed": "/flir/image_raw/compressed",
    "thermal/camera_info": "/flir/camera_info",
}


@pytest.mark.slow
def test_a_bags_clock_stays_in_its_namespace(spawn, meet, flight_bag):
    """Two launches with bags in one domain: each graph has the time of its own flight."""
    heard = {"/uav1/clock": Clock, "/clock": Clock, "/diagnostics": DiagnosticArray}
    stranger = meet(**heard)
    await_words(spawn("gimbal_node", "-p", "use_sim_time:=true", *CLOCK), "ready")
    spawn("bag_player", "-p", f"bag:={flight_bag}", "-p", "loop:=true", *CLOCK)

    def in_time() -> bool:
        clock = stranger.received["/uav1/clock"]
        return clock and any(
            clock[0].clock.sec <= array.header.stamp.sec <= clock[-1].clock.sec
            for array in stranger.received["/diagnostics"]
            if array.status[0].name.startswith("/uav1/gimbal_node")
        )

    stranger.spin_until(in_time)
    assert not stranger.received["/clock"]


def test_a_camera_of_another_name_and_a_map_that_is_not_there_yet(spawn, meet, tmp_path):
    """The video goes on and says which file is missing, from the first frame on."""
    path = tmp_path / "park.geojson"
    remaps = [word for pair in CAMERA.items() for word in ("-r", ":=".join(pair))]
    levels = ["--log-level", "overlay_node:=warn"]
    node = spawn(
        *("overlay_node", "-p", f"map:={path}", "-p", "reload_s:=0.2"),
        *("-p", "ground_height_m:=20.0", *remaps, *levels),
    )
    stranger = meet(**{"tirgeo/overlay/image": Image, "/diagnostics": DiagnosticArray})
    flown = Flight(stranger)
    flown.image = Output(stranger.node.create_publisher(Image, "/flir/image_raw", 1))
    flown.info = Output(stranger.node.create_publisher(CameraInfo, "/flir/camera_info", 1))
    flown.until(lambda: stranger.received["tirgeo/overlay/image"])
    flown.until(lambda: "there is no such map" in flown.diagnostics().get("", ""))
    flown.until(lambda: "map_unreadable" in flown.diagnostics("/overlay_node: set-up"))
    set_up = flown.diagnostics("/overlay_node: set-up")
    assert not any("topic" in check or "camera" in check for check in set_up)
    write_map(path, SQUARE_N)
    flown.shown()
    assert node.said(f"there is no map: {path}")
    assert not node.said("ready")  # it is said at the level info
