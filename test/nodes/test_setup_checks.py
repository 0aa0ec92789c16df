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
"""A node's checks of its set-up and graph: their findings in reports, log and picture."""

from __future__ import annotations

import signal
import time
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import KeptLog, await_words
from nav_msgs.msg import Odometry
from overlay_flight import MESSAGES, Flight, has_lines, write_map
from overlays import PLANE, SQUARE_N
from sensor_msgs.msg import Image, Imu
from std_msgs.msg import String

from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.io.messages import STATE_TOPIC, NodeState
from tirgeo_ros.io.messages.json_codec import findings_text
from tirgeo_ros.io.messages.pictures import image_pixels
from tirgeo_ros.nodes import setup_checks
from tirgeo_ros.nodes.graph_node import Output
from tirgeo_ros.nodes.monitor import ERROR, OK, WARN, Monitor
from tirgeo_ros.nodes.setup_checks import InputChecks, OtherPublishers, Restarts, SetupChecks

WITHIN_S = 10.0  # of stamps, from the first message to the item and the notice
AMBER_BGR, ORANGE_BGR = (80, 200, 255), (60, 140, 255)
NOTE = Finding("levers", Severity.NOTE, "all lever arms are zero", "ekf_node aircraft", "measure")
CAUTION = Finding("late", Severity.CAUTION, "rtk/fix is 0.4 s late", "ekf_node rtk.delay_s", "set")
STOP = Finding("g", Severity.STOP, "1.00 m/s2 at rest", "imu/data", "give m/s2")


def setup_of(*result: list[Finding]) -> tuple[SetupChecks, KeptLog]:
    """A node's checks; the findings of each are those in its list."""
    node = KeptLog()
    return SetupChecks(node, *(SimpleNamespace(findings=entry.copy) for entry in result)), node


def test_the_item_has_the_worst_level_and_every_finding():
    setup, _ = setup_of([CAUTION, NOTE], [STOP])
    item = setup.report()
    assert setup.findings() == [STOP, CAUTION, NOTE]
    assert item.name == "/uav1/ekf_node: set-up"
    assert item.level == ERROR
    assert item.message == "NO GO: 1.00 m/s2 at rest: imu/data (and 1 more)"
    assert item.values == {
        "g": f"STOP: {STOP.line}",
        "late": f"CAUTION: {CAUTION.line}",
        "levers": f"NOTE: {NOTE.line}",
    }
    for result, level in ((NOTE, OK), (CAUTION, WARN)):
        assert setup_of([result])[0].report().level == level


def test_a_finding_stays_until_it_has_been_read_and_its_numbers_are_the_newest():
    result = [STOP]
    setup, _ = setup_of(result)
    setup.report()
    newer = Finding("g", Severity.STOP, "1.01 m/s2 at rest", "imu/data", "give m/s2")
    result[:] = [newer]
    assert setup.report().values == {"g": f"STOP: {newer.line}"}
    result.clear()
    levels = [setup.report().level for _ in range(12)]
    assert levels[:10] == [ERROR] * 10
    assert levels[-1] == OK


def test_go_and_no_go_are_logged_once_each():
    result = []
    setup, logger = setup_of(result)
    for _ in range(20):
        setup.report()
    assert logger.lines == []  # nothing has come yet: nobody knows
    logger.monitor.received("imu/data")
    for _ in range(20):
        setup.report()
    assert logger.lines == [("info", "set-up: GO")]
    for result[:] in ([CAUTION], [CAUTION, NOTE], [CAUTION, STOP], []):
        for _ in range(20):
            setup.report()
    assert [level for level, _ in logger.lines[1:]] == ["warning", "error", "info"]
    assert logger.lines[2][1].startswith("set-up: NO GO: 1.00 m/s2 at rest: imu/data")


def test_a_fault_in_a_check_stops_neither_the_node_nor_its_findings():
    check = SimpleNamespace(findings=lambda: [STOP])
    node = KeptLog()
    setup = SetupChecks(node, check)
    setup.report()
    check.findings = lambda: 1 / 0
    assert setup.report().level == ERROR
    setup.take(lambda _: 1 / 0, "a sample")
    setup.report()  # takes the sample and asks again
    assert node.monitor.report("topics").values["set-up failed"] == "3"


def test_checks_take_what_came_in_its_order_some_at_a_time_or_before_they_are_asked():
    taken = []
    check = SimpleNamespace(findings=list, take=lambda *data: taken.append(data))
    setup = SetupChecks(KeptLog(), check)
    for number in range(25):
        setup.take(check.take, "imu/data", number)
    assert 0 < len(taken) < 25
    setup.report()
    assert taken == [("imu/data", number) for number in range(25)]


