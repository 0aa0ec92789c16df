"""Play the aircraft's part of a bag as bytes on a pseudo-terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

from rclpy.serialization import deserialize_message

from tirgeo_ros.core.config import AircraftConfig, SimulatedAircraftConfig
from tirgeo_ros.core.streams.arrivals import Arrivals
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.dji.simulator import Aircraft, frames_of
from tirgeo_ros.dji.simulator.pseudo_terminal import PseudoTerminal
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages import SENSED_SAMPLES, SensedSample
from tirgeo_ros.nodes.graph_node import message_class


class SerialAircraft:
    """Simulate an aircraft on a pseudo-terminal, for one program that reads it."""

    def __init__(
        self,
        path: str,
        config: SimulatedAircraftConfig,
        places: AircraftConfig,
        topics: Mapping[str, str],
    ) -> None:
        """Open the port; ``topics`` of the bag, name -> type. Raise DjiError if that fails."""
        self.terminal = PseudoTerminal(path)
        self._topics = topics
        self._arrivals = Arrivals()
        self._unreadable: Counter[str] = Counter()
        self._aircraft = Aircraft(config, places=places)

    def attend(self) -> bool:
        """Answer what the host has asked; return whether it has the port open."""
        self.terminal.write(self._aircraft.answer(self.terminal.read()))
        return self.terminal.is_open

    def _send(self, data: bytes) -> None:
        """Write a frame, as far as a program reads it, and answer the host."""
        self.terminal.write(data)
        self.attend()

    def frames(
        self, reader: BagReader, start_ns: int, shift_ns: int
    ) -> Iterator[tuple[int, Callable[[], None]]]:
        """Yield the bag times (ns) at which frames are due, and the calls that send them.

        Their stamps are shifted.
        """
        for time_ns, data in frames_of(self._aircraft, self._samples(reader, start_ns, shift_ns)):
            yield time_ns - shift_ns, partial(self._send, data)

    @property
    def losses(self) -> str:
        """Return what of the flight was not transmitted, in one line, or an empty string."""
        counts = dict(self._aircraft.counts)
        found = {"invalid samples": counts.get("invalid", 0)}
        found["of imu/data not later than the one before"] = counts.get("imu_not_later", 0)
        found |= {f"unreadable messages of {topic}": n for topic, n in self._unreadable.items()}
        found[f"bytes not read by anybody from {self.terminal.path}"] = self.terminal.dropped
        return ", ".join(f"{number} {what}" for what, number in found.items() if number)

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
            moved = replace(sample, stamp_ns=sample.stamp_ns + shift_ns)
            yield item.log_time_ns + shift_ns, moved
