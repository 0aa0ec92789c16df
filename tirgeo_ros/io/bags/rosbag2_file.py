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
"""Read and write MCAP files through rosbag2_py of ROS 2 Jazzy."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, final

import rosbag2_py

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.core.types.missing_package import missing_line
from tirgeo_ros.io.bags.bag_file import TOO_LATE, BagFile, Connection, Row, TopicForm

_STORAGE = "mcap"
#: The profiles' text is of this version of rosbag2's metadata: policies have words, not numbers.
_QOS_VERSION = 9


class Rosbag2File(BagFile):
    """Read a file as far as rosbag2 reads it. Raises BagError if it cannot be opened."""

    def __init__(self, path: Path, name: Path) -> None:
        super().__init__(path, name)
        metadata = self._opened().get_metadata()
        counted = [each for each in metadata.topics_with_message_count if each.message_count]
        self.connections = dict(enumerate(_connection(each.topic_metadata) for each in counted))
        first_ns = metadata.starting_time.nanoseconds
        last_ns = min(first_ns + metadata.duration.nanoseconds, LAST_NS - 1)
        self.span_ns = (first_ns, last_ns) if counted and first_ns < LAST_NS else None

    def _opened(self) -> Any:
        reader, options = rosbag2_py.SequentialReader(), _options(self.path)
        try:
            reader.open(options, rosbag2_py.ConverterOptions("", ""))
        except RuntimeError as error:
            raise BagError(
                f"{self.name}: rosbag2 cannot read it: {_line(error)}; mcap reads a damaged "
                f"file up to the damage: {missing_line('mcap')}"
            ) from None
        return reader

    def rows(self, keys: Collection[int], start_ns: int) -> Iterator[Row]:
        """Yield the messages of topics in order of log time, up to where rosbag2 gives up."""
        numbers, late = {self.connections[key].topic: key for key in keys}, 0
        if not numbers:  # rosbag2 takes an empty filter as all topics
            return
        reader = self._opened()
        reader.set_filter(rosbag2_py.StorageFilter(topics=list(numbers)))
        try:
            while reader.has_next():
                topic, data, log_ns = reader.read_next()
                if log_ns >= LAST_NS:
                    late += 1
                    self.losses[1] = f"{late} {TOO_LATE}"
                elif log_ns >= start_ns:
                    yield log_ns, 0, 0, numbers[topic], data
        except RuntimeError as error:
            self.losses[0] = f"rosbag2 cannot read on ({_line(error)})"


@final
class Rosbag2Sink:
    """Write a file. Until it is closed it is a folder of its name: rosbag2 makes only folders."""

    def __init__(self, path: Path, *, growing: bool) -> None:  # noqa: ARG002  rosbag2 decides
        self._path, self._topics = path, list[str]()
        path.unlink(missing_ok=True)
        self._writer = rosbag2_py.SequentialWriter()
        options = _options(path, storage_preset_profile="zstd_fast")
        with _as_os_error():
            self._writer.open(options, rosbag2_py.ConverterOptions("", ""))

    def add_topic(self, topic: str, form: TopicForm) -> int:
        """Return the number of a new topic; rosbag2 adds the definition of its type."""
        number, text = len(self._topics), form.metadata["offered_qos_profiles"]
        with _as_os_error():
            self._writer.create_topic(
                rosbag2_py.TopicMetadata(
                    id=number,
                    name=topic,
                    type=form.typename,
                    serialization_format=form.message_encoding,
                    offered_qos_profiles=rosbag2_py.to_rclcpp_qos_vector(text, _QOS_VERSION),
                )
            )
        self._topics.append(topic)
        return number

    def add(self, number: int, data: bytes, log_time_ns: int) -> None:
        """Append a message."""
        with _as_os_error():
            self._writer.write(self._topics[number], data, log_time_ns)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Do nothing: rosbag2 writes no other records than its own."""

    def flush(self) -> None:
        """Do nothing: rosbag2 writes each chunk as soon as it is full."""

    def close(self, *, complete: bool) -> None:
        """Close the folder; put its file in its place, or remove both."""
        with _as_os_error():
            self._writer.close()
        if complete:
            (file,) = self._path.glob("*.mcap")
            whole = file.replace(self._path.with_name(f"{self._path.name}.whole"))
            shutil.rmtree(self._path)
            whole.replace(self._path)
        else:
            shutil.rmtree(self._path)


def _options(path: Path, **more: str) -> Any:
    return rosbag2_py.StorageOptions(uri=str(path), storage_id=_STORAGE, **more)


def _connection(topic: Any) -> Connection:
    return Connection(topic.name, TopicForm(topic.type, b"", "", topic.serialization_format, {}))


def _line(error: RuntimeError) -> str:
    return str(error).partition("\n")[0]


@contextmanager
def _as_os_error() -> Iterator[None]:
    try:
        yield
    except RuntimeError as error:
        raise OSError(_line(error)) from None
