# ruff: noqa: E402 what follows imports ROS, which may be absent
"""The player over DDS, against a plain subscriber."""

from __future__ import annotations

import signal

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, NavSatFix

from tirgeo_ros.core.errors import BagError
from tirgeo_ros.io.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.nodes.playlist import names, publishers_for

pytestmark = pytest.mark.graph


def seconds(stamp) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


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


def test_a_namespace_moves_the_topics(spawn, meet, flight_bag):
    stranger = meet(uav1__rtk__fix=NavSatFix)
    arguments = ("-r", "__ns:=/uav1", "-p", f"bag:={flight_bag}", "-p", "start_offset_s:=3.0")
    player = spawn("bag_player", *arguments, "-p", "topics:=/rtk/fix", "-p", "rate:=10.0")
    stranger.spin_until(lambda: player.poll() is not None)
    stranger.spin_until(lambda: bool(stranger.received["uav1/rtk/fix"]))
    first_ns = BagReader(flight_bag).span_ns[0]
    stamps = [seconds(message.header.stamp) for message in stranger.received["uav1/rtk/fix"]]
    assert min(stamps) > first_ns * 1e-9 + 2.5


def test_a_loop_goes_on_until_it_is_stopped(spawn, meet, flight_bag):
    stranger = meet(rtk__fix=NavSatFix)
    player = spawn(
        "bag_player", "-p", f"bag:={flight_bag}", "-p", "rate:=20.0", "-p", "loop:=true"
    )
    once = sum(1 for _ in BagReader(flight_bag).messages(["/rtk/fix"]))
    stranger.spin_until(lambda: len(stranger.received["rtk/fix"]) > 2 * once)
    player.signal(signal.SIGINT)
    assert player.wait(60.0).exit_code == 0


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


def test_nobody_listens_and_it_says_so(spawn, flight_bag):
    player = spawn(
        "bag_player",
        "-p",
        f"bag:={flight_bag}",
        "-p",
        "rate:=50.0",
        "-p",
        "wait_timeout_s:=0.5",
        "-p",
        "wait_for:=imu/data",
    )
    assert player.wait(60.0).exit_code == 0
    assert player.said("playing without a subscriber of /imu/data")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-p", "topics:=rtk/fix,radar"], "the bag has no radar"),
        (["-p", "wait_for:=radar"], "wait_for: /radar is not played"),
        (["-p", "start_offset_s:=60.0", "-p", "wait_timeout_s:=0.0"], "is beyond the bag's 4.1 s"),
    ],
)
def test_what_the_bag_lacks_is_named(spawn, flight_bag, arguments, message):
    player = spawn("bag_player", "-p", f"bag:={flight_bag}", *arguments)
    assert player.wait(60.0).exit_code == 1
    assert message in player.last_line()


def test_an_unknown_type_is_passed_over(spawn, meet, tmp_path, flight_bag):
    """A bag may hold topics of packages that are not installed here."""
    path = tmp_path / "more.mcap"
    with BagWriter(path) as writer:
        for item in BagReader(flight_bag).messages(["/rtk/fix"]):
            writer.write(item.topic, item.typename, item.data, item.log_time_ns)
        nothing = Cdr().types("std_msgs/msg/Empty")()
        writer.write("/radar", "shape_msgs/msg/Plane", b"\0\1\0\0" + bytes(32), item.log_time_ns)
        writer.write("/nothing", "std_msgs/msg/Empty", nothing, item.log_time_ns)
    stranger = meet(rtk__fix=NavSatFix)
    player = spawn("bag_player", "-p", f"bag:={path}", "-p", "rate:=10.0")
    stranger.spin_until(lambda: player.poll() is not None)
    assert player.ended.exit_code == 0


def test_names():
    assert names(" /imu/data, rtk/fix ,") == ["imu/data", "rtk/fix"]
    assert names("") == []


class _Publishing:
    """Stands for a node: which publishers would it make."""

    def create_publisher(self, kind, topic, qos):
        return (kind.__name__, topic, qos.durability.name)


def test_outputs_of_the_graph_are_not_played_unless_asked():
    topics = {
        "/uav1/imu/data": "sensor_msgs/msg/Imu",
        "/uav1/tirgeo/odometry": "nav_msgs/msg/Odometry",
        "/uav1/tirgeo/origin": "sensor_msgs/msg/NavSatFix",
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
        "/clock": "rosgraph_msgs/msg/Clock",
    }
    assert publishers_for(_Publishing(), topics, "") == {
        "/uav1/imu/data": ("Imu", "uav1/imu/data", "VOLATILE")
    }
    asked = publishers_for(_Publishing(), topics, "uav1/tirgeo/origin")
    assert asked == {"/uav1/tirgeo/origin": ("NavSatFix", "uav1/tirgeo/origin", "TRANSIENT_LOCAL")}


def test_a_bag_of_outputs_alone_has_nothing_to_play():
    topics = {"/tirgeo/odometry": "nav_msgs/msg/Odometry"}
    with pytest.raises(BagError, match=r"no topic to play \(it has: /tirgeo/odometry\)"):
        publishers_for(_Publishing(), topics, "")
