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
"""What a callback raises is counted, and the node goes on; rates, silence and QoS."""

from __future__ import annotations

import sys
import threading
import time
from itertools import count, takewhile

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import KeptLog
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy
from std_msgs.msg import String

from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.io.messages import TopicState
from tirgeo_ros.io.messages.topics import offered_qos
from tirgeo_ros.nodes import monitor as monitor_module
from tirgeo_ros.nodes.dji_node import DjiNode
from tirgeo_ros.nodes.ekf_node import EkfNode
from tirgeo_ros.nodes.gimbal_node import GimbalNode
from tirgeo_ros.nodes.graph_node import GraphNode, output
from tirgeo_ros.nodes.monitor import ERROR, OK, WARN, Monitor
from tirgeo_ros.nodes.overlay_node import OverlayNode
from tirgeo_ros.nodes.viewer_node import ViewerNode


@pytest.fixture
def node(environment):
    """In the default context, where the executor of the nodes is."""
    rclpy.init(args=[], domain_id=int(environment["ROS_DOMAIN_ID"]))
    node = GraphNode("listener")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def test_bad_data_is_counted_with_its_reason_and_warned_of_once():
    log = KeptLog()

    def work(message):
        raise MessageError(f"rtk/fix: {message}")

    call = log.guarded("rtk/fix", work)
    assert not any(call(number) for number in range(3))
    assert not call("\x1b[2J\n" * 10_000)
    assert log.texts("warning") == ["rtk/fix: rtk/fix: 0"]
    item = log.monitor.report("x")
    assert item.level == OK
    assert item.values["rtk/fix unreadable"] == "4"
    because = item.values["rtk/fix unreadable because"]
    assert because.isprintable()
    assert len(because) < 20_000


def test_a_fault_of_the_program_shows_once_with_its_place_and_stays_an_error():
    log = KeptLog()
    call = log.guarded("tirgeo/origin", lambda n: [1 / n if n < 2 else [][n]])
    assert call(1)
    for number in (0, 0, 5, 0):
        assert not call(number)
    first, _ = log.texts("error")  # of two kinds
    assert "ZeroDivisionError: division by zero" in first
    assert "test_graph_node.py" in first
    assert call(1)
    for _ in range(2):
        item = log.monitor.report("x")
        assert item.level == ERROR
        assert "tirgeo/origin: ZeroDivisionError at test_graph_node.py:" in item.message
        assert item.values["tirgeo/origin failed"] == "4"


def test_a_node_outlives_what_its_callbacks_and_timers_raise(node):
    """Over the executor of the nodes: a subscription, a timer, and its own diagnostics."""
    ticks, heard = [], []

    def work(*message):
        ticks.append(message)
        raise ValueError("math domain error")

    node.listen("words", work, output(), "std_msgs/msg/String")
    node.steady_timer("drawing", 0.01, work)
    node.report_each_second(work)
    node.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 10)
    words = node.create_publisher(String, "words", 10)
    executor = EventsExecutor()
    executor.add_node(node)
    end_s = time.monotonic() + 30.0

    def reports() -> dict[str, str]:
        return {pair.key: pair.value for pair in heard[-1].status[0].values} if heard else {}

    wanted = {"words failed", "drawing failed", "diagnostics failed"}
    while not wanted <= reports().keys():
        assert time.monotonic() < end_s, reports()
        words.publish(String(data="x"))
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    assert heard[-1].status[0].level == bytes([ERROR])


def test_one_thread_reads_what_another_writes():
    """As dji_node's serial thread and its diagnostics; here each message is of a new topic."""
    monitor, stop = Monitor(), threading.Event()

    def write():
        for number in takewhile(lambda _: not stop.is_set(), count()):
            monitor.published(f"topic {number}", 0.001)

    usual_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    writer = threading.Thread(target=write)
    writer.start()
    try:
        for _ in range(100):
            time.sleep(0.001)
            monitor.report("x")
    finally:
        stop.set()
        writer.join()
        sys.setswitchinterval(usual_s)


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(monitor_module.time, "monotonic", lambda: now[0])
    return now


def test_rates_are_of_the_last_window(clock):
    monitor = Monitor()
    for _ in range(200):
        monitor.received("imu/data")
    clock[0] += 2.0
    monitor.published("tirgeo/odometry", 0.02)
    assert monitor.report("x").values["imu/data rate [Hz]"] == "100.0"
    clock[0] += 0.5  # a change of the state is reported between two windows
    monitor.received("imu/data")
    assert monitor.topics() == {
        "imu/data": TopicState(100.0, age_s=0.0),
        "tirgeo/odometry": TopicState(0.5, latency_ms=20.0, latency_p95_ms=20.0),
    }
    clock[0] += 0.5
    item = monitor.report("x")
    assert item.values["imu/data rate [Hz]"] == "1.0"
    assert item.values["imu/data age [s]"] == "0.50"


def test_silence_of_what_is_needed_is_a_warning(clock):
    monitor = Monitor()
    monitor.expects("imu/data")
    monitor.received("tirgeo/origin")  # once, for ever: not expected again
    assert monitor.report("x").level == OK
    clock[0] += 3.0
    item = monitor.report("x")
    assert (item.level, item.message) == (WARN, "silent: imu/data")
    monitor.received("imu/data")
    assert monitor.report("x").level == OK


@pytest.mark.parametrize("make", [EkfNode, GimbalNode, OverlayNode, ViewerNode, DjiNode])
@pytest.mark.graph
def test_each_publisher_offers_what_bags_say_of_its_topic(
    environment, make, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # for the file of the targets
    words = ["--ros-args", "-p", "source:=psdk"] if make is DjiNode else []
    rclpy.init(args=words, domain_id=int(environment["ROS_DOMAIN_ID"]))
    try:
        node = make()
        offered = {entry.topic_name: entry.qos_profile for entry in node.publishers}
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    offered.pop("/parameter_events")  # rclpy's own
    assert len(offered) > 1
    for topic, result in offered.items():
        reports = offered_qos(f"/uav1{topic}")
        assert result.history == HistoryPolicy.KEEP_LAST
        assert result.reliability == ReliabilityPolicy.RELIABLE
        assert (topic, result.depth) == (topic, reports.depth)
        latched = result.durability == DurabilityPolicy.TRANSIENT_LOCAL
        assert (topic, latched) == (topic, reports.latched)
