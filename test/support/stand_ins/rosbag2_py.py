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
"""A stand-in for rosbag2_py of ROS 2 Jazzy, which no package index has: MCAP files by ``mcap``.

It has what tirgeo uses, with the names, arguments and errors of rosbag2 0.26: times in metadata
are objects with ``nanoseconds`` (rclpy's Time and Duration there), data are bytes, an empty
filter is all topics, a writer makes a folder with one file and ``metadata.yaml``, and whatever is
wrong raises RuntimeError.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

_NO_STORAGE = "No storage could be initialized from the inputs."
_PROFILES = ("", "none", "fastwrite", "zstd_fast", "zstd_small")


@dataclass
class StorageOptions:
    uri: str
    storage_id: str = ""
    max_bagfile_size: int = 0
    max_bagfile_duration: int = 0
    max_cache_size: int = 0
    storage_preset_profile: str = ""


@dataclass
class ConverterOptions:
    input_serialization_format: str = ""
    output_serialization_format: str = ""


@dataclass
class StorageFilter:
    topics: list[str] = field(default_factory=list)


@dataclass
class TopicMetadata:
    id: int
    name: str
    type: str
    serialization_format: str
    offered_qos_profiles: list[dict] = field(default_factory=list)
    type_description_hash: str = ""


@dataclass
class TopicInformation:
    topic_metadata: TopicMetadata
    message_count: int


@dataclass
class BagMetadata:
    starting_time: SimpleNamespace
    duration: SimpleNamespace
    message_count: int
    topics_with_message_count: list[TopicInformation]


def to_rclcpp_qos_vector(serialized: str, version: int) -> list[dict]:
    profiles = yaml.safe_load(serialized)
    if version >= 9 and any(isinstance(each["durability"], int) for each in profiles):
        raise RuntimeError("yaml-cpp: bad conversion")
    return profiles


class SequentialReader:
    def open(self, options: StorageOptions, _: ConverterOptions) -> None:
        if options.storage_id != "mcap" or not Path(options.uri).is_file():
            raise RuntimeError(_NO_STORAGE)
        self._path, self._rows = Path(options.uri), None
        try:
            with self._path.open("rb") as file:
                self._summary = make_reader(file).get_summary()
        except (McapError, ValueError) as error:
            raise RuntimeError(f"{_NO_STORAGE}\n{error}") from None
        if self._summary is None:
            raise RuntimeError(_NO_STORAGE)
        self._topics: list[str] = []

    def get_metadata(self) -> BagMetadata:
        counts = self._summary.statistics.channel_message_counts
        first, last = (
            getattr(self._summary.statistics, f"message_{end}_time") for end in ("start", "end")
        )
        listed = [
            TopicInformation(topic, counts.get(topic.id, 0))
            for topic in self.get_all_topics_and_types()
        ]
        times = SimpleNamespace(nanoseconds=first), SimpleNamespace(nanoseconds=last - first)
        return BagMetadata(*times, sum(counts.values()), listed)

    def get_all_topics_and_types(self) -> list[TopicMetadata]:
        return [
            TopicMetadata(
                channel.id,
                channel.topic,
                self._summary.schemas[channel.schema_id].name,
                channel.message_encoding,
            )
            for channel in self._summary.channels.values()
        ]

    def set_filter(self, storage_filter: StorageFilter) -> None:
        self._topics, self._rows = storage_filter.topics, None

    def _next_rows(self):
        with self._path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages(self._topics or None):
                yield channel.topic, message.data, message.log_time

    def has_next(self) -> bool:
        if self._rows is None:
            self._rows, self._row = self._next_rows(), None
            self._advance()
        return self._row is not None

    def read_next(self) -> tuple[str, bytes, int]:
        if not self.has_next():
            raise RuntimeError("Bag is at end. No next message.")
        row = self._row
        self._advance()
        return row

    def _advance(self) -> None:
        try:
            self._row = next(self._rows, None)
        except (McapError, ValueError) as error:
            raise RuntimeError(str(error)) from None


class SequentialWriter:
    def open(self, options: StorageOptions, _: ConverterOptions) -> None:
        self._folder = Path(options.uri)
        if self._folder.exists():
            raise RuntimeError(f"Database directory already exists ({options.uri})")
        if options.storage_preset_profile not in _PROFILES:
            raise RuntimeError("unknown MCAP storage preset profile")
        try:
            self._folder.mkdir(parents=True)
        except OSError as error:
            raise RuntimeError(f"Failed to create database directory ({options.uri}).") from error
        self._file = (self._folder / f"{self._folder.name}_0.mcap").open("wb")
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start("ros2", "libmcap 1.3.1")
        self._channels: dict[str, int] = {}

    def create_topic(self, topic: TopicMetadata) -> None:
        schema = self._writer.register_schema(topic.type, "ros2msg", b"# by rosbag2")
        profiles = yaml.safe_dump(topic.offered_qos_profiles)
        self._channels[topic.name] = self._writer.register_channel(
            topic.name, topic.serialization_format, schema, {"offered_qos_profiles": profiles}
        )

    def write(self, topic_name: str, message: bytes, time_stamp: int) -> None:
        if topic_name not in self._channels:
            raise RuntimeError(f"Failed to write on topic '{topic_name}'")
        self._writer.add_message(self._channels[topic_name], time_stamp, message, time_stamp)

    def close(self) -> None:
        self._writer.finish()
        self._file.close()
        (self._folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 9}\n")
