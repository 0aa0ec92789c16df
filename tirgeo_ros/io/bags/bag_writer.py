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
"""Write bags: one MCAP file of profile ``ros2``, ``ros2msg`` schemas, CDR messages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import yaml

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag_file import TopicForm
from tirgeo_ros.io.bags.mcap_backend import mcap_backend
from tirgeo_ros.io.files.whole_files import PathLike, check_place, part_of, path_of, writing
from tirgeo_ros.io.messages.cdr import Cdr
from tirgeo_ros.io.messages.topics import offered_qos


@final
class BagWriter:
    """Write a bag; a context manager.

    The file gets its name when the context ends without an error; after an error nothing is left
    behind. A ``growing`` file has its name from the start, and can be read up to about the last
    ``flush`` even if the process is killed. The same calls give the same bytes. Each topic is
    written with the QoS of its publisher, so that ``ros2 bag play`` offers the same. Topics in
    ``forms`` keep their recorded QoS and the definition of their type, which may be unknown here.
    Raises BagError if the file cannot be written.
    """

    def __init__(
        self,
        path: PathLike,
        *,
        growing: bool = False,
        forms: Mapping[str, TopicForm] | None = None,
    ) -> None:
        self.path = path_of(path, BagError)
        self._growing = growing
        self._cdr = Cdr()
        self._channels: dict[str, tuple[int, str]] = {}
        self._forms = forms or {}
        self._part = self.path if growing else part_of(self.path)

    def __enter__(self) -> BagWriter:
        """Open a temporary file beside the future bag."""
        check_place(self.path, BagError)
        with writing(self.path, BagError):
            self._sink = mcap_backend(self.path)[1](self._part, growing=self._growing)
        return self

    def write(self, topic: str, typename: str, message: Any, log_time_ns: int) -> None:
        """Append a message, an object or its CDR bytes, to a topic (``/imu/data``)."""
        number, first = self._channels.get(topic) or self._channel(topic, typename)
        if first != typename:
            raise BagError(
                f"{self.path}: topic {topic} has type {first}: no {typename} can be written to it"
            )
        data = message if isinstance(message, bytes) else self._cdr.serialize(message, typename)
        with writing(self.path, BagError):
            self._sink.add(number, data, log_time_ns)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a record of texts by name, which is no message; rosbag2_py cannot write one."""
        with writing(self.path, BagError):
            self._sink.add_metadata(name, values)

    def flush(self) -> None:
        """Pass all messages to the operating system, except those of the newest chunk."""
        with writing(self.path, BagError):
            self._sink.flush()

    def _channel(self, topic: str, typename: str) -> tuple[int, str]:
        form = self._forms.get(topic) or TopicForm(typename, b"", "", "cdr", {})
        metadata = {**form.metadata, "offered_qos_profiles": qos_in_words(topic, form.metadata)}
        if not form.definition and (typename in self._cdr or topic not in self._forms):
            text = self._cdr.definition(typename).encode()
            form = form._replace(encoding="ros2msg", definition=text)
        with writing(self.path, BagError):
            number = self._sink.add_topic(
                topic, form._replace(typename=typename, metadata=metadata)
            )
        self._channels[topic] = (number, typename)
        return number, typename

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the file and rename it, or remove it after an error."""
        try:
            with writing(self.path, BagError):
                self._sink.close(complete=kind is None or self._growing)
                if kind is None:
                    self._part.replace(self.path)
        finally:
            if not self._growing and self._part.is_file():
                self._part.unlink()


def qos_in_words(topic: str, metadata: Mapping[str, str]) -> str:
    """Return the QoS of a recorded topic as Jazzy writes it: ``offered_qos_profiles``.

    It is a YAML list with one entry for each publisher. In bags of Humble and before, its policies
    are numbers: then, and if it cannot be read, the QoS that tirgeo offers is returned, with the
    recorded durability.
    """
    text = metadata.get("offered_qos_profiles", "")
    durabilities = _durabilities(text)
    if durabilities and not any(isinstance(each, int) for each in durabilities):
        return text
    offered = offered_qos(topic)
    return offered._replace(latched=offered.latched or 1 in durabilities).text


def is_latched(topic: str, metadata: Mapping[str, str]) -> bool:
    """Return whether late subscribers of a recorded topic get its last message."""
    return "transient_local" in _durabilities(qos_in_words(topic, metadata))


def _durabilities(text: str) -> list[object]:
    """Return each publisher's durability, a word or a number: 1 is transient local (rmw)."""
    try:
        document = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError):
        return []
    entries = document if isinstance(document, list) else []
    return [entry.get("durability") for entry in entries if isinstance(entry, dict)]
