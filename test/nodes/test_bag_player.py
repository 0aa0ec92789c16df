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
"""The player over DDS, against a plain subscriber; bag time against real time."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import threading

import pytest
from project import wait_until

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from geometry_msgs.msg import PoseStamped
from graph_helpers import await_words
from nav_msgs.msg import Path as PathMessage
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, NavSatFix

from tirgeo_ros.core.types.errors import BagError, TirgeoError
from tirgeo_ros.dji.link.framing import FrameReader
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.messages import stamp_ns
from tirgeo_ros.nodes import bag_player as module
from tirgeo_ros.nodes.bag_player import (
    BagPlayer,
    PlayClock,
    aircraft_topics,
    move_stamps,
    publishers_for,
)


def seconds(stamp) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


@pytest.mark.graph
def test_every_message_arrives_with_the_clock(spawn, meet, flight_bag):
    stranger = meet(imu__data=Imu, rtk__fix=NavSatFix, clock=Clock)
    player = spawn("bag_player", "-p", f"bag:={flight_bag}", "-p", "rate:=2.0")
    stranger.spin_until(lambda: player.poll() is not None)
    assert player.ended.exit_code == 0, player.log.read_text()
    reader = BagReader(flight_bag)
    for topic in ("imu/data", "rtk/fix"):
        played = sum(1 for _ in reader.messages([f"/{topic}"]))
        stranger.spin_until(lambda t=topic, n=played: len(stranger.received[t]) >= n)
        assert len(stranger.received[topic]) == played
    ticks = [seconds(message.clock) for message in stranger.received["clock"]]
    assert ticks == sorted(ticks)
    first_ns, last_ns = reader.span_ns
    # At twice the speed a period of 10 ms of real time is 20 ms of the bag's, and a halt of the
    # machine may leave ticks out; the bag is 4 s long.
    assert first_ns * 1e-9 - 1e-6 <= ticks[0] < first_ns * 1e-9 + 1.0
    assert last_ns * 1e-9 - 1.0 < ticks[-1] <= last_ns * 1e-9 + 1e-6


@pytest.mark.slow
@pytest.mark.graph
def test_a_loop_goes_on_until_it_is_stopped(spawn, meet, flight_bag):
    stranger = meet(rtk__fix=NavSatFix)
    player = spawn(
        "bag_player", "-p", f"bag:={flight_bag}", "-p", "rate:=20.0", "-p", "loop:=true"
    )
    once = sum(1 for _ in BagReader(flight_bag).messages(["/rtk/fix"]))
    stranger.spin_until(lambda: len(stranger.received["rtk/fix"]) > 2 * once)
    player.signal(signal.SIGINT)
    assert player.wait(60.0).exit_code == 0


@pytest.mark.slow
@pytest.mark.graph
def test_a_truncated_bag_plays_what_is_left_and_fails(spawn, meet, flight_bag, tmp_path):
    cut = tmp_path / "cut.mcap"
    whole = flight_bag.read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    left = sum(1 for _ in BagReader(cut).messages(["/imu/data"]))
    assert left
    stranger = meet(imu__data=Imu)
    player = spawn("bag_player", "-p", f"bag:={cut}", "-p", "rate:=2.0")
    stranger.spin_until(lambda: player.poll() is not None)
    assert player.ended.exit_code == 1
    assert "messages were read" in player.last_line()
    assert "Traceback" not in player.log.read_text()
    stranger.spin_until(lambda: len(stranger.received["imu/data"]) == left)


@pytest.mark.graph
def test_nobody_listens_and_it_says_so(spawn, flight_bag):
    given = (f"bag:={flight_bag}", "rate:=50.0", "wait_timeout_s:=0.5", "wait_for:=imu/data")
    player = spawn("bag_player", *(word for entry in given for word in ("-p", entry)))
    assert player.wait(60.0).exit_code == 0
    assert player.said("playing without a subscriber of /imu/data")


@pytest.mark.slow
@pytest.mark.graph
def test_the_aircraft_speaks_on_a_port_and_not_on_topics(spawn, meet, flight_bag, tmp_path):
    port = tmp_path / "aircraft"
    stranger = meet(imu__data=Imu)
    arguments = ("-p", "live:=true", "-p", f"serial_port:={port}")
    player = spawn("bag_player", "-p", f"bag:={flight_bag}", *arguments)
    await_words(player, "ready")
    host = os.open(port, os.O_RDWR | os.O_NOCTTY)
    os.set_blocking(host, False)
    reader, frames = FrameReader(), []

    def listen() -> bool:
        with contextlib.suppress(OSError):
            frames.extend(reader.feed(os.read(host, 65536)))
        return player.poll() is not None

    wait_until(listen)
    listen()
    os.close(host)
    assert player.ended.exit_code == 0, player.text()
    message_text = sum(1 for _ in BagReader(flight_bag).messages(["/imu/data"]))
    broadcasts = [frame for frame in frames if (frame.cmd_set, frame.cmd_id) == (2, 0)]
    assert len(broadcasts) == message_text
    assert not stranger.received["imu/data"]
    assert not port.is_symlink()


WRONG = [
    ("topics:=rtk/fix,radar", "the bag has no radar"),
    ("wait_for:=radar", "wait_for: /radar is not played"),
    ("live:=true rate:=2.0", "rate: a live bag plays at rate 1, not 2"),
    ("serial_port:=/tmp/x", "serial_port: needs live: true"),
    ("live:=true serial_port:=/no/where", "/no/where: no pseudo-terminal"),
]


@pytest.mark.parametrize(("given", "message"), WRONG)
@pytest.mark.graph
def test_what_the_bag_lacks_is_named(environment, flight_bag, given, message):
    words = [w for entry in (f"bag:={flight_bag}", *given.split()) for w in ("-p", entry)]
    rclpy.init(args=["--ros-args", *words], domain_id=int(environment["ROS_DOMAIN_ID"]))
    try:
        with pytest.raises(TirgeoError, match=re.escape(message)):
            BagPlayer().play(threading.Event())
    finally:
        rclpy.try_shutdown()


@pytest.mark.slow
@pytest.mark.graph
def test_an_unknown_type_is_passed_over(spawn, meet, tmp_path, flight_bag):
    """A bag may hold topics of packages that are not installed here."""
    path = tmp_path / "more.mcap"
    with BagWriter(path) as writer:
        for item in BagReader(flight_bag).messages(["/rtk/fix"]):
            writer.write(item.topic, item.typename, item.data, item.log_time_ns)
        writer.write("/radar", "shape_msgs/msg/Plane", b"\0\1\0\0" + bytes(32), item.log_time_ns)
        writer.write("/nothing", "std_msgs/msg/Empty", b"\0\1\0\0\0", item.log_time_ns)
    stranger = meet(rtk__fix=NavSatFix)
    player = spawn("bag_player", "-p", f"bag:={path}", "-p", "rate:=10.0")
    stranger.spin_until(lambda: player.poll() is not None)
    assert player.ended.exit_code == 0


class _Publishing:
    """Stands for a node: which publishers would it make."""

    def create_publisher(self, kind, topic, qos):
        return (kind.__name__, topic, qos.durability.name)


@pytest.mark.graph
def test_outputs_of_the_graph_are_not_played_unless_asked():
    topics = {
        "/uav1/imu/data": "sensor_msgs/msg/Imu",
        "/uav1/tirgeo/odometry": "nav_msgs/msg/Odometry",
        "/uav1/tirgeo/origin": "sensor_msgs/msg/NavSatFix",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/tf_static": "tf2_msgs/msg/TFMessage",
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
        "/clock": "rosgraph_msgs/msg/Clock",
    }
    assert publishers_for(_Publishing(), topics, "") == {
        "/uav1/imu/data": ("Imu", "uav1/imu/data", "VOLATILE")
    }
    asked = publishers_for(_Publishing(), topics, "uav1/tirgeo/origin")
    assert asked == {"/uav1/tirgeo/origin": ("NavSatFix", "uav1/tirgeo/origin", "TRANSIENT_LOCAL")}


@pytest.mark.graph
def test_the_aircrafts_topics_are_told_apart():
    topics = {"/imu/data": "sensor_msgs/msg/Imu", "/thermal/image_raw": "sensor_msgs/msg/Image"}
    pressure = {"/baro/pressure": "sensor_msgs/msg/FluidPressure"}  # DJI sends none
    assert aircraft_topics(topics | pressure, "") == {"/imu/data": "sensor_msgs/msg/Imu"}
    made = publishers_for(_Publishing(), topics, "", ["/imu/data"])
    assert list(made) == ["/thermal/image_raw"]
    assert publishers_for(_Publishing(), {"/imu/data": "x"}, "", ["/imu/data"]) == {}
    with pytest.raises(BagError, match=r"none of the aircraft's topics: imu/data, "):
        aircraft_topics(topics, "thermal/image_raw")


@pytest.mark.graph
def test_stamps_are_moved_wherever_they_stand():
    path = PathMessage(poses=[PoseStamped(), PoseStamped()])
    path.header.stamp.sec = 1
    path.poses[0].header.stamp.sec = 5
    path.poses[0].header.stamp.nanosec = 900_000_000
    move_stamps(path, 200_000_000)
    assert [stamp_ns(part) for part in (path, *path.poses)] == [
        1_200_000_000,
        6_100_000_000,
        0,  # no stamp stays none
    ]
    imu = Imu()
    imu.header.stamp.sec = 7
    move_stamps(imu, -1)
    assert stamp_ns(imu) == 6_999_999_999


MS = 1_000_000
START = 1_700_000_000_000_000_000


class TurnedTime(threading.Event):
    """Real time that passes in waits alone: a busy machine has no part in it."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 1000.0

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.now_s += max(timeout, 0.0)
        return self.is_set()


