"""The one verdict: never GO a second after what is needed has gone, and why in people's words."""

from __future__ import annotations

from dataclasses import replace

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from message_samples import STATUS

from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.verdicts import FilterState, Outcome
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.messages import Messages, NodeState, TopicState
from tirgeo_ros.nodes.aircraft_topics import Reports
from tirgeo_ros.nodes.aircraft_view import STREAMS, Judge

MESSAGES = Messages(Cdr().types)
TICK_S = 0.2
ODOMETRY, POSE, PICTURE, _ = (stream.topic for stream in STREAMS)
NODES = {
    "ekf_node": ("imu/data",),
    "gimbal_node": ("gimbal/joint_states", "gimbal/attitude"),
    "overlay_node": ("thermal/image_raw", "thermal/camera_info"),
}
#: Each topic's node; the sensors' have none here.
MADE_BY = {topic: "" for topics in NODES.values() for topic in topics}
MADE_BY |= {stream.topic: stream.node for stream in STREAMS}
NOTE = Severity.NOTE
WENT_BACK = {"state": FilterState.ALIGNING, "began_again": Outcome.TIME_JUMP}
RUNNING = replace(STATUS, state=FilterState.RUNNING, reason="", began_again=None)


class Graph:
    """What reaches the page of a graph, second by second; ``stopped`` holds what is silent."""

    def __init__(self) -> None:
        self.now_s, self.status, self.worst, self.no_map = 1000.0, RUNNING, NOTE, ""
        self.stopped: set[str] = set()
        self.last_s: dict[str, float] = {}
        self.reports = Reports()
        self.judge = Judge(self.reports, self.last_s.get)

    def runs(self, seconds: float):
        """Every verdict until then, with the time since the start of the call."""
        start_s = self.now_s
        while self.now_s < start_s + seconds - 1e-6:
            self.now_s += TICK_S
            yield self.now_s - start_s, self.look()

    def look(self):
        for topic, node in MADE_BY.items():
            if self.stopped.isdisjoint((topic, node)):
                self.last_s[topic] = self.now_s
        for node in NODES.keys() - self.stopped:
            self.report(node)
        return self.judge.look(self.now_s, self.worst, self.no_map)

    def report(self, node):
        if int(self.now_s / TICK_S) % 5 != len(node) % 5:  # once a second, each at its own time
            return
        heard_s = {topic: self.last_s[topic] for topic in NODES[node] if topic in self.last_s}
        topics = {topic: TopicState(10.0, self.now_s - s) for topic, s in heard_s.items()}
        status = self.status if node == "ekf_node" else None
        state = NodeState(f"/{node}", 0, 1, topics, navigation=status)
        self.reports.take_state(self.now_s, MESSAGES.state(state))


@pytest.fixture
def flight():
    graph = Graph()
    assert [*graph.runs(5)][-1][1].word == "GO"
    return graph


@pytest.mark.parametrize(
    ("stopped", "text", "more"),
    [
        (["ekf_node", POSE, PICTURE], "The filter does not answer", "ekf_node silent for"),
        (["gimbal_node"], "The gimbal program does not answer", "gimbal_node silent for"),
        (["overlay_node"], "The overlay program does not answer", "overlay_node silent for"),
        (["imu/data", ODOMETRY, POSE], "The IMU is silent for 7 s", "imu/data silent for 7 s"),
        (
            ["gimbal/joint_states", POSE],
            "The gimbal is silent",
            "gimbal/joint_states silent for 7",
        ),
        (["thermal/image_raw", PICTURE], "The camera is silent", "thermal/image_raw silent for 7"),
        ([*NODES, *NODES["ekf_node"]], "The filter does not answer", "ekf_node silent for"),
    ],
)
def test_silence_ends_go_within_a_second_and_its_cause_is_named(flight, stopped, text, more):
    flight.stopped |= {*stopped}
    verdicts = [*flight.runs(7)]
    # A look each 0.2 s, of which the last before the limit may still say GO.
    assert all(verdict.word != "GO" for since_s, verdict in verdicts if since_s > 1.2 + 1e-6)
    assert verdicts[-1][1].text.startswith(text)
    assert verdicts[-1][1].more.startswith(more)
    alarms = {verdict.kind for _, verdict in verdicts if verdict.alarm}
    assert len(alarms) == 1  # one alarm, however the words change
    flight.stopped.clear()
    back_s = next(since_s for since_s, verdict in flight.runs(9) if verdict.word == "GO")
    assert 1.9 < back_s < 3.5  # not at the first sample: no flapping


def test_the_first_in_the_order_is_the_cause_of_what_ends_together(flight):
    flight.stopped |= {PICTURE}  # the last picture came 0.4 s before the last of the others
    assert {verdict.word for _, verdict in flight.runs(0.4)} == {"GO"}
    flight.stopped |= {"imu/data", ODOMETRY, POSE, "thermal/image_raw"}
    kinds = [verdict.kind for _, verdict in flight.runs(5) if verdict.word != "GO"]
    assert {*kinds} == {"position"}


def test_a_halt_of_this_node_is_no_silence_of_others(flight):
    for _ in range(10):
        flight.now_s += 2.0  # it did not run: the first look is before what waits is taken
        assert flight.judge.look(flight.now_s, NOTE, "").word == "GO"
        assert {verdict.word for _, verdict in flight.runs(2)} == {"GO"}


def test_there_is_no_go_before_the_first_picture():
    graph = Graph()
    graph.stopped |= {PICTURE, "thermal/image_raw"}
    verdicts = [verdict for _, verdict in graph.runs(12)]
    assert {verdict.word for verdict in verdicts} == {"NO DATA"}
    assert verdicts[-1].text == "No picture"
    assert not any(verdict.alarm for verdict in verdicts)  # it has not begun


@pytest.mark.parametrize(
    ("status", "worst", "no_map", "word", "text"),
    [
        ({"state": FilterState.DEGRADED, "reason": "no rtk/fix"}, NOTE, "", "CAUTION", "Less"),
        ({"state": FilterState.LOST}, NOTE, "NO MAP: x", "LOST", "No position"),
        ({"state": FilterState.ALIGNING}, NOTE, "NO MAP: x", "WAIT", "No position yet"),
        (WENT_BACK, NOTE, "", "LOST", "No position, as the IMU's time went back"),
        ({}, Severity.CAUTION, "NO MAP: no pose", "NO GO", "NO MAP: no pose"),
        ({}, Severity.STOP, "NO MAP: x", "NO GO", ""),
        ({}, Severity.CAUTION, "", "CAUTION", ""),
        ({}, None, "", "NO DATA", "No check"),
    ],
)
def test_the_gravest_alone_is_shown(flight, status, worst, no_map, word, text):
    flight.status, flight.worst, flight.no_map = replace(RUNNING, **status), worst, no_map
    verdict = [*flight.runs(3)][-1][1]
    assert (verdict.word, verdict.text[: len(text)]) == (word, text)
    assert verdict.more == flight.status.reason or verdict.kind != "position"