def written(image: Image, bgr) -> int:
    """Pixels of a colour in the first lines of the picture."""
    off = np.abs(image_pixels(image)[:60].astype(int) - bgr)
    return int((off.max(axis=2) < 20).sum())


@pytest.fixture
def flight(spawn, tmp_path, meet):
    """The overlay with the ground of a parameter, and a camera 20 m above 25 m."""

    def start(ground_height_m: float) -> tuple[Flight, object]:
        write_map(tmp_path / "map.geojson", SQUARE_N)
        map_file = f"map:={tmp_path / 'map.geojson'}"
        node = spawn("overlay_node", "-p", map_file, "-p", f"ground_height_m:={ground_height_m}")
        await_words(node, "ready")
        topics = {"/diagnostics": DiagnosticArray, "tirgeo/overlay/image": Image}
        return Flight(meet(**topics)), node

    return start


@pytest.mark.graph
@pytest.mark.slow
def test_a_ground_47_m_too_high_is_in_diagnostics_log_and_picture(flight):
    aircraft, node = flight(PLANE.height_m + 47.0)
    pictures = aircraft.stranger.received["tirgeo/overlay/image"]
    aircraft.until(lambda: pictures and written(pictures[-1], ORANGE_BGR) > 100)
    stamps = [
        p.header.stamp.sec + p.header.stamp.nanosec * 1e-9 for p in (pictures[0], pictures[-1])
    ]
    assert stamps[1] - stamps[0] < WITHIN_S
    reports = aircraft.diagnostics("/overlay_node: set-up")
    assert reports["level"] == str(ERROR)
    assert reports[""].startswith("NO GO: 27.0 m below the ground")
    assert "ground_height_m" in reports[""]
    await_words(node, "set-up: NO GO: 27.0 m below the ground")
    strip = image_pixels(pictures[-1])[-22:].astype(int)
    assert (np.abs(strip - ORANGE_BGR).max(axis=2) < 20).sum() > 20  # never all green


@pytest.mark.graph
def test_the_picture_shows_a_finding_of_another_node_in_its_namespace(flight):
    aircraft, _ = flight(PLANE.height_m)
    create = aircraft.stranger.node.create_publisher
    others = {
        name: Output(create(String, f"{name}/tirgeo/findings", 10)) for name in ("", "/uav2")
    }
    pictures = aircraft.stranger.received["tirgeo/overlay/image"]

    def tells(aircraft: str, *result: Finding) -> bool:
        message = MESSAGES.text(findings_text(f"{aircraft}/ekf_node", time.time_ns(), result))
        others[aircraft].publish(message)
        return bool(pictures) and written(pictures[-1], AMBER_BGR) > 100

    aircraft.shown()  # before there was NO MAP YET, in amber too
    enough = len(pictures) + 30

    def passed() -> bool:
        return len(pictures) > enough

    aircraft.until(lambda: tells("/uav2", CAUTION) or passed())
    assert passed()  # of another aircraft
    aircraft.until(lambda: tells("", CAUTION))
    assert has_lines(pictures[-1])  # the map stays
    pictures.clear()
    aircraft.until(lambda: not tells("") and pictures)


JOINTS, ATTITUDE = "gimbal/joint_states", "gimbal/attitude"


class FakeNode:
    """A node of a namespace in a graph whose publishers are given: names with types."""

    def __init__(self, **published: str) -> None:
        self.monitor = Monitor()
        self.published = {f"/{name.replace('__', '/')}": kind for name, kind in published.items()}

    def get_namespace(self) -> str:
        return "/uav1"

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        own = {f"/uav1/{name}": "of the node itself" for name in (JOINTS, ATTITUDE)}
        return [(name, [kind]) for name, kind in (own | self.published).items()]

    def count_publishers(self, name: str) -> int:
        return name in self.published

    def get_publishers_info_by_topic(self, topic: str) -> list[SimpleNamespace]:
        kind = self.published.get(f"/uav1/{topic}")
        return [SimpleNamespace(topic_type=kind)] if kind else []


def checks_of(node: FakeNode, heard: str = "") -> InputChecks:
    if heard:
        node.monitor.received(heard)
    return InputChecks(node, (JOINTS, ATTITUDE))


def test_a_wrong_type_is_a_finding_at_once():
    node = FakeNode(uav1__gimbal__joint_states="geometry_msgs/msg/Vector3Stamped")
    (result,) = checks_of(node).findings()
    assert result.severity is Severity.STOP
    assert result.parameter == JOINTS
    assert "/uav1/gimbal/joint_states is a geometry_msgs/msg/Vector3Stamped" in result.evidence


