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
"""Define what all files of bags share: messages, connections, and how they are read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.missing_package import needed

#: A message in a file: log time (ns), place (chunk, number in the chunk), connection, data.
Row = tuple[int, int, int, int, bytes]
#: The loss of messages whose log time does not fit a stamp; their number stands before it.
TOO_LATE = "messages with a log time after 2038 left out"
#: First bytes of a compressed file, and of a message that rosbag2 compressed; never of CDR.
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
MCAP_MAGIC = b"\x89MCAP0\r\n"


class BagMessage(NamedTuple):
    """Hold a message as it is in a bag."""

    topic: str
    typename: str
    log_time_ns: int
    data: bytes  # CDR; of a ROS 1 bag its own encoding
    definition: str = ""  # of the type with all parts, in a ROS 1 bag


class TopicForm(NamedTuple):
    """Hold how a topic was recorded, beside its messages."""

    typename: str
    definition: bytes  # of the type; empty where the recorder found none
    encoding: str  # of the definition: ros2msg or ros2idl, else empty or "unknown"
    message_encoding: str  # cdr
    metadata: Mapping[str, str]  # as MCAP holds it: QoS as offered_qos_profiles, the type's hash


class Connection(NamedTuple):
    """Hold a topic of a file and its form; a topic may have several connections."""

    topic: str
    form: TopicForm


class BagFile(ABC):
    """Read one file of a bag; read a cut or damaged one as far as possible.

    ``connections`` are those with messages, by their numbers; ``span_ns`` is the first and the
    last log time, None without messages. ``read`` counts the messages of the last iteration;
    ``losses`` says what could not be read, by its place in the file.
    """

    connections: Mapping[int, Connection]
    span_ns: tuple[int, int] | None
    #: The place of a row in the words of a message to people; ``{}`` is its number.
    where = ""

    def __init__(self, path: Path, name: Path) -> None:
        """Take the file to read (an unpacked copy, perhaps), and the name to show to people."""
        self.name, self.path, self.read = name, path, 0
        self.losses: dict[int, str] = {}

    def fault(self, form: TopicForm) -> str:
        """Return how a topic is encoded and what to do, if it cannot be decoded; else ""."""
        encoding = form.message_encoding
        return "" if encoding == "cdr" else f"{encoding or 'nothing'}; record it with ROS 2 (cdr)"

    @abstractmethod
    def rows(self, keys: Collection[int], start_ns: int) -> Iterator[Row]:
        """Yield the messages of these connections from ``start_ns`` on, in order of log time."""

    def metadata(self, name: str) -> dict[str, str]:  # noqa: ARG002  of another kind of file
        """Return the texts of a record that is no message; empty if the file has none."""
        return {}

    def forms(self) -> dict[str, TopicForm]:
        """Return every topic that has messages, with the form of its first connection."""
        forms: dict[str, TopicForm] = {}
        for topic, form in self.connections.values():
            forms.setdefault(topic, form)
        return forms

    def messages(
        self, topics: Collection[str] | None, start_ns: int, *, any_form: bool = False
    ) -> Iterator[BagMessage]:
        """Return the messages of topics (None: all) by log time. Raises BagError for a fault."""
        chosen: dict[int, tuple[str, str]] = {}
        for key, (topic, form) in self.connections.items():
            if topics is None or topic in topics:
                fault = "" if any_form else self.fault(form)
                if fault:
                    raise BagError(f"{self.name}: topic {topic} is encoded as {fault}")
                chosen[key] = topic, form.typename
        return self._messages(chosen, start_ns)

    def _messages(
        self, chosen: Mapping[int, tuple[str, str]], start_ns: int
    ) -> Iterator[BagMessage]:
        self.read = 0
        for log_ns, place, _, key, data in self.rows(chosen.keys(), start_ns):
            try:
                message = BagMessage(*chosen[key], log_ns, plain(data))
            except ValueError as error:
                self.losses[place] = f"a message{self.where.format(place)} {error}"
                continue
            self.read += 1
            yield message


def plain(data: bytes) -> bytes:
    """Return a message's CDR, unpacked if compressed. Raises ValueError as ``unpacked`` does."""
    if data[:4] != ZSTD_MAGIC:
        return data
    needed("zstandard", "reading a compressed message", BagError)
    from tirgeo_ros.io.bags.packed import unpacked_message  # noqa: PLC0415  few bags need it

    return unpacked_message(data)
