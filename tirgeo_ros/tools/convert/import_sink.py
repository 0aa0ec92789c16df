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
"""Write an import: convert readings to samples, samples to messages, messages to a bag."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.dji.interpret.interpreter import Interpreter
from tirgeo_ros.dji.sources.readings import Reading
from tirgeo_ros.io.bags.bag import STILLS, BagWriter
from tirgeo_ros.io.logs.log_contents import Picture
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, SensedSample, sensed
from tirgeo_ros.io.messages.topics import CAMERA_INFO, PICTURES, TEMPERATURES, resolved

#: A sample that waits for others of its instant is out of order by less than this.
_DISORDER_NS = 1_000_000_000


@dataclass
class Written:
    """Count the messages written to a topic, with first and last log times (ns)."""

    messages: int
    first_ns: int
    last_ns: int


@dataclass
class TopicCount:
    """Count the messages of a bag's topic, from which topics of the contract are made."""

    topic: str
    typename: str
    feeds: tuple[str, ...]  # topics of the contract
    messages: int = 0
    refused: int = 0
    reason: str = ""  # of the first refused message

    def refuse(self, error: MessageError) -> None:
        """Count a message that cannot be used."""
        self.refused += 1
        self.reason = self.reason or str(error).removeprefix(f"{self.topic}: ")

    @property
    def complaint(self) -> str | None:
        """Return what is wrong with the topic, in words, or None."""
        if not self.refused:
            return None
        return f"{self.topic}: {self.refused} of {self.messages} refused ({self.reason})"

    def result(self) -> dict[str, object]:
        """Return the row of the summary."""
        return {
            "topic": self.topic,
            "type": self.typename,
            "messages": self.messages,
            "refused": self.refused,
            "because": self.complaint,
            "to": list(self.feeds),
        }


class ImportSink:
    """Write the samples of readings, in order of log time.

    A sample's log time is the arrival of its data, as in a recording of the live graph.
    """

    def __init__(self, writer: BagWriter, config: DjiConfig, namespace: str) -> None:
        self.interpreter = Interpreter(config)
        self.written: dict[str, Written] = {}
        self._writer = writer
        self._messages = Messages(config.frame_ids)
        self._names = {topic: resolved(topic, namespace) for topic in TOPIC_TYPES}
        self._waiting: list[tuple[int, int, str, Any]] = []
        self._number = 0
        self._newest_ns = 0
        self._stills: dict[str, str] = {}

    def take(self, arrival_ns: int, reading: Reading) -> None:
        """Convert and queue a reading that arrived at ``arrival_ns``."""
        self._put(arrival_ns, self.interpreter.take(reading))

    def write(self, sample: SensedSample, arrival_ns: int | None = None) -> None:
        """Queue a sample; without a time of arrival it arrived at its stamp."""
        self._put(sample.stamp_ns if arrival_ns is None else arrival_ns, [sample])

    def picture(self, picture: Picture) -> None:
        """Queue a picture, after its camera's calibration."""
        stamp_ns, make = picture.stamp_ns, self._messages
        if picture.name:
            self._stills[picture.name] = str(stamp_ns)
        if picture.camera is not None:
            self.pass_on(stamp_ns, CAMERA_INFO, make.camera_info(picture.camera, stamp_ns))
        if picture.temperatures:
            self.pass_on(stamp_ns, TEMPERATURES, make.compressed(stamp_ns, picture.temperatures))
        self.pass_on(stamp_ns, PICTURES[1], make.compressed(stamp_ns, picture.data))

    def pass_on(self, arrival_ns: int, topic: str, message: Any) -> None:
        """Queue a message, an object or its CDR, to be written unchanged."""
        heapq.heappush(self._waiting, (arrival_ns, self._number, topic, message))
        self._number += 1
        self._newest_ns = max(self._newest_ns, arrival_ns)
        while self._waiting[0][0] < self._newest_ns - _DISORDER_NS:
            self._write(*heapq.heappop(self._waiting))

    def finish(self) -> None:
        """Write all queued messages, at the end. Raise BagError if nothing was written."""
        self._put(self._newest_ns, self.interpreter.flush())
        while self._waiting:
            self._write(*heapq.heappop(self._waiting))
        if self._stills:
            self._writer.add_metadata(STILLS, self._stills)
        if not self.written:
            counts = [f"{name} {number}" for name, number in self.interpreter.counts.items()]
            because = f": {', '.join(counts)}" if counts else ""
            raise BagError(f"{self._writer.path}: nothing to write{because}")

    def _put(self, arrival_ns: int, samples: list[SensedSample]) -> None:
        for sample in samples:
            self.pass_on(arrival_ns, *sensed(self._messages, sample))

    def _write(self, log_time_ns: int, _number: int, topic: str, message: Any) -> None:
        name = self._names[topic]
        self._writer.write(name, TOPIC_TYPES[topic], message, log_time_ns)
        count = self.written.setdefault(name, Written(0, log_time_ns, log_time_ns))
        count.messages += 1
        count.last_ns = log_time_ns
