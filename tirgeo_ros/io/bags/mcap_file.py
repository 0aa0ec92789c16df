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
"""Read the messages of an MCAP file in order of time, even if it is damaged; write such files.

An intact file lists its chunks in its summary. Any other file is read from its first record to the
first broken one. A last chunk that is cut off is read up to the cut; broken chunks are left out.
"""

from __future__ import annotations

import os
import struct
import zlib
from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BytesIO
from mmap import ACCESS_READ, MADV_DONTNEED, mmap
from pathlib import Path
from typing import NamedTuple, final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Header, Metadata, Schema
from mcap.writer import CompressionType, Writer

from tirgeo_ros import __version__
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.bags.bag_file import (
    MCAP_MAGIC as MAGIC,
    TOO_LATE,
    BagFile,
    Connection,
    Row,
    TopicForm,
)
from tirgeo_ros.io.bags.packed import unpacked
from tirgeo_ros.io.files.whole_files import reading

_PROFILES = ("ros2", "")  # "": left out by a tool that copied the bag
#: A recorder that finds no definition writes one of the last two; the contract's are known here.
_SCHEMAS = ("ros2msg", "unknown", "")
#: Most bytes of messages that wait to be sorted. Chunks of a recording overlap by about a second.
_MOST_WAITING = 384 << 20
_OVERHEAD_BYTES = 600  # memory of a message in addition to its data

_RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_FOOTER_SIZE = _RECORD.size + 20
_LOOSE_SIZE = 1 << 20  # messages outside chunks are grouped up to this size
_PRIVATE = 0x80  # opcodes from here on belong to applications and are skipped

#: What rosbag2 writes when it opens a file. From the version its reader knows that the topics' QoS
#: has words, not numbers; it takes counts and times from the summary at the end of the file.
_METADATA = """\
version: 9
storage_identifier: mcap
duration:
  nanoseconds: 0
starting_time:
  nanoseconds_since_epoch: 0
message_count: 0
topics_with_message_count:
  []
compression_format: ""
compression_mode: ""
relative_file_paths:
  []
files:
  []
ros_distro: ""
custom_data: ~"""

#: Bytes of messages that are lost if the process is killed: one second without pictures.
_GROWING_CHUNK = 1 << 17
_CHUNK = 1 << 20

#: Raised by the parsers for bytes that are not a valid record.
_BROKEN = McapError, RuntimeError, struct.error, ValueError, MemoryError, OverflowError


class Segment(NamedTuple):
    """Hold a range of a file that contains messages: a chunk, or loose messages."""

    start_ns: int  # log time of the first message
    end_ns: int
    offset: int
    length: int
    channels: frozenset[int] | None = None  # with messages in it; None: not known