@pytest.fixture
def turned(monkeypatch):
    turned = TurnedTime()
    monkeypatch.setattr(module.time, "monotonic", lambda: turned.now_s)
    return turned


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_messages_are_due_at_the_rate(turned, rate):
    clock = PlayClock(rate, lambda _: None)
    for k in range(5):
        assert clock.wait_until(START + k * 50 * MS, turned)
        assert turned.now_s - 1000.0 == pytest.approx(k * 0.05 / rate, abs=1e-9)


def test_ticks_go_on_between_messages_and_never_back(turned):
    ticks: list[int] = []
    clock = PlayClock(1.0, ticks.append)
    assert clock.wait_until(START, turned)
    assert clock.wait_until(START + 300 * MS, turned)
    assert ticks == sorted(ticks)
    assert ticks[0] == START
    # A tick every 25 ms; the sums of floating numbers may leave the last one to the next message.
    assert len(ticks) in {12, 13}
    assert START + 274 * MS <= ticks[-1] <= START + 300 * MS


def test_a_stall_leaves_ticks_out_and_none_passes_the_message_that_is_due(turned):
    ticks: list[int] = []
    clock = PlayClock(1.0, ticks.append)
    clock.wait_until(START, turned)
    turned.now_s += 0.05  # the publisher stalls
    clock.wait_until(START + 10 * MS, turned)
    assert ticks == [START, START + 10 * MS]
