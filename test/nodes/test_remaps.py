"""What the launch file gives its nodes: a clock of the namespace, a camera's own names."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import await_words
from nav_msgs.msg import Odometry
from overlay_flight import Flight, write_map
from overlays import SQUARE_N
from project import PROJECT
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, Imu, NavSatFix

from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.graph.whole_graph import read_remaps

pytestmark = pytest.mark.graph
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
    second = spawn("bag_player", "-p", f"bag:={flight_bag}", *CLOCK)
    await_words(second, "/uav1/clock has another publisher too: give each bag its own namespace")


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
    flown.image = stranger.node.create_publisher(Image, "/flir/image_raw", 1)
    flown.info = stranger.node.create_publisher(CameraInfo, "/flir/camera_info", 1)
    flown.until(lambda: stranger.received["tirgeo/overlay/image"])
    flown.until(lambda: "there is no such map" in flown.diagnostics().get("", ""))
    flown.until(lambda: "map_unreadable" in flown.diagnostics("/overlay_node: set-up"))
    set_up = flown.diagnostics("/overlay_node: set-up")
    assert not any("topic" in check or "camera" in check for check in set_up)
    write_map(path, SQUARE_N)
    flown.shown()
    assert node.said(f"there is no map: {path}")
    assert not node.said("ready")  # it is said at the level info


@pytest.mark.slow
def test_mavros_topics_reach_the_filter_by_the_file(spawn, meet, flight_bag):
    """As the launch file and tirgeo run give it, in a namespace, with MAVROS's quality of service.

    MAVROS publishes its sensors best effort.
    """
    pairs = read_remaps(PROJECT / "config" / "mavros.yaml")
    words = [word for pair in pairs for word in ("-r", ":=".join(pair))]
    node = spawn("ekf_node", "-r", "__ns:=/uav1", *words, "-p", "method:=raw")
    await_words(node, "ready")
    stranger = meet(**{"/uav1/tirgeo/odometry": Odometry})
    kinds = {"/imu/data": Imu, "/gps/fix": NavSatFix}
    sent = {
        name: stranger.node.create_publisher(
            kinds[f"/{own}"], f"/uav1/{name}", qos_profile_sensor_data
        )
        for own, name in pairs
        if f"/{own}" in kinds
    }
    topics = {f"/{own}": name for own, name in pairs}
    read = [
        (topics[one.topic], deserialize_message(one.data, kinds[one.topic]))
        for one in BagReader(flight_bag).messages(kinds)
    ]
    stranger.spin_until(lambda: all(one.get_subscription_count() for one in sent.values()))

    def heard() -> bool:
        for topic, message in read:
            sent[topic].publish(message)
        return bool(stranger.received["/uav1/tirgeo/odometry"])

    stranger.spin_until(heard)