class McapFile(BagFile):
    """Read a file; read a cut or damaged one as far as possible.

    Raises BagError if it is absent, not MCAP or of another profile. Of an intact file only one
    chunk, and the chunks that overlap it in time, are in memory.
    """

    where = " in the chunk at byte {}"

    def __init__(self, path: Path, name: Path) -> None:
        super().__init__(path, name)
        self.segments: list[Segment] = []
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        with self._mapped() as data:
            self._check_header(data)
            silent = self._find(data)
        spans = [(segment.start_ns, segment.end_ns) for segment in self.segments]
        self.span_ns = (min(a for a, _ in spans), max(b for _, b in spans)) if spans else None
        self.connections = {}
        for key in [key for key in self._channels if key not in silent]:
            channel = self._channels[key]
            schema = self._schemas.get(channel.schema_id)
            of_type = (schema.name, schema.data, schema.encoding) if schema else ("", b"", "")
            form = TopicForm(*of_type, channel.message_encoding, channel.metadata)
            self.connections[key] = Connection(channel.topic, form)

    def fault(self, form: TopicForm) -> str:
        """Return how a topic is encoded, unless it is CDR with a ``ros2msg`` schema."""
        encoding = form.encoding if form.typename else "nothing"
        if form.message_encoding == "cdr" and encoding in _SCHEMAS:
            return ""
        return (
            f"{form.message_encoding or 'nothing'} with a schema in {encoding}; record it with "
            "ROS 2 (cdr, ros2msg)"
        )

    def rows(self, keys: Collection[int], start_ns: int) -> Iterator[Row]:
        """Yield the messages of channels from ``start_ns`` on, in order of log time."""
        waiting: list[Row] = []
        with self._mapped() as data:
            for segment in sorted(self.segments, key=lambda part: (part.start_ns, part.offset)):
                unwanted = segment.channels is not None and segment.channels.isdisjoint(keys)
                if segment.end_ns < start_ns or unwanted:
                    continue
                ready = bisect_left(waiting, (segment.start_ns,))
                yield from waiting[:ready]
                del waiting[:ready]
                size = sum(len(row[-1]) + _OVERHEAD_BYTES for row in waiting)
                place = segment.offset
                raw = self._read(data, place, segment.length)
                for number, (channel, log_ns, body) in enumerate(raw):
                    if channel not in keys or log_ns < start_ns:
                        continue
                    size += len(body) + _OVERHEAD_BYTES
                    if size > _MOST_WAITING:
                        raise BagError(
                            f"{self.name}: more than {_MOST_WAITING >> 20} MiB of messages "
                            "overlap in time; rewrite it in order of time, in chunks of a "
                            "megabyte (mcap sort)"
                        )
                    waiting.append((log_ns, place, number, channel, body))
                waiting.sort()
        yield from waiting

    def metadata(self, name: str) -> dict[str, str]:
        """Return the texts of the records of this name, up to the first record that is broken."""
        values: dict[str, str] = {}
        with self._mapped() as data, suppress(*_BROKEN):
            at = len(MAGIC)
            while at < len(data):
                opcode, end = _record_at(data, at)
                if opcode is None or opcode == Opcode.DATA_END or end > len(data):
                    break
                if opcode == Opcode.METADATA:
                    body = BytesIO(data[at + _RECORD.size : end])
                    record = Metadata.read(ReadDataStream(body))
                    values |= record.metadata if record.name == name else {}
                at = end
        return values

    # what the file holds

    def _check_header(self, data: mmap) -> None:
        if data[: len(MAGIC)] != MAGIC:
            raise BagError(
                f"{self.name}: not a ROS 2 bag; give an MCAP file, a .db3 file or a bag's folder"
            )
        opcode, end = _record_at(data, len(MAGIC))
        body = data[len(MAGIC) + _RECORD.size : end] if opcode == Opcode.HEADER else b""
        profile = ""  # also if the header is broken
        with suppress(*_BROKEN):
            profile = str(Header.read(ReadDataStream(BytesIO(body))).profile)
        if profile not in _PROFILES:
            raise BagError(
                f"{self.name}: profile {profile!r} is not 'ros2'; convert it to a ROS 2 bag"
            )

    def _find(self, data: mmap) -> set[int]:
        """Find segments, channels and schemas; return the channels known to have no message."""
        try:
            silent = self._take_summary(data)
        except _BROKEN as error:
            self._walk(data)
            self.losses.setdefault(len(data), f"no usable index at the end ({_reason(error)})")
            return set()
        if not self.segments or not self._channels:  # an intact file without an index
            self._walk(data)
            return set()
        return silent

    def _take_summary(self, data: mmap) -> set[int]:
        footer = _footer(data)
        if not footer.summary_start:
            return set()
        summary = data[footer.summary_start :]
        covered = len(summary) - len(MAGIC) - 4
        if footer.summary_crc and zlib.crc32(summary[:covered]) != footer.summary_crc:
            raise McapError("checksum of the index is wrong")
        index = SeekingReader(data).get_summary()  # type: ignore[arg-type]  # a file too
        assert index is not None
        self._schemas, self._channels = index.schemas, index.channels
        for chunk in index.chunk_indexes:
            self._take_chunk(data, chunk)
        counts = index.statistics.channel_message_counts if index.statistics else {}
        return {key for key in self._channels if counts and not counts.get(key)}

    def _take_chunk(self, data: mmap, chunk: ChunkIndex) -> None:
        at, length = chunk.chunk_start_offset, chunk.chunk_length
        if _record_at(data, at)[0] != Opcode.CHUNK:
            self.losses[at] = f"{length} bytes from byte {at} are not readable"
        elif chunk.message_end_time >= LAST_NS:  # some messages' times do not fit a stamp
            self._add_segment(data, at, length)
        else:
            span = chunk.message_start_time, chunk.message_end_time
            channels = frozenset(chunk.message_index_offsets) or None
            self.segments.append(Segment(*span, at, length, channels))

    def _walk(self, data: mmap) -> None:
        """Find the segments from the first record to the first broken one."""
        for taken in (self.segments, self._channels, self._schemas, self.losses):
            taken.clear()
        at = start = len(MAGIC)
        while at < len(data):
            opcode, end = _record_at(data, at)
            if opcode == Opcode.DATA_END:
                break
            if opcode == Opcode.CHUNK and end > len(data):
                at = len(data)  # the last chunk is cut off: its beginning can be read
                break
            if opcode is None or end > len(data):
                self.losses[at] = f"{len(data) - at} bytes from byte {at} are not readable"
                break
            at = end
            if opcode == Opcode.CHUNK or at - start > _LOOSE_SIZE:
                self._add_segment(data, start, at - start)
                start = at
        self._add_segment(data, start, at - start)

    def _add_segment(self, data: mmap, offset: int, length: int) -> None:
        times_ns = [log_time_ns for _, log_time_ns, _ in self._read(data, offset, length)]
        if times_ns:
            self.segments.append(Segment(min(times_ns), max(times_ns), offset, length))

    # records

    def _read(self, data: mmap, offset: int, length: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield channel, log time and data of the messages in a range of records."""
        part, at = data[offset : offset + length], 0
        # Otherwise each page read counts as this process's memory until the file is closed.
        data.madvise(MADV_DONTNEED)
        while at < len(part):
            opcode, end = _record_at(part, at)
            body, place = part[at + _RECORD.size : end], offset + at
            cut = end > len(part)
            if opcode == Opcode.CHUNK:
                yield from self._messages_in(self._unpacked(body, place, cut=cut), place)
            elif opcode is None or cut:
                self.losses[place] = f"{len(part) - at} bytes from byte {place} are not readable"
                return
            elif opcode in {Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL}:
                yield from self._messages_in(part[at:end], place)
            at = end

    def _unpacked(self, body: bytes, offset: int, *, cut: bool) -> bytes:
        """Return a chunk's records: up to the cut if it is cut off, none if it is broken."""
        if cut:
            self.losses[offset] = f"the chunk at byte {offset} is cut off"
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(body)))
            inside = unpacked(chunk.data, chunk.compression, chunk.uncompressed_size, cut=cut)
            if not cut and chunk.uncompressed_crc not in {0, zlib.crc32(inside)}:
                raise ValueError("is damaged (its checksum is wrong)")
        except _BROKEN as error:
            self.losses[offset] = f"the chunk at byte {offset} {_reason(error)}"
            return b""
        return inside

    def _messages_in(self, records: bytes, offset: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages among records; add schemas and channels on the way."""
        at, end, late, channels = 0, len(records), 0, self._channels
        while at + _RECORD.size <= end:
            opcode, length = _RECORD.unpack_from(records, at)
            at += _RECORD.size
            if at + length > end or not opcode:
                self.losses.setdefault(offset, f"the record at byte {offset} is cut off")
                return
            if opcode == Opcode.MESSAGE and length >= _MESSAGE.size:
                channel, _, log_time, _ = _MESSAGE.unpack_from(records, at)
                if log_time >= LAST_NS:
                    late += 1
                    self.losses[offset] = f"{late} {TOO_LATE} at byte {offset}"
                elif channel in channels:
                    yield channel, log_time, records[at + _MESSAGE.size : at + length]
                else:
                    self.losses[offset] = f"messages at byte {offset} belong to no known topic"
            elif opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
                stream = ReadDataStream(BytesIO(records[at : at + length]))
                try:  # the first record of a number counts
                    if opcode == Opcode.SCHEMA:
                        schema = Schema.read(stream)
                        self._schemas.setdefault(schema.id, schema)
                    else:
                        added = Channel.read(stream)
                        channels.setdefault(added.id, added)
                except _BROKEN:
                    self.losses[offset] = f"a topic's record at byte {offset} is damaged"
            at += length

    @contextmanager
    def _mapped(self) -> Iterator[mmap]:
        """Yield the bytes of the file. Raises BagError if it is empty or unreadable."""
        with reading(self.name, BagError), self.path.open("rb") as file:
            if not os.fstat(file.fileno()).st_size:
                raise BagError(f"{self.name}: the file is empty")
            with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
                yield data


def _footer(data: mmap) -> Footer:
    at = len(data) - len(MAGIC) - _FOOTER_SIZE
    if at < len(MAGIC) or data[-len(MAGIC) :] != MAGIC:
        raise McapError("the file ends early")
    opcode, length = _RECORD.unpack_from(data, at)
    if opcode != Opcode.FOOTER or length != _FOOTER_SIZE - _RECORD.size:
        raise McapError("no footer")
    footer: Footer = Footer.read(ReadDataStream(BytesIO(data[at + _RECORD.size :])))
    return footer


def _record_at(data: mmap | bytes, at: int) -> tuple[int | None, int]:
    """Return opcode (None: no valid record) and end of the record at an offset."""
    if at + _RECORD.size > len(data):
        return None, len(data)
    opcode, length = _RECORD.unpack_from(data, at)
    valid = Opcode.HEADER <= opcode <= Opcode.DATA_END or opcode >= _PRIVATE
    return (opcode if valid else None), at + _RECORD.size + length


def _reason(error: BaseException) -> str:
    lines = str(error).splitlines()
    return lines[0] if lines else type(error).__name__


@final
class McapSink:
    """Write a file of profile ``ros2``: CDR, with definitions in ``ros2msg``."""

    def __init__(self, path: Path, *, growing: bool) -> None:
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._file = path.open("wb")
        chunk = _GROWING_CHUNK if growing else _CHUNK
        self._writer = Writer(self._file, chunk, CompressionType.ZSTD)
        self._writer.start("ros2", f"tirgeo {__version__}")
        self._writer.add_metadata("rosbag2", {"serialized_metadata": _METADATA})

    def add_topic(self, topic: str, form: TopicForm) -> int:
        """Return the number of a new topic."""
        key = form.typename, form.definition
        if form.typename and key not in self._schemas:
            schema = form.typename, form.encoding, form.definition
            self._schemas[key] = self._writer.register_schema(*schema)
        number, metadata = self._schemas.get(key, 0), dict(form.metadata)
        return self._writer.register_channel(topic, form.message_encoding, number, metadata)

    def add(self, number: int, data: bytes, log_time_ns: int) -> None:
        """Append a message."""
        self._writer.add_message(number, log_time_ns, data, log_time_ns)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a record that is no message."""
        self._writer.add_metadata(name, dict(values))

    def flush(self) -> None:
        """Pass all messages to the operating system, except those of the newest chunk."""
        self._file.flush()

    def close(self, *, complete: bool) -> None:
        """Close the file, and write its end if it is to be complete."""
        with self._file:
            if complete:
                self._writer.finish()  # type: ignore[no-untyped-call]
