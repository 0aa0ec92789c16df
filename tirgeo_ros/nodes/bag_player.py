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
"""Play a bag onto topics in real time, once its subscribers are there.

It publishes /clock. With ``live`` it shifts all stamps instead, as if the flight were now; then
the aircraft's data can be sent as bytes on a pseudo-terminal, in step with the pictures.
"""

from __future__ import annotations

import heapq
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header

from tirgeo_ros.core.config import BagPlayerConfig
from tirgeo_ros.core.streams.stamps import Arrivals
from tirgeo_ros.core.types.errors import BagError, ConfigError, MessageError, shown
from tirgeo_ros.dji.simulator.aircraft import Aircraft, frames_of
from tirgeo_ros.dji.simulator.pseudo_terminal import PseudoTerminal
from tirgeo_ros.io.bags.bag import BagMessage, BagReader
from tirgeo_ros.io.messages import DJI_TOPICS, SENSED_SAMPLES, SensedSample, stamp_ns
from tirgeo_ros.io.messages.topics import offered_qos
from tirgeo_ros.nodes.graph_node import GraphNode, latched, message_class, output, topic_names
from tirgeo_ros.nodes.monitor import OK, WARN
from tirgeo_ros.nodes.runner import run

_DEPTH = 100
_STEADY_S = 1.0
_POLL_S = 0.05
_CLOCK_PERIOD_S = 0.025
#: Longest wait for all acknowledgements: a reader may send its own only at the next heartbeat,
#: every 3 s.
_ACKNOWLEDGE_S = 5.0
#: At the end, for what does not acknowledge: the port, and readers that take best effort.
_TAKEN_S = 0.5
#: A live bag starts this much later, so that its first messages are read and restamped in time.
_LEAD_S = 0.5
#: Log text before the number of nanoseconds.
SHIFTED = "live: stamps are later than the bag's by"
Due = tuple[int, Callable[[], None]]  # bag time in ns, and the call to make at that time
#: Topics of tirgeo/ that are played: the others come from the graph itself, and would conflict.
_PLAYED = ("locate/pixel", "targets")
_INFRASTRUCTURE = ("clock", "rosout", "parameter_events", "diagnostics", "tf", "tf_static")


def publishers_for(
    node: Node, topics: Mapping[str, str], wanted: str, otherwise: Collection[str] = ()
) -> dict[str, Publisher]:
    """Return a publisher for each topic of a bag (name -> type) that is to be played.

    ``wanted`` names topics, separated by commas; empty = all that the graph does not publish
    itself. ``otherwise`` names topics of the bag that are played in another way. Topics are
    published with relative names, so the node's namespace applies. A type that is not installed is
    skipped with a warning. Raise BagError for a wanted topic that the bag lacks, or if there is
    nothing to play.
    """
    publishers = {}
    for topic in _chosen(topics, wanted):
        if topic in otherwise:
            continue
        relative = topic.lstrip("/")
        offered = offered_qos(relative)
        qos = latched() if offered.latched else output(max(offered.depth, _DEPTH))
        try:
            publishers[topic] = node.create_publisher(message_class(topics[topic]), relative, qos)
        except ConfigError as error:
            node.get_logger().warning(shown(f"{topic} is not played: {error}"))
    if not publishers and not otherwise:
        raise BagError(f"the bag has no topic to play (it has: {', '.join(topics) or 'none'})")
    return publishers


def aircraft_topics(topics: Mapping[str, str], wanted: str) -> dict[str, str]:
    """Return topics to play that a DJI aircraft sends: name -> type. Raise BagError if none."""
    chosen = _chosen(topics, wanted)
    types = {topic: topics[topic] for topic in chosen if topic.lstrip("/") in DJI_TOPICS}
    if not types:
        raise BagError(f"the bag has none of the aircraft's topics: {', '.join(DJI_TOPICS)}")
    return types


def _chosen(topics: Mapping[str, str], listed: str) -> list[str]:
    wanted = topic_names(listed)
    if not wanted:
        return [topic for topic in topics if not _is_graph_output(topic.lstrip("/"))]
    by_name = {topic.lstrip("/"): topic for topic in topics}
    absent = [name for name in wanted if name not in by_name]
    if absent:
        raise BagError(f"the bag has no {', '.join(absent)} (it has: {', '.join(topics)})")
    return [by_name[name] for name in wanted]


def _is_graph_output(name: str) -> bool:
    # A bag recorded in a namespace has the namespace as a prefix of each name.
    _, ours, own = name.rpartition("tirgeo/")
    return (bool(ours) and not own.startswith(_PLAYED)) or name in _INFRASTRUCTURE


