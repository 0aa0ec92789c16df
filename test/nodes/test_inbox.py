"""What waits while a node does something else is handled as it arrived, by either executor."""

from __future__ import annotations

import time

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

import rclpy
from project import PROJECT
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import Imu, NavSatFix

from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.io.messages import stamp_ns
from tirgeo_ros.nodes.ekf_node import Inbox
from tirgeo_ros.nodes.graph_node import GraphNode, output, sensor_input
from tirgeo_ros.nodes.monitor import ERROR
from tirgeo_ros.nodes.runner import make_executor

pytestmark = pytest.mark.graph

KINDS = {"imu/data": Imu, "rtk/fix": NavSatFix}
IMU, FIX = KINDS
S = 1_000_000_000


class Listener:
    """A node with an inbox, and what its handler was given: topic, stamp in s."""

    def __init__(self, domain: int, executor_of, depth: int = 100) -> None:
        self.context = Context()
        rclpy.init(context=self.context, args=[], domain_id=domain)
        self.node = GraphNode("listener", context=self.context)
        self.handled = []
        self.inbox = Inbox(self.node)
        self.work = lambda topic, stamp_s: self.handled.append((topic, stamp_s))
        for topic in KINDS:
            self.inbox.subscribe(topic, self._taker(topic), sensor_input(depth))
        make = self.node.create_publisher
        self._publishers = {t: make(kind, t, output(1000)) for t, kind in KINDS.items()}
        self._executor = executor_of(context=self.context)
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


@pytest.fixture(params=[make_executor, SingleThreadedExecutor])
def listen(request, environment):
    """Make a listener: ``listen(depth=20)``."""
    made = []

    def make(**options) -> Listener:
        made.append(Listener(int(environment["ROS_DOMAIN_ID"]), request.param, **options))
        return made[-1]

    yield make
    for listener in made:
        listener.close()


def test_rclpy_has_no_public_way_to_take_a_message_or_to_share_a_clock():
    """So ``inbox`` and ``runner`` use its inside, and setup.py and package.xml bound its version.

    A callback gets one message of one topic in the executor's order, and each node has a
    subscription to ``/clock`` of its own.
    """
    assert not [name for name in dir(Subscription) if "take" in name]
    assert not [name for name in dir(Node) if "time_source" in name and name[0] != "_"]
    assert '"ros-jazzy-rclpy<8"' in (PROJECT / "setup.py").read_text()
    assert 'version_lt="8.0.0">rclpy<' in (PROJECT / "package.xml").read_text()


def test_what_waited_is_handled_as_it_arrived(listen):
    """Stamps have no say: they are of another time, and go back."""
    listener = listen()
    sent = [(FIX if number % 10 == 9 else IMU, 1000 - 7 * number) for number in range(60)]
    for topic, stamp_s in sent:
        listener.send(topic, stamp_s)
    listener.spin_until(lambda: len(listener.handled) == len(sent))
    assert listener.handled == sent


def test_what_is_left_of_a_queue_that_ran_over_keeps_its_place(listen):
    listener = listen(depth=20)
    sent = [(FIX if number % 10 == 9 else IMU, number) for number in range(100)]
    for topic, stamp_s in sent:
        listener.send(topic, stamp_s)
    kept = [item for item in sent if item[0] == FIX]
    kept += [item for item in sent if item[0] == IMU][-20:]
    listener.spin_until(lambda: len(listener.handled) == len(kept))
    assert listener.handled == sorted(kept, key=lambda item: item[1])


def test_timers_have_their_turn_while_much_waits(listen):
    listener, ticks = listen(), []
    listener.node.steady_timer("tick", 0.001, lambda: ticks.append(len(listener.handled)))
    listener.work = lambda *item: (listener.handled.append(item), time.sleep(0.002))
    for number in range(100):
        listener.send(IMU, number)
    listener.spin_until(lambda: len(listener.handled) == 100)
    assert any(0 < handled < 100 for handled in ticks)


def test_what_fails_is_counted_for_its_own_topic(listen):
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
    item = listener.node.monitor.item("x")
    assert item.level == ERROR
    assert f"failed: {FIX}: ValueError at test_inbox.py" in item.message
    assert item.values[f"{FIX} failed"] == "3"
    assert item.values[f"{FIX} unreadable"] == "1"
    assert not {f"{IMU} failed", f"{IMU} unreadable"} & item.values.keys()


def test_bytes_that_are_no_message_are_counted(listen):
    listener = listen()
    listener._publishers[IMU].publish(b"\0\1\0\0" + b"\xff" * 20)
    listener.send(IMU, 1)
    listener.spin_until(lambda: listener.handled)
    values = listener.node.monitor.item("x").values
    assert values[f"{IMU} unreadable"] == "1"
    assert "24 bytes are no sensor_msgs/msg/Imu" in values[f"{IMU} unreadable because"]
