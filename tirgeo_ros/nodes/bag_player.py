"""Plays a bag onto topics in real time, with /clock, for subscribers that are already there."""

from __future__ import annotations

import threading
import time
from pathlib import Path

from rclpy.duration import Duration
from rclpy.node import Node

from tirgeo_ros.core.config import BagPlayerConfig
from tirgeo_ros.core.errors import BagError, ConfigError
from tirgeo_ros.io.bag import BagReader
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.nodes.parameters import declare
from tirgeo_ros.nodes.play_clock import PlayClock
from tirgeo_ros.nodes.playlist import Audience, publishers_for
from tirgeo_ros.nodes.qos import output
from tirgeo_ros.nodes.runner import run
from tirgeo_ros.nodes.topics import advertise, message_class

#: In all; a reader that lost nothing may answer only at the next heartbeat, every 3 s.
_ACKNOWLEDGE_S = 5.0


class BagPlayer(Node):
    """One bag, its publishers and its clock."""

    def __init__(self) -> None:
        super().__init__("bag_player")
        self._config = declare(self, BagPlayerConfig)
        if not self._config.bag:
            raise ConfigError("parameter bag: no bag given: set it to an MCAP file")
        self._reader = BagReader(Path(self._config.bag))
        self._topics = publishers_for(self, self._reader.topics(), self._config.topics)
        self._clock_publisher = advertise(self, "/clock", output())
        self._audience = Audience(self, [*self._topics.values()], self._config.wait_for)
        self._messages = Messages(message_class)

    def play(self, stop: threading.Event) -> int:
        """Wait for subscribers, play, wait for acknowledgement; the exit code."""
        if not self._audience.wait(self._config.wait_timeout_s, stop):
            self.get_logger().warning(f"playing without {self._audience.missing()}")
        self.get_logger().info(f"playing {self._config.bag}")
        self._play_once(stop)
        while self._config.loop and not stop.is_set():
            self._play_once(stop)
        self._await_acknowledgement(stop)
        if self._reader.damage:
            raise BagError(f"{self._config.bag}: {self._reader.damage}")
        return 0

    def _play_once(self, stop: threading.Event) -> None:
        clock = PlayClock(self._config.rate, self._config.clock_rate_hz, self._tick)
        count = 0
        for message in self._reader.messages(self._topics, self._start_ns()):
            if not clock.wait_until(message.log_time_ns, stop):
                break
            self._topics[message.topic].publish(message.data)
            count += 1
        self.get_logger().info(f"played {count} messages of {self._config.bag}")

    def _await_acknowledgement(self, stop: threading.Event) -> None:
        end_s = time.monotonic() + _ACKNOWLEDGE_S
        for publisher in self._topics.values():
            left_s = end_s - time.monotonic()
            if left_s > 0 and not stop.is_set():
                publisher.wait_for_all_acked(Duration(seconds=left_s))

    def _start_ns(self) -> int:
        first_ns, last_ns = self._reader.span_ns
        start_ns = first_ns + round(self._config.start_offset_s * 1e9)
        if start_ns > last_ns:
            raise BagError(
                f"{self._config.bag}: start_offset_s {self._config.start_offset_s:g} is beyond "
                f"the bag's {(last_ns - first_ns) * 1e-9:.1f} s"
            )
        return start_ns

    def _tick(self, bag_ns: int) -> None:
        self._clock_publisher.publish(self._messages.clock(bag_ns))


def main() -> int:
    """Run the node until the bag ends; the exit code."""
    return run("bag_player", BagPlayer, BagPlayer.play)
