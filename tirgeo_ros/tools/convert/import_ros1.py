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
"""Convert a ROS 1 bag of DJI's wrapper to the topics of the contract."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.dji.sources.ros1 import NEEDED, TOPICS, WRAPPERS, Ros1Decoder, survey
from tirgeo_ros.io.bags.bag_file import BagMessage
from tirgeo_ros.io.bags.ros1_bag import Ros1Bag
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.io.messages.topics import CAMERA_INFO, PICTURES
from tirgeo_ros.tools.convert.import_mapped import asked_topics, suggested
from tirgeo_ros.tools.convert.import_sink import ImportSink, TopicCount
from tirgeo_ros.tools.presentation.progress import Report

#: Number of messages that are inspected before the import begins.
_SURVEYED = 4000


class Pictures(NamedTuple):
    """Hold the bag's topics (full names) that are copied unchanged; empty = none."""

    image: str = ""
    camera_info: str = ""


@dataclass
class _Topic(TopicCount):
    """Count a topic's messages of one type."""

    expected: str = ""  # type that the wrapper publishes

    @property
    def complaint(self) -> str | None:
        """Return what is wrong with the topic, in words, or None."""
        if self.refused and self.typename != self.expected:  # not from the wrapper
            return f"{self.topic}: {self.refused} of type {self.typename}, not {self.expected}"
        return super().complaint

    def result(self) -> dict[str, object]:
        """Return the row of the summary."""
        return super().result() | {"expected": self.expected}


class _Import:
    """Convert a bag's messages to readings and pass them to a sink.

    Raise BagError if the bag has no topic of the wrapper (in this namespace), has several aircraft
    or lacks the pictures that are asked for.
    """

    def __init__(self, bag: Ros1Bag, namespace: str, pictures: Pictures) -> None:
        self.bag = bag
        self.topics: dict[tuple[str, str], _Topic] = {}
        self.copied = _copied(bag, pictures)  # topic -> topic of the contract
        self.names = _wrapper_topics(bag, namespace)  # topic -> its name in the wrapper
        self.decoder = Ros1Decoder(survey(self._first()))

    def _first(self) -> Iterator[tuple[str, Any, int]]:
        """Yield the first messages that can be read: name in the wrapper, message, record time."""
        for message in islice(self.bag.messages(set(self.names)), _SURVEYED):
            name = self.names[message.topic]
            if message.typename == TOPICS[name][0]:
                with suppress(MessageError):  # counted when it is read again
                    yield name, self.bag.decoded(message), message.log_time_ns

    def run(self, sink: ImportSink, progress: Report) -> None:
        """Read the whole bag."""
        begun_ns, ended_ns = self.bag.span_ns
        for message in self.bag.messages({*self.names, *self.copied}):
            progress((message.log_time_ns - begun_ns) * 1e-9, (ended_ns - begun_ns) * 1e-9)
            topic = self._topic(message)
            topic.messages += 1
            try:
                self._take(message, sink)
            except MessageError as error:
                topic.refuse(error)
        for arrived in self.decoder.flush():
            sink.take(*arrived)

    def _take(self, message: BagMessage, sink: ImportSink) -> None:
        """Convert a message. Raise MessageError if it cannot be used."""
        contract = self.copied.get(message.topic)
        if contract is not None:
            arrival_ns = self.decoder.arrival_ns(message.log_time_ns)
            sink.pass_on(arrival_ns, contract, self.bag.cdr(message))
            return
        name = self.names[message.topic]
        if message.typename != TOPICS[name][0]:
            raise MessageError("of another type")
        for arrived in self.decoder.take(name, self.bag.decoded(message), message.log_time_ns):
            sink.take(*arrived)

    def _topic(self, message: BagMessage) -> _Topic:
        key = message.topic, message.typename
        if key not in self.topics:
            contract = self.copied.get(message.topic)
            if contract is None:
                typename, feeds, _ = TOPICS[self.names[message.topic]]
            else:
                typename, feeds = TOPIC_TYPES[contract], (contract,)
            self.topics[key] = _Topic(*key, feeds, expected=typename)
        return self.topics[key]

    def warnings(self) -> list[str]:
        """Return a line for each thing that is missing, refused or doubtful."""
        topics = self.topics.values()
        good = {self.names.get(each.topic) for each in topics if each.messages > each.refused}
        absent = [name for name in NEEDED if name not in good]
        missing = [f"no usable messages of {', of '.join(absent)}"] if absent else []
        return (
            missing + [each.complaint for each in topics if each.complaint] + self.decoder.warnings
        )


def _wrapper_topics(bag: Ros1Bag, namespace: str) -> dict[str, str]:
    """Return topic -> name in the wrapper, for the one aircraft that is asked for."""
    aircraft: dict[str, dict[str, str]] = {}
    for topic in bag.topics():
        node, _, name = topic.strip("/").rpartition("/")
        above, _, wrapper = node.rpartition("/")
        asked = not namespace or above == namespace.strip("/")
        if wrapper in WRAPPERS and name in TOPICS and asked:
            aircraft.setdefault(node, {})[topic] = name
    if not aircraft:
        where = f" in namespace {namespace}" if namespace else ""
        options = suggested(bag.topics())
        hint = f"; name its topics, for example {options}" if options else ""
        raise BagError(
            f"{bag.path}: no topic of DJI's wrapper ({'/imu, '.join(WRAPPERS)}/imu ...){where}; "
            f"it has {', '.join(list(bag.topics())[:5]) or 'none'}{hint}"
        )
    if len(aircraft) > 1:
        raise BagError(
            f"{bag.path}: topics of more than one wrapper: /{', /'.join(sorted(aircraft))}; "
            "choose with --namespace"
        )
    return next(iter(aircraft.values()))


def _copied(bag: Ros1Bag, pictures: Pictures) -> dict[str, str]:
    """Return topic of pictures -> topic of the contract. Raise BagError if one does not fit."""
    types = {name.strip("/"): kind for name, kind in bag.topics().items()}
    kind = types.get(pictures.image.strip("/"))
    image = next((name for name in PICTURES if TOPIC_TYPES[name] == kind), PICTURES[0])
    pairs = [(pictures.image, image), (pictures.camera_info, CAMERA_INFO)]
    asked = asked_topics([pair for pair in pairs if pair[0]], bag.topics(), str(bag.path))
    return {topic: contract for topic, (contract, *_) in asked.items()}


def import_ros1(
    path: Path, sink: ImportSink, namespace: str, pictures: Pictures, progress: Report
) -> dict[str, Any]:
    """Import a bag; return what to report of it."""
    bag = Ros1Bag(path)
    run = _Import(bag, namespace, pictures)
    run.run(sink, progress)
    read = {*run.names, *run.copied}
    return {
        "kind": "ros1",
        "topics": [topic.result() for _, topic in sorted(run.topics.items())],
        "not_read": {topic: kind for topic, kind in bag.topics().items() if topic not in read},
        "warnings": run.warnings(),
        "error": None if bag.damage is None else f"{path}: {bag.damage}",
    }
