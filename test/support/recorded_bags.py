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
"""Bags as ``ros2 bag record`` leaves them: folders, split, compressed, MCAP and SQLite."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import yaml
import zstandard
from mcap.writer import CompressionType, Writer

from tirgeo_ros.io.bags.bag import BagMessage, Cdr
from tirgeo_ros.io.bags.mcap_file import McapFile

# The tables of rosbag2, version 4, less the definitions of the types, which may be absent.
TABLES = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL,
    metadata TEXT NOT NULL);
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
    serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
    type_description_hash TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
    timestamp INTEGER NOT NULL, data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
"""
ENDS = {"mcap": ".mcap", "sqlite3": ".db3"}
TYPE = "std_msgs/msg/Header"
CDR = Cdr()
KIND, TIME = CDR.types(TYPE), CDR.types("builtin_interfaces/msg/Time")


def message(number, topic="/a", text="x"):
    data = CDR.serialize(KIND(stamp=TIME(sec=number, nanosec=0), frame_id=text), TYPE)
    return BagMessage(topic, TYPE, number, data)


MESSAGES = [message(number, f"/{'ab'[number % 2]}", f"{number:060}") for number in range(300)]
THIRDS = [MESSAGES[:100], MESSAGES[100:200], MESSAGES[200:]]


def segments_of(path):
    """The chunks of an MCAP file."""
    return McapFile(path, path).segments


def record(folder, parts, storage="mcap", mode="", *, metadata=True):
    """A folder with a file for each of ``parts``, lists of messages; ``mode``: file or message."""
    folder.mkdir()
    names = []
    for number, messages in enumerate(parts):
        path = folder / f"{folder.name}_{number}{ENDS[storage]}"
        pack = zstandard.compress if mode == "message" else bytes
        packed = [m._replace(data=pack(m.data)) for m in messages]
        (write_mcap if storage == "mcap" else write_sqlite)(path, packed)
        names.append((compressed(path) if mode == "file" else path).name)
    if metadata:
        write_metadata(folder, names, storage, mode)
    return folder


def write_metadata(folder, names, storage="mcap", mode="", form="zstd"):
    """What rosbag2 says of its files, as far as it is read."""
    reports = {
        "version": 9,
        "storage_identifier": storage,
        "relative_file_paths": names,
        "compression_format": form if mode else "",
        "compression_mode": mode.upper(),
    }
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": reports}))


def compressed(path):
    """The file, compressed in place of the plain one."""
    packed = path.with_name(f"{path.name}.zstd")
    packed.write_bytes(zstandard.compress(path.read_bytes()))
    path.unlink()
    return packed


def write_mcap(path, messages):
    """As the storage plugin does by default: plain chunks."""
    channels: dict[str, int] = {}
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, chunk_size=4000)
        writer.start("ros2", "another")
        for topic, typename, log_ns, data, *_ in messages:
            if topic not in channels:
                text = CDR.definition(typename).encode()
                schema = writer.register_schema(typename, "ros2msg", text)
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], log_ns, data, log_ns)
        writer.finish()


def write_sqlite(path, messages, form="cdr"):
    """A database whose definitions of types are missing."""
    with closing(sqlite3.connect(path)) as base, base:
        base.executescript(TABLES)
        insert(base, messages, form)


def insert(base, messages, form="cdr"):
    """Add topics and messages."""
    keys = {}
    for topic, typename, log_ns, data, *_ in messages:
        if topic not in keys:
            keys[topic] = len(keys) + 1
            row = (keys[topic], topic, typename, form, "", "")
            base.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)", row)
        row = (keys[topic], log_ns, data)
        base.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", row)