def test_a_wait_for_unpublished_topics_begins_with_the_first_message():
    quiet, heard = checks_of(FakeNode()), checks_of(FakeNode(), "tirgeo/odometry")
    assert not any(quiet.findings() for _ in range(20))
    counts = [len(heard.findings()) for _ in range(20)]
    assert counts == [0] * 5 + [1] * 15
    (result,) = heard.findings()
    assert result.severity is Severity.STOP
    assert result.evidence.startswith("the graph has neither /uav1/gimbal/joint_states nor ")


def test_reports_of_other_nodes_are_no_messages_of_a_flight():
    checks = checks_of(FakeNode(), STATE_TOPIC)
    assert not any(checks.findings() for _ in range(20))


ODOMETRY, POSE = "/tirgeo/odometry", "/tirgeo/camera_pose"


@pytest.mark.graph
def test_a_second_publisher_is_a_finding_that_names_it_once_it_lasts(meet):
    stranger, other = meet(), meet().node
    own = stranger.node
    own.create_publisher(Odometry, "tirgeo/odometry", 1)
    own.create_subscription(Imu, "imu/data", print, 1)
    watch = OtherPublishers(own)
    assert not any(watch.findings() for _ in range(100))
    for topic, kind in (("tirgeo/odometry", Odometry), ("imu/data", Imu), ("imu/data", Imu)):
        other.create_publisher(kind, topic, 1)

    def named(topic):  # DDS brings a node's name after its publishers
        return [entry.node_name for entry in own.get_publishers_info_by_topic(topic)]

    twice = (ODOMETRY, "/imu/data")
    stranger.spin_until(lambda: all(named(topic) == ["stranger"] * 2 for topic in twice))
    (twin,) = watch.findings()
    assert (twin.severity, twin.parameter) == (Severity.STOP, "tirgeo/odometry")
    assert twin.evidence == "/tirgeo/odometry has 2 publishers: /stranger, /stranger"
    counts = [len(watch.findings()) for _ in range(30)]
    assert counts == [1] * 24 + [2] * 6
    assert watch.findings()[1].severity is Severity.CAUTION
    # At a node's start the other may be what its killed predecessor left.
    fresh = OtherPublishers(own)
    assert [len(fresh.findings()) for _ in range(30)] == [0] * 25 + [2] * 5


@pytest.mark.slow
@pytest.mark.graph
def test_a_second_filter_is_found_and_a_killed_node_is_not(spawn, meet):
    stranger = meet(**{"/diagnostics": DiagnosticArray})
    ekf, gimbal = spawn("ekf_node"), spawn("gimbal_node")
    await_words(ekf, "ready")
    await_words(gimbal, "ready")
    stranger.spin_until(lambda: stranger.node.count_publishers(POSE) == 1)
    gimbal.signal(signal.SIGKILL)
    gimbal.wait(10.0)
    spawn("gimbal_node")
    stranger.spin_until(lambda: stranger.node.count_publishers(POSE) == 2)
    stranger.spin_until(lambda: stranger.node.count_publishers(POSE) == 1)  # the lease is over
    await_words(spawn("ekf_node"), "ready")

    check = "publishers_of_tirgeo_odometry"
    stranger.spin_until(lambda: check in stranger.diagnostic("/ekf_node: set-up"))
    line = stranger.diagnostic("/ekf_node: set-up")[check]
    assert line.startswith("STOP: /tirgeo/odometry has 2 publishers: /ekf_node, /ekf_node: ")
    heard = [entry for array in stranger.received["/diagnostics"] for entry in array.status]
    checks = {item.key for entry in heard for item in entry.values}
    assert "publishers_of_tirgeo_camera_pose" not in checks


@pytest.mark.graph
def test_each_new_start_of_a_node_counts_once(monkeypatch):
    clock, restarts = [100.0], Restarts()
    monkeypatch.setattr(setup_checks, "time", SimpleNamespace(monotonic=lambda: clock[0]))

    def text(node, started_ns):
        restarts.take(NodeState(f"/uav1/{node}", 0, started_ns))

    for started_ns in (1, 1, 2, 1, 3):
        text("ekf_node", started_ns)
    text("overlay_node", 4)
    text("video_writer", 5)
    text("video_writer", 6)  # each recording starts one
    (result,) = restarts.findings()
    assert result.evidence == "ekf_node ended and was started again; restarts so far: 2"
    assert result.severity is Severity.CAUTION
    clock[0] += 61.0
    assert [entry.severity for entry in restarts.findings()] == [Severity.NOTE]
