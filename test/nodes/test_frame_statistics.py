"""What never came is counted by the numbers of the sender, with either executor."""

from __future__ import annotations

import time
from functools import partial

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Header

from tirgeo_ros.nodes.graph_node import GraphNode, output, sensor_input
from tirgeo_ros.nodes.overlay_node import FrameStatistics
from tirgeo_ros.nodes.runner import make_executor


@pytest.mark.parametrize(
    ("numbers", "sent", "missed"),
    [
        ((1, 2, 3), 3, 0),
        ((1, 4, 5, 9), 9, 5),
        ((500, 501, 503), 4, 1),  # what was sent before the first is not of this life
        ((500, 501, 1, 2, 4), 6, 1),  # a number that goes back is a new sender's
    ],
)
def test_gaps_are_missed(numbers, sent, missed):
    found = FrameStatistics()
    for number in numbers:
        found.heard("x", number)
    assert (found.sent, found.missed) == (sent, missed)


def test_a_message_without_a_number_is_passed_on_all_the_same():
    taken, numbers = [], FrameStatistics()
    take = numbers.listening("x", taken.append)
    take("one", {"publication_sequence_number": None})
    take(("two", None))
    assert taken == ["one", "two"]
    assert numbers.sent == 0


@pytest.mark.graph
@pytest.mark.parametrize("executor_of", [make_executor, SingleThreadedExecutor])
def test_what_gives_way_in_a_shallow_queue_is_counted(environment, executor_of):
    context = Context()
    rclpy.init(context=context, args=[], domain_id=int(environment["ROS_DOMAIN_ID"]))
    node = GraphNode("numbered", context=context)
    executor = None
    try:
        numbers, taken = FrameStatistics(), []
        counted, kind = partial(numbers.listening, "x"), "std_msgs/msg/Header"
        node.listen("x", taken.append, sensor_input(1), kind, counted)
        sender = node.create_publisher(Header, "x", output(100))
        executor = executor_of(context=context)
        executor.add_node(node)
        end_s = time.monotonic() + 20
        while not taken:  # until they have found each other
            assert time.monotonic() < end_s
            sender.publish(Header(frame_id="before"))
            executor.spin_once(timeout_sec=0.1)
        begun = numbers.sent
        for number in range(50):
            sender.publish(Header(frame_id=str(number)))
        while taken[-1].frame_id != "49":
            assert time.monotonic() < end_s
            executor.spin_once(timeout_sec=0.1)
    finally:
        if executor is not None:
            executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
    after = [message for message in taken if message.frame_id != "before"]
    assert numbers.sent == len(taken) + numbers.missed
    assert 50 <= numbers.sent - begun + 1 <= 52
    assert len(after) < 50