def await_readers(
    node: Node,
    publishers: Collection[Publisher],
    awaited: str,
    timeout_s: float,
    stop: threading.Event,
    attend: Callable[[], str] = lambda: "",
) -> str:
    """Wait until the awaited subscribers exist and none came or went for a second.

    ``awaited`` names topics that need a subscriber, separated by commas; empty = any. ``attend``
    is called repeatedly and returns what else is missing. Return what is missing after
    ``timeout_s``, else an empty text, also when ``stop`` is set. Raise ConfigError for an awaited
    topic that is not played.
    """
    wanted = {node.resolve_topic_name(name) for name in topic_names(awaited)}
    unknown = wanted - {publisher.topic_name for publisher in publishers}
    if unknown:
        raise ConfigError(f"parameter wait_for: {', '.join(sorted(unknown))} is not played")
    begin = changed = time.monotonic()
    counts: dict[str, int] = {}
    while not stop.wait(_POLL_S):
        now = time.monotonic()
        before, counts = counts, {p.topic_name: p.get_subscription_count() for p in publishers}
        changed = now if counts != before else changed
        absent = ", ".join(sorted(name for name in wanted if not counts[name]))
        missing = attend() or (f"a subscriber of {absent}" if absent else "")
        has_readers = any(counts.values()) or not counts
        if has_readers and not missing and now - changed >= _STEADY_S:
            return ""
        if now - begin >= timeout_s:
            return missing or "any steady subscriber"
    return ""


class SerialAircraft:
    """Simulate an aircraft on a pseudo-terminal, for one program that reads it."""

    def __init__(self, config: BagPlayerConfig, topics: Mapping[str, str]) -> None:
        """Open the port; ``topics`` of the bag, name -> type. Raise DjiError if that fails."""
        self.terminal = PseudoTerminal(config.serial_port)
        self._topics = topics
        self._arrivals = Arrivals()
        self._unreadable: Counter[str] = Counter()
        self._aircraft = Aircraft(config.simulated_aircraft, config.aircraft)

    def frames(self, reader: BagReader, start_ns: int, shift_ns: int) -> Iterator[Due]:
        """Yield bag times (ns) and the calls that send the frames of that time, stamps shifted."""
        for time_ns, data in frames_of(self._aircraft, self._samples(reader, start_ns, shift_ns)):
            yield time_ns - shift_ns, partial(self.terminal.write, data)

    @property
    def losses(self) -> str:
        """Return which data of the flight were not sent, in one line; empty if all were."""
        counts = dict(self._aircraft.counts)
        losses = {
            "invalid samples": counts.get("invalid", 0),
            "samples of imu/data not later than the one before": counts.get("imu_not_later", 0),
            **{f"unreadable messages of {topic}": n for topic, n in self._unreadable.items()},
            f"bytes that nobody read from {self.terminal.path}": self.terminal.dropped,
        }
        return ", ".join(f"{number} {what}" for what, number in losses.items() if number)

    def _samples(
        self, reader: BagReader, start_ns: int, shift_ns: int
    ) -> Iterator[tuple[int, SensedSample]]:
        for item in reader.messages(self._topics, start_ns):
            topic = item.topic.lstrip("/")
            try:
                message = deserialize_message(item.data, message_class(item.typename))
                sample = SENSED_SAMPLES[topic](message)
            # RuntimeError: rclpy raises it for truncated bytes.
            except (MessageError, RuntimeError):
                self._unreadable[topic] += 1
                continue
            sample = self._arrivals.stamped(topic, sample, item.log_time_ns)
            yield item.log_time_ns + shift_ns, replace(sample, stamp_ns=sample.stamp_ns + shift_ns)


class PlayClock:
    """Run bag time at ``rate`` times real time from the first stamp that is waited for.

    ``tick(bag_ns)`` is called every 25 ms of real time, between messages too. The ticks never go
    back and never pass the message that is waited for.
    """

    def __init__(self, rate: float, tick: Callable[[int], None]) -> None:
        self._rate, self._tick = rate, tick
        self._begin: tuple[float, int] | None = None  # real s, bag ns
        self._next_tick_s = 0.0

    def begin(self, bag_ns: int, in_s: float) -> tuple[float, int]:
        """Start bag time: it is ``bag_ns`` in ``in_s`` seconds. By default the first wait does."""
        self._begin = time.monotonic() + in_s, bag_ns
        return self._begin

    def wait_until(self, bag_ns: int, stop: threading.Event) -> bool:
        """Sleep and tick until bag time reaches ``bag_ns``; return False if stopped before."""
        begin_s, begin_ns = self._begin or self.begin(bag_ns, 0.0)
        due_s = begin_s + (bag_ns - begin_ns) * 1e-9 / self._rate
        while not stop.is_set():
            now_s = time.monotonic()
            if now_s >= self._next_tick_s:
                self._next_tick_s += _CLOCK_PERIOD_S
                if self._next_tick_s <= now_s:  # missed ticks are skipped
                    self._next_tick_s = now_s + _CLOCK_PERIOD_S
                elapsed_ns = max(0, round((now_s - begin_s) * self._rate * 1e9))
                self._tick(min(begin_ns + elapsed_ns, bag_ns))
            if now_s >= due_s:
                return True
            stop.wait(min(due_s, self._next_tick_s) - now_s)
        return False


