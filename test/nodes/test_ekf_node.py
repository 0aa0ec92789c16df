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
"""ekf_node: messages in the order of arrival, its log, a heading set by a person."""

from __future__ import annotations

import math
import time

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from flights import flight
from geometry_msgs.msg import PoseWithCovarianceStamped
from graph_helpers import KeptLog, await_words
from nav_msgs.msg import Odometry
from process_bags import write_hover
from project import PROJECT
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import Imu, NavSatFix

from tirgeo_ros.core.frames.rotations import heading_of, wrapped
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus
from tirgeo_ros.io.messages import body_pose, stamp_ns
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.nodes.ekf_node import Inbox, StateLog
from tirgeo_ros.nodes.graph_node import GraphNode, output, sensor_input
from tirgeo_ros.nodes.monitor import ERROR

KINDS = {"imu/data": Imu, "rtk/fix": NavSatFix}
IMU, FIX = KINDS
S = 1_000_000_000


class Listener:
    """A node with an inbox, and the messages that its handler got: topic, stamp in s."""

    def __init__(self, domain: int, depth: int = 100, may_wait=None) -> None:
        self.context = Context()
        rclpy.init(context=self.context, args=[], domain_id=domain)
        self.node = GraphNode("listener", context=self.context)
        self.handled = []
        self.inbox = Inbox(self.node)
        self.work = lambda topic, stamp_s: self.handled.append((topic, stamp_s))
        for topic in KINDS:
            waits = may_wait if topic == IMU else None
            self.inbox.subscribe(topic, self._taker(topic), sensor_input(depth), may_wait=waits)
        make = self.node.create_publisher
        self._publishers = {t: make(kind, t, output(1000)) for t, kind in KINDS.items()}
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)
        self.spin_until(lambda: all(p.get_subscription_count() for p in self._publishers.values()))

    def _taker(self, topic: str):
        return lambda message: self.work(topic, stamp_ns(message) // S)

    def send(self, topic: str, stamp_s: int) -> None:
        message = KINDS[topic]()
        message.header.stamp.sec = stamp_s
        self._publishers[topic].publish(message)

    def spin_until(self, done) -> None:
        end_s = time.monotonic() + 30.0
        while not done():
            assert time.monotonic() < end_s, self.handled
            self._executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def listen(environment):
    """Make a listener: ``listen(depth=20)``."""
    made = []

    def make(**options) -> Listener:
        made.append(Listener(int(environment["ROS_DOMAIN_ID"]), **options))
        return made[-1]

    yield make
    for listener in made:
        listener.close()


@pytest.mark.graph
def test_rclpy_has_no_public_way_to_take_a_message_or_list_overrides():
    """So ekf_node and parameters use private names; setup.py and package.xml bound the version.

    A callback gets one message of one topic in the executor's order.
    """
    assert not [name for name in dir(Subscription) if "take" in name]
    public = [name for name in dir(Node) if name[0] != "_"]
    assert not [name for name in public if "override" in name]
    assert '"ros-jazzy-rclpy>=7.1.6,<8"' in (PROJECT / "setup.py").read_text()
    assert 'version_lt="8.0.0">rclpy<' in (PROJECT / "package.xml").read_text()


@pytest.mark.graph
def test_waiting_messages_are_handled_in_the_order_of_arrival(listen):
    """Stamps do not count: they are from another clock, and go back."""
    listener = listen()
    sent = [(FIX if number % 10 == 9 else IMU, 1000 - 7 * number) for number in range(60)]
    for topic, stamp_s in sent:
        listener.send(topic, stamp_s)
    listener.spin_until(lambda: len(listener.handled) == len(sent))
    assert listener.handled == sent


@pytest.mark.graph
def test_messages_left_in_a_full_queue_keep_their_order(listen):
    listener = listen(depth=20)
    sent = [(FIX if number % 10 == 9 else IMU, number) for number in range(100)]
    for topic, stamp_s in sent:
        listener.send(topic, stamp_s)
    kept = [item for item in sent if item[0] == FIX]
    kept += [item for item in sent if item[0] == IMU][-20:]
    listener.spin_until(lambda: len(listener.handled) == len(kept))
    assert listener.handled == sorted(kept, key=lambda item: item[1])


@pytest.mark.graph
def test_messages_that_may_wait_are_handled_with_the_next_that_may_not(listen):
    """Or four together, or when somebody asks: never later, and in their order."""
    listener = listen(may_wait=lambda data: header_stamp_ns(data) // S % 10 != 0)

    def send(topic, stamp_s):
        listener.send(topic, stamp_s)
        end_s = time.monotonic() + 0.3
        listener.spin_until(lambda: time.monotonic() > end_s)
        return len(listener.handled)

    counts = [send(IMU, stamp_s) for stamp_s in (1, 2, 10)]  # 10 may not wait
    counts += [send(IMU, 11), send(FIX, 12)]  # another topic never waits
    counts += [send(IMU, stamp_s) for stamp_s in (13, 14, 15, 16, 17)]
    assert counts == [0, 0, 3, 3, 5, 5, 5, 5, 9, 9]
    listener.inbox.work()
    assert [stamp_s for _, stamp_s in listener.handled] == [1, 2, *range(10, 18)]


@pytest.mark.graph
def test_timers_run_while_many_messages_wait(listen):
    listener, ticks = listen(), []
    listener.node.steady_timer("tick", 0.001, lambda: ticks.append(len(listener.handled)))
    listener.work = lambda *item: (listener.handled.append(item), time.sleep(0.002))
    for number in range(100):
        listener.send(IMU, number)
    listener.spin_until(lambda: len(listener.handled) == 100)
    assert any(0 < handled < 100 for handled in ticks)


@pytest.mark.graph
def test_a_failure_is_counted_for_its_own_topic(listen):
    """Each is handled in the callback of whichever topic the executor serves."""
    listener = listen()

    def work(topic: str, stamp_s: int) -> None:
        listener.handled.append((topic, stamp_s))
        if topic == FIX:
            raise ValueError("math domain error") if stamp_s else MessageError("no position")

    listener.work = work
    for number in range(4):
        listener.send(IMU, number)
        listener.send(FIX, number)
    listener.spin_until(lambda: len(listener.handled) == 8)
    item = listener.node.monitor.report("x")
    assert item.level == ERROR
    assert f"failed: {FIX}: ValueError at test_ekf_node.py" in item.message
    assert item.values[f"{FIX} failed"] == "3"
    assert item.values[f"{FIX} unreadable"] == "1"
    assert not {f"{IMU} failed", f"{IMU} unreadable"} & item.values.keys()


@pytest.mark.graph
def test_bytes_that_are_no_message_are_counted(listen):
    listener = listen()
    listener._publishers[IMU].publish(b"\0\1\0\0" + b"\xff" * 20)
    listener.send(IMU, 1)
    listener.spin_until(lambda: listener.handled)
    values = listener.node.monitor.report("x").values
    assert values[f"{IMU} unreadable"] == "1"
    assert "24 bytes are no sensor_msgs/msg/Imu" in values[f"{IMU} unreadable because"]


def status(state: FilterState, reason: str = "", **more: object) -> NavigationStatus:
    return NavigationStatus("ekf", state, reason, FixStatus.FIXED, math.nan, {}, {}, **more)


def test_a_transition_is_logged_once_and_a_worse_state_is_a_warning():
    node = KeptLog()
    log = StateLog(node)
    given = (
        status(FilterState.WAITING),
        status(FilterState.WAITING, "needs rtk/vel", state_s=1.0),
        status(FilterState.ALIGNING, "too slow"),
        status(FilterState.RUNNING),
        status(FilterState.DEGRADED, "rtk/heading"),
        status(FilterState.LOST, "position"),
        status(FilterState.ALIGNING),
    )
    assert [log.note(entry) for entry in given] == [True, False, True, True, True, True, True]
    assert node.lines == [
        ("info", "ekf: waiting"),
        ("info", "ekf: aligning: too slow"),
        ("info", "ekf: running"),
        ("warning", "ekf: degraded: rtk/heading"),
        ("warning", "ekf: lost: position"),
        ("info", "ekf: aligning"),
    ]


def test_every_reset_is_logged_once_with_what_it_changed():
    node, running = KeptLog(), FilterState.RUNNING
    log = StateLog(node)
    once = {"resets": {"rtk_position": 1}, "last_reset": "position by 3.2 m"}
    both = {"resets": {"rtk_position": 1, "rtk_heading": 1}, "last_reset": "heading by 170 deg"}
    given = (status(running), *[status(running, **once)] * 2, status(running, **both))
    assert [log.note(entry) for entry in given] == [True, True, False, True]
    assert node.texts("warning") == [
        "reset by rtk_position: position by 3.2 m",
        "reset by rtk_heading: heading by 170 deg",
    ]


def test_another_reason_is_logged_on_request():
    node = KeptLog()
    log = StateLog(node)
    for reason, reasons in (("a", False), ("b", False), ("b", True), ("b", True)):
        log.note(status(FilterState.WAITING, reason), reasons=reasons)
    assert node.texts() == ["ekf: waiting: a", "ekf: waiting: b"]


TOPIC, ITEM, SIGMA_DEG = "/ekf_node/set_heading", "/ekf_node: navigation", 2.0


@pytest.fixture(scope="module")
def hover(tmp_path_factory):
    """A hover whose bag has no rtk/heading and no attitude of the autopilot."""
    flown = flight(1, 25.0, "hover")
    return flown, write_hover(tmp_path_factory.mktemp("hover") / "hover.mcap", flown)


def heading(heading_rad: float, sigma_deg: float = SIGMA_DEG, frame: str = "map"):
    """A pose of which only yaw and its variance count, with the stamp 0: now."""
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame
    message.pose.pose.position.x = 17.0
    yaw = 0.5 * math.pi - heading_rad
    turned = message.pose.pose.orientation
    turned.z, turned.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    message.pose.covariance[35] = math.radians(sigma_deg) ** 2
    return message


@pytest.mark.slow
@pytest.mark.graph
def test_the_filter_begins_with_a_heading_that_is_set(spawn, meet, hover):
    flown, bag = hover
    true_rad = heading_of(flown.truth.q_nb[0])  # it keeps still
    clock = ("-p", "use_sim_time:=true")
    node = spawn("ekf_node", "-p", "method:=ekf", *clock)
    await_words(node, "ready")
    stranger = meet(**{"/diagnostics": DiagnosticArray, "/tirgeo/odometry": Odometry})
    count = "count.set_heading."

    def reports(name: str) -> int:
        return int(stranger.diagnostic(ITEM).get(count + name, 0))

    # Refused with the reason: not finite, too early, in another frame.
    wrong = heading(math.nan), heading(true_rad), heading(true_rad, frame="base_link")
    stranger.send(
        {TOPIC: list(wrong)},
        lambda: reports("invalid") and reports("standby") and "its frame_id is" in node.text(),
    )
    assert "~/set_heading: standby: the alignment does not need a heading now" in node.text()
    spawn("bag_player", "-p", f"bag:={bag}", "-p", "wait_for:=imu/data,rtk/fix,rtk/vel")
    stranger.spin_until(lambda: "~/set_heading" in stranger.diagnostic(ITEM).get("reason", ""))
    stranger.send({TOPIC: [heading(true_rad)]}, lambda: reports("used"))
    stranger.spin_until(lambda: stranger.received["/tirgeo/odometry"])
    first = body_pose(stranger.received["/tirgeo/odometry"][0])
    sigma_rad = math.sqrt(first.covariance[5, 5])
    assert abs(wrapped(heading_of(first.q_nb) - true_rad)) < 3 * sigma_rad
    # The gyroscopes' bias adds to it, 0.4 deg/s since it was said.
    assert math.radians(0.9 * SIGMA_DEG) < sigma_rad < math.radians(4 * SIGMA_DEG)
    assert "~/set_heading: used: the filter starts with this heading" in node.text()
