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
"""Read ROS 1 bags without ROS, through rosbags, with a bound on what a chunk unpacks to."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager, suppress
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import (
    ChunkInfo,
    Header,
    IndexData,
    RecordType,
    decompressors,
    read_uint32,
)
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.bags.bag_file import TOO_LATE, BagMessage
from tirgeo_ros.io.bags.packed import MOST_BYTES, unpacked
from tirgeo_ros.io.files.bounded_reading import bounded_memory
from tirgeo_ros.io.files.whole_files import PathLike, first_bytes
from tirgeo_ros.io.messages.cdr import UNREADABLE, Cdr

MAGIC = b"#ROSBAG V2.0\n"

#: Raised by the decoders for bytes that are not a message of the type.
_UNREADABLE = (*UNREADABLE, SerdeError)
#: Raised by the reader for a damaged file.
_DAMAGED = (*_UNREADABLE, ReaderError, OSError, KeyError, MemoryError, RuntimeError, EOFError)
#: Raised by the types' generator for an invalid definition.
_UNDEFINED = (TypesysError, SyntaxError, KeyError, ValueError, RecursionError)
#: Types of records between chunks, which only repeat what the chunks say.
_BETWEEN = (
    *(RecordType.BAGHEADER, RecordType.IDXDATA),
    *(RecordType.CHUNK_INFO, RecordType.CONNECTION),
)


class UnindexedReader(Reader):
    """Read a bag without an index up to the first incomplete record; it may have no messages.

    A last chunk that was still being written is read too, unless it is compressed. ``lost_bytes``
    counts the bytes at the end that were not read.
    """

    lost_bytes = 0

    def open(self) -> None:
        """Find the messages of the bag. Raises OSError."""
        self.bio = self.path.open("rb")
        self._size = os.fstat(self.bio.fileno()).st_size
        self._by_number: dict[int, Connection] = {}
        self._entries = defaultdict[int, list[IndexData]](list)
        self.bio.readline()
        self._read_to = self.bio.tell()
        # ValueError: a text not in UTF-8 or a damaged chunk. OSError: a position beyond the file.
        with suppress(ReaderError, ValueError, OSError):
            while self._read_to < self._size:
                self._take_record()
        self.lost_bytes = self._size - self._read_to
        # What the base class would read from an index.
        self.indexes = {key: sorted(self._entries[key]) for key in self._by_number}
        counts = {key: len(entries) for key, entries in self.indexes.items()}
        self.connections = [
            each._replace(msgcount=counts[key]) for key, each in self._by_number.items()
        ]
        times_ns = [entry.time for entries in self.indexes.values() for entry in entries]
        if times_ns:
            self.chunk_infos = [ChunkInfo(0, min(times_ns), max(times_ns) + 1, counts)]

    def _take_record(self) -> None:
        """Take one record of the file. Raises ReaderError if it is incomplete."""
        assert self.bio is not None
        header = Header.read(self.bio)
        if header.get_uint8("op") == RecordType.CHUNK:
            self._take_chunk(self._read_to, header.get_string("compression"))
            return
        if header.get_uint8("op") not in _BETWEEN:
            raise ReaderError("not a record that may stand between chunks")
        end = read_uint32(self.bio) + self.bio.tell()
        if end > self._size:
            raise ReaderError("a record is cut off")
        self._read_to = self.bio.seek(end)

    def _take_chunk(self, chunk_at: int, compression: str) -> None:
        assert self.bio is not None
        self.bio.seek(chunk_at)
        chunk = self.read_chunk()
        left = self._size - chunk.datapos
        if not 0 < chunk.datasize <= left:  # 0 while it was being written
            if compression != "none":
                raise ReaderError("a compressed chunk is cut off")
            chunk = chunk._replace(datasize=min(left, MOST_BYTES))
        self.bio.seek(chunk.datapos)
        records = unpacked(self.bio.read(chunk.datasize), compression)
        self.chunks[chunk_at] = chunk
        try:
            self._take_messages(chunk_at, records)
        except ReaderError:
            if compression == "none":
                self._read_to = chunk.datapos + self._offset
            raise
        self._read_to = chunk.datapos + chunk.datasize

    def _take_messages(self, chunk_at: int, records: bytes) -> None:
        """Take the records of a chunk. Raises ReaderError at an incomplete one."""
        source, self._offset = BytesIO(records), 0
        while self._offset < len(records):
            header = Header.read(source)
            end = read_uint32(source) + source.tell()
            if end > len(records):
                raise ReaderError("a record is cut off")
            key = header.get_uint32("conn")
            if header.get_uint8("op") == RecordType.MSGDATA:
                entry = IndexData(header.get_time("time"), chunk_at, self._offset)
                self._entries[key].append(entry)
            elif key not in self._by_number:
                # The base class reads a connection's record from its file.
                file, self.bio = self.bio, BytesIO(records[self._offset : end])
                try:
                    self._by_number[key] = self.read_connection()
                finally:
                    self.bio = file
            self._offset = source.seek(end)


class Ros1Bag:
    """Read a bag.

    A bag without an index (it was cut off or never closed) is read up to the cut; ``damage`` then
    describes what is lost. Raises BagError if the file is absent, damaged in another way, not a
    ROS 1 bag of version 2.0, encrypted, or without messages.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)
        self._losses: dict[str, str] = {}
        self._stores: dict[tuple[str, str], Typestore | None] = {}
        with bounded_memory(), self._opened() as reader:
            self._connections = list(reader.connections)
            if not reader.message_count:
                raise BagError(f"{self.path}: the bag has no message")
            #: Record times of the first and of the last message.
            self.span_ns = reader.start_time, reader.end_time - 1

    @contextmanager
    def _opened(self) -> Iterator[Reader]:
        try:
            with self.path.open("rb") as file:
                if file.read(len(MAGIC)) != MAGIC:
                    raise BagError(f"{self.path}: not a ROS 1 bag of version 2.0")
            with closing(self._reader()) as reader:
                names = {function: name for name, function in decompressors.items()}
                for place, chunk in reader.chunks.items():
                    unpack = partial(_unpacked, names[chunk.decompressor])
                    reader.chunks[place] = chunk._replace(decompressor=unpack)
                yield reader
        except FileNotFoundError as error:
            raise BagError(f"{self.path}: cannot be read: {error.strerror}") from None
        except _DAMAGED as error:
            raise BagError(
                f"{self.path}: cannot be read: {error or type(error).__name__}; try rosbag fix or "
                "rosbag reindex of ROS 1"
            ) from None

    def _reader(self) -> Reader:
        """Return an open reader: it uses the index, or the chunks if there is no index."""
        reader = Reader(self.path)
        try:
            reader.open()
        except _DAMAGED:
            reader = UnindexedReader(self.path)
            reader.open()
            if not reader.message_count:
                reader.close()
                raise
            self._losses["index"] = (
                f"no usable index: the file was cut off or not closed; {reader.message_count} "
                f"messages were found, {reader.lost_bytes} bytes at the end are not readable"
            )
        return reader

    @property
    def damage(self) -> str | None:
        """Return in one line what could not be read, None if nothing was lost."""
        return "; ".join(self._losses.values()) or None

    def topics(self) -> dict[str, str]:
        """Return every topic with the name of its type, or of its types, with commas."""
        by_topic: dict[str, set[str]] = {}
        for connection in self._connections:
            by_topic.setdefault(connection.topic, set()).add(connection.msgtype)
        return {topic: ", ".join(sorted(types)) for topic, types in sorted(by_topic.items())}

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Return the messages of these topics in the order in which they were recorded."""
        with self._opened() as reader:
            chosen = [c for c in reader.connections if topics is None or c.topic in topics]
            if not chosen:  # the reader takes an empty list as all connections
                return
            late = 0
            for connection, record_ns, data in reader.messages(chosen):
                if record_ns >= LAST_NS:
                    late += 1
                    self._losses["late"] = f"{late} {TOO_LATE}"
                    continue
                yield BagMessage(
                    connection.topic, connection.msgtype, record_ns, data, connection.msgdef.data
                )

    def cdr(self, message: Any) -> bytes:
        """Convert a message to CDR of ROS 2. Raises MessageError for bytes of another type."""
        if message.typename not in Cdr():
            raise BagError(f"message type {message.typename} is not known")
        try:
            return bytes(_ros2_types().ros1_to_cdr(message.data, message.typename))
        except _UNREADABLE as error:
            raise _not_of_type(message, error) from None

    def decoded(self, message: BagMessage) -> Any:
        """Decode the message by its definition in the bag. Raises MessageError."""
        # A store for each type's definition: two wrappers may use one name for different types.
        key = message.typename, message.definition
        if key not in self._stores:
            self._stores[key] = None
            with suppress(*_UNDEFINED):
                types = get_typestore(Stores.EMPTY)
                types.register(get_types_from_msg(message.definition, message.typename))
                types.get_msgdef(message.typename)
                self._stores[key] = types
        store = self._stores[key]
        if store is None:
            raise MessageError(f"{message.topic}: the bag does not define {message.typename}")
        try:
            return store.deserialize_ros1(message.data, message.typename)
        except _UNREADABLE as error:
            raise _not_of_type(message, error) from None


@cache
def _ros2_types() -> Typestore:
    """Return the types that messages are converted to: it takes 0.25 s to build them."""
    return get_typestore(Stores.ROS2_JAZZY)


def _not_of_type(message: BagMessage, error: Exception) -> MessageError:
    size = f"{len(message.data)} bytes"
    return MessageError(f"{message.topic}: {size} are no {message.typename} of ROS 1: {error}")


def any_bag(path: Path) -> BagReader | Ros1Bag:
    """Open a bag of ROS 1 or ROS 2, by the file's first bytes. Raises BagError if unreadable."""
    if path.is_file() and first_bytes(path, len(MAGIC), BagError) == MAGIC:
        return Ros1Bag(path)
    return BagReader(path)


def _unpacked(compression: str, packed: bytes) -> bytes:
    try:
        return unpacked(packed, compression)
    except ValueError as error:
        raise ReaderError(f"a chunk {error}") from None