class BagPlayer(GraphNode):
    """Play one bag: its publishers, its clock and, if live, the simulated aircraft on a port."""

    def __init__(self) -> None:
        super().__init__("bag_player")
        config = self._config = self.configured(BagPlayerConfig)
        if not config.bag:
            raise ConfigError("parameter bag: no bag given: set it to a bag")
        if config.live and config.rate != 1:
            raise ConfigError(f"parameter rate: a live bag plays at rate 1, not {config.rate:g}")
        if config.serial_port and not config.live:
            raise ConfigError(
                "parameter serial_port: needs live: true, because bytes are stamped when they "
                "arrive"
            )
        self._reader = BagReader(Path(config.bag))
        topics, port = self._reader.topics(), config.serial_port
        on_port = aircraft_topics(topics, config.topics) if port else {}
        self._topics = publishers_for(self, topics, config.topics, on_port)
        self._clock_publisher = None if config.live else self.advertise("/clock", output())
        self._aircraft = SerialAircraft(config, on_port) if port else None
        self.resources = self._aircraft.terminal if self._aircraft else None
        self.report_each_second(list)

    def play(self, stop: threading.Event) -> int:
        """Wait for subscribers, play, wait for acknowledgement; return the exit code."""
        config, topics = self._config, self._topics.values()
        missing = await_readers(
            self, topics, config.wait_for, config.wait_timeout_s, stop, self._attend
        )
        if missing:
            self.log(WARN, f"playing without {missing}")
        self.log(OK, f"playing {config.bag}")
        self._play_once(stop)
        while config.loop and not stop.is_set():
            self._play_once(stop)
        end_s = time.monotonic() + _ACKNOWLEDGE_S
        for publisher in topics:
            left_s = end_s - time.monotonic()
            if left_s > 0 and not stop.is_set():
                publisher.wait_for_all_acked(Duration(seconds=left_s))
        stop.wait(_TAKEN_S)
        if self._aircraft is not None and self._aircraft.losses:
            self.log(WARN, f"not played: {self._aircraft.losses}")
        if self._reader.damage:
            raise BagError(f"{config.bag}: {self._reader.damage}")
        return 0

    def _attend(self) -> str:
        """Return which reader of the simulated aircraft is missing; empty if none is."""
        is_read = self._aircraft is None or self._aircraft.terminal.is_open
        return "" if is_read else f"a reader of {self._config.serial_port}"

    def _play_once(self, stop: threading.Event) -> None:
        clock = PlayClock(self._config.rate, self._tick)
        (start_ns, _), shift_ns = self._reader.span_ns, 0
        if self._config.live:
            clock.begin(start_ns, _LEAD_S)
            shift_ns = time.time_ns() + round(_LEAD_S * 1e9) - start_ns
            self.get_logger().info(f"{SHIFTED} {shift_ns} ns")
        due = self._published(start_ns, shift_ns)
        if self._aircraft is not None:
            frames = self._aircraft.frames(self._reader, start_ns, shift_ns)
            due = heapq.merge(frames, due, key=itemgetter(0))
        count = 0
        for due_ns, send in due:
            if not clock.wait_until(due_ns, stop):
                break
            send()
            count += 1
        self.log(OK, f"played {count} messages of {self._config.bag}")

    def _published(self, start_ns: int, shift_ns: int) -> Iterator[Due]:
        """Yield the calls that publish, in order of bag time (ns)."""
        for item in self._reader.messages(self._topics, start_ns):
            message = self._moved(item, shift_ns) if self._config.live else item.data
            if message is not None:
                yield item.log_time_ns, partial(self._topics[item.topic].publish, message)

    def _moved(self, item: BagMessage, shift_ns: int) -> Any:
        try:
            message = deserialize_message(item.data, message_class(item.typename))
        except RuntimeError as error:
            self.get_logger().warning(
                shown(f"{item.topic}: a message cannot be read and is not played: {error}"),
                throttle_duration_sec=10.0,
            )
            return None
        move_stamps(message, shift_ns)
        return message

    def _tick(self, bag_ns: int) -> None:
        if self._clock_publisher is not None:
            self._clock_publisher.publish(self.messages.clock(bag_ns))


def move_stamps(part: Any, shift_ns: int) -> None:
    """Add ``shift_ns`` to the stamps of all headers in a message, in place; 0 stays 0."""
    for name in part.get_fields_and_field_types():
        value = getattr(part, name)
        if isinstance(value, Header) and (stamp := stamp_ns(part)):
            sec, nanosec = divmod(stamp + shift_ns, 1_000_000_000)
            part.header.stamp.sec, part.header.stamp.nanosec = sec, nanosec
        for item in value if isinstance(value, list) else [value]:
            if hasattr(item, "get_fields_and_field_types"):
                move_stamps(item, shift_ns)


main = partial(run, "bag_player", BagPlayer, BagPlayer.play)
