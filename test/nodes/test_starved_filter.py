"""ekf_node takes good RTK also where it stood still, or gets too little time for its IMU."""

from __future__ import annotations

import signal
import time
from dataclasses import replace

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from flights import navigation_samples
from graph_helpers import await_words

from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, sensed
from tirgeo_ros.io.messages.sensor_messages import STREAM_DEPTH
from tirgeo_ros.nodes.graph_node import message_class, output
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import Scenario

# A stop may meet a node that holds the lock of its port of shared memory: Fast DDS then drops all
# that is sent meanwhile.
pytestmark = [pytest.mark.graph, pytest.mark.slow, pytest.mark.long]

IMU_HZ, FLIGHT_S, DEPTH = 400, 60.0, 200
STOP_S = 1.5
#: Of every tenth of a second the node has a twentieth, for 40 samples of 0.3 ms or more.
CYCLE_S, RUN_S = 0.1, 0.005
TOPICS = ("imu/data", "rtk/fix", "rtk/vel", "rtk/heading")


@pytest.fixture(scope="module")
def flown():
    """A flight whose RTK is good throughout."""
    scenario = Scenario(duration_s=FLIGHT_S)
    return fly(replace(scenario, imu=replace(scenario.imu, rate_hz=float(IMU_HZ))))


class Aircraft:
    """Says what the flight's sensors said, in real time, with the stamps of the flight."""

    def __init__(self, flight, stranger) -> None:
        self.sent = 0
        self._stranger = stranger
        self._messages = Messages(message_class)
        self._samples = iter(navigation_samples(flight))
        self._publishers = {
            topic: stranger.node.create_publisher(
                message_class(TOPIC_TYPES[topic]), topic, output(STREAM_DEPTH)
            )
            for topic in TOPICS
        }
        stranger.spin_until(self._heard)

    def _heard(self) -> bool:
        return all(p.get_subscription_count() for p in self._publishers.values())

    def fly(self, duration_s: float) -> None:
        begin_s = time.monotonic()
        for number in range(round(duration_s * IMU_HZ)):
            self._publish_to_imu()
            time.sleep(max(0.0, begin_s + number / IMU_HZ - time.monotonic()))
        self._stranger.executor.spin_once(timeout_sec=0.0)

    def _publish_to_imu(self) -> None:
        """The next sample of the IMU, and what comes before it."""
        for sample in self._samples:
            topic, message = sensed(self._messages, sample)
            if topic in self._publishers:
                self._publishers[topic].publish(message)
            if isinstance(sample, ImuSample):
                self.sent += 1
                return
        raise AssertionError(f"the flight is over: {self.counts()}")

    def fly_until(self, done) -> None:
        while not done():
            self.fly(CYCLE_S)

    def counts(self) -> dict[str, int]:
        """How many samples had which verdict, by ``source.outcome``."""
        told = self._stranger.diagnostic("/ekf_node: navigation")
        counts = {key.partition("count.")[2]: value for key, value in told.items()}
        return {key: int(value) for key, value in counts.items() if key}

    def unheard(self) -> int:
        """How many samples of the IMU have no verdict, as far as is known."""
        counts = self.counts().items()
        return self.sent - sum(number for key, number in counts if key.startswith("imu."))

    def settled(self) -> int:
        """How many of them there are once all that was sent has been handled."""
        for _ in range(2):  # of which the first may have been on its way
            self._stranger.received["/diagnostics"].clear()
            self._stranger.spin_until(self.counts)
        return self.unheard()

    def refused(self) -> dict[str, int]:
        """The verdicts on RTK that say that it came at the wrong time."""
        late = ("too_old", "too_new")
        return {key: n for key, n in self.counts().items() if key.endswith(late)}


def start(spawn, meet, flight, *arguments: str):
    """The node, running on the flight."""
    node = spawn("ekf_node", *arguments)
    await_words(node, "ready")
    aircraft = Aircraft(flight, meet(**{"/diagnostics": DiagnosticArray}))
    aircraft.fly_until(lambda: aircraft.counts().get("rtk_position.used", 0) > 1)
    return node, aircraft


def test_a_stop_loses_no_sample_and_no_rtk_is_refused(spawn, meet, flown):
    """600 samples wait: more than a port of shared memory holds by itself, 512."""
    node, aircraft = start(spawn, meet, flown)
    lost = aircraft.settled()  # by a reader that was met late
    before = aircraft.counts()
    node.signal(signal.SIGSTOP)
    aircraft.fly(STOP_S)
    node.signal(signal.SIGCONT)
    # At 5 Hz: those of the stop, and later ones.
    more = before["rtk_position.used"] + 5 * STOP_S + 5
    aircraft.fly_until(lambda: aircraft.counts()["rtk_position.used"] >= more)
    assert aircraft.settled() <= lost
    assert aircraft.refused() == {}
    assert not [key for key in aircraft.counts() if key in {"imu.gap", "imu.restart"}]


@pytest.mark.slow
def test_where_the_imu_is_too_much_for_it_no_rtk_is_too_old(spawn, meet, flown):
    """The queue runs over, so of the IMU some is lost; what is left keeps its order."""
    depth = f"qos_overrides./imu/data.subscription.depth:={DEPTH}"
    node, aircraft = start(spawn, meet, flown, "-p", depth)
    while aircraft.unheard() < DEPTH + IMU_HZ:  # a second is lost: twice max_delay_s
        node.signal(signal.SIGSTOP)
        aircraft.fly(CYCLE_S - RUN_S)
        node.signal(signal.SIGCONT)
        aircraft.fly(RUN_S)
    used = aircraft.counts()["rtk_position.used"]
    aircraft.fly_until(lambda: aircraft.counts()["rtk_position.used"] > used + 5)
    assert not {k: n for k, n in aircraft.refused().items() if k.endswith("too_old")}
