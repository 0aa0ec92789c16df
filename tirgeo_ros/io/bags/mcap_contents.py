"""Find the messages of an MCAP file, also of one that is cut off or damaged.

A whole file lists them in its summary. Any other is walked from its first record to the first that
is broken. A last chunk that is cut off is read up to the cut; broken chunks are left out.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from mmap import ACCESS_READ, MADV_DONTNEED, mmap
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Header, Schema, Statistics
from mcap.stream_reader import StreamReader

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.bags.storage import TOO_LATE
from tirgeo_ros.io.files.bounded_unpacking import unpacked

MAGIC = b"\x89MCAP0\r\n"

_RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_FOOTER_SIZE = _RECORD.size + 20
_LOOSE_SIZE = 1 << 20  # messages outside chunks are grouped up to this size
_PRIVATE = 0x80  # opcodes from here on belong to applications and are skipped

# Raised by the parsers for bytes that are no such record.
_BROKEN = (
    McapError,
    RuntimeError,
    struct.error,
    ValueError,
    MemoryError,
    OverflowError,
)

#: channel, log time (ns), data
RawMessage = tuple[int, int, bytes]


@dataclass(frozen=True, slots=True)
class Segment:
    """Hold a range of a file that contains messages: a chunk, or loose messages."""

    start_ns: int  # log time of the first message
    end_ns: int
    offset: int
    length: int
    channels: frozenset[int] | None = None  # those in it, where known


@dataclass(slots=True)
class McapContents:
    """Hold segments, channels and schemas of a file, and its faults."""

    segments: list[Segment] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    empty: set[int] = field(default_factory=set)  # channels that are known to have no message
    losses: dict[int, str] = field(default_factory=dict)  # byte offset -> what is lost there

    def add(self, opcode: int, body: bytes) -> None:
        """Add a schema or a channel."""
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(ReadDataStream(BytesIO(body)))
            self.schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(ReadDataStream(BytesIO(body)))
            self.channels.setdefault(channel.id, channel)


def header_of(data: mmap) -> Header | None:
    """Return the file's header; None if it is broken."""
    try:
        opcode, length = _RECORD.unpack_from(data, len(MAGIC))
        begin = len(MAGIC) + _RECORD.size
        body = data[begin : begin + length] if opcode == Opcode.HEADER else b""
        header: Header = Header.read(ReadDataStream(BytesIO(body)))
    except _BROKEN:
        return None
    return header


def contents_of(data: mmap) -> McapContents:
    """Return the contents of a file that begins with the magic."""
    try:
        found = _summary(data)
    except _BROKEN as error:
        walked = _walked(data)
        walked.losses.setdefault(len(data), f"no usable index at the end ({_reason(error)})")
        return walked
    return found or _walked(data)


def _summary(data: mmap) -> McapContents | None:
    """Return the contents by the summary; None if an intact file has no index."""
    footer = _footer(data)
    if not footer.summary_start:
        return None
    summary = data[footer.summary_start :]
    covered = len(summary) - len(MAGIC) - 4
    if footer.summary_crc and zlib.crc32(summary[:covered]) != footer.summary_crc:
        raise McapError("checksum of the index is wrong")
    found, numbers = McapContents(), {}
    for record in StreamReader(BytesIO(summary), skip_magic=True, emit_chunks=True).records:
        if isinstance(record, Schema):
            found.schemas[record.id] = record
        elif isinstance(record, Channel):
            found.channels[record.id] = record
        elif isinstance(record, Statistics):
            numbers = record.channel_message_counts
        elif isinstance(record, ChunkIndex):
            start_ns, end_ns = record.message_start_time, record.message_end_time
            channels = frozenset(record.message_index_offsets) or None
            place = record.chunk_start_offset, record.chunk_length
            if _record_at(data, place[0])[0] == Opcode.CHUNK:
                found.segments.append(Segment(start_ns, end_ns, *place, channels))
            else:
                found.losses[place[0]] = "{1} bytes from byte {0} are not readable".format(*place)
    late = [one for one in found.segments if one.end_ns >= LAST_NS]
    found.segments = [one for one in found.segments if one.end_ns < LAST_NS]
    for one in late:
        _add_segment(found, data, one.offset, one.length)
    found.empty = {key for key in found.channels if numbers and not numbers.get(key)}
    return found if found.segments and found.channels else None


def _footer(data: mmap) -> Footer:
    at = len(data) - len(MAGIC) - _FOOTER_SIZE
    if at < len(MAGIC) or data[-len(MAGIC) :] != MAGIC:
        raise McapError("the file ends early")
    opcode, length = _RECORD.unpack_from(data, at)
    if opcode != Opcode.FOOTER or length != _FOOTER_SIZE - _RECORD.size:
        raise McapError("no footer")
    footer: Footer = Footer.read(ReadDataStream(BytesIO(data[at + _RECORD.size :])))
    return footer


def _walked(data: mmap) -> McapContents:
    """Return the contents by walking the records, from the first one to the first broken one."""
    found = McapContents()
    at = start = len(MAGIC)
    while at < len(data):
        opcode, end = _record_at(data, at)
        if opcode == Opcode.DATA_END:
            break
        if opcode == Opcode.CHUNK and end > len(data):
            at = len(data)  # the last one, cut off: its beginning can be read
            break
        if opcode is None or end > len(data):
            found.losses[at] = f"{len(data) - at} bytes from byte {at} are not readable"
            break
        at = end
        if opcode == Opcode.CHUNK or at - start > _LOOSE_SIZE:
            _add_segment(found, data, start, at - start)
            start = at
    _add_segment(found, data, start, at - start)
    return found


def _add_segment(found: McapContents, data: mmap, offset: int, length: int) -> None:
    times_ns = [log_time_ns for _, log_time_ns, _ in read_segment(data, offset, length, found)]
    if times_ns:
        found.segments.append(Segment(min(times_ns), max(times_ns), offset, length))


def _record_at(data: mmap | bytes, at: int) -> tuple[int | None, int]:
    """Return opcode (None: no valid record) and end of the record at an offset."""
    if at + _RECORD.size > len(data):
        return None, len(data)
    opcode, length = _RECORD.unpack_from(data, at)
    known = Opcode.HEADER <= opcode <= Opcode.DATA_END or opcode >= _PRIVATE
    return (opcode if known else None), at + _RECORD.size + length


def read_segment(
    data: mmap, offset: int, length: int, found: McapContents
) -> Iterator[RawMessage]:
    """Yield the messages in a range of records; add broken places to ``found.losses``."""
    part = part_of_file(data, offset, length)
    at = 0
    while at < len(part):
        opcode, end = _record_at(part, at)
        body, place = part[at + _RECORD.size : end], offset + at
        cut = end > len(part)
        if opcode == Opcode.CHUNK:
            inside = _unpacked(body, place, found, cut=cut)
            yield from _messages(inside, place, found)
        elif opcode is None or cut:
            found.losses[place] = f"{len(part) - at} bytes from byte {place} are not readable"
            return
        elif opcode in {Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL}:
            yield from _messages(part[at:end], place, found)
        at = end


def _unpacked(body: bytes, offset: int, found: McapContents, *, cut: bool) -> bytes:
    """Return the records in a chunk; of one cut off those up to the cut, of a broken one none."""
    if cut:
        found.losses[offset] = f"the chunk at byte {offset} is cut off"
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(body)))
        inside = unpacked(chunk.data, chunk.compression, chunk.uncompressed_size, cut=cut)
        if not cut and chunk.uncompressed_crc not in {0, zlib.crc32(inside)}:
            raise ValueError("is damaged (its checksum is wrong)")
    except _BROKEN as error:
        found.losses[offset] = f"the chunk at byte {offset} {_reason(error)}"
        return b""
    return inside


def _messages(records: bytes, offset: int, found: McapContents) -> Iterator[RawMessage]:
    """Yield the messages among records; add schemas and channels on the way."""
    at, end, late = 0, len(records), 0
    while at + _RECORD.size <= end:
        opcode, length = _RECORD.unpack_from(records, at)
        at += _RECORD.size
        if at + length > end or not opcode:
            found.losses.setdefault(offset, f"the record at byte {offset} is cut off")
            return
        if opcode == Opcode.MESSAGE and length >= _MESSAGE.size:
            channel, _, log_time, _ = _MESSAGE.unpack_from(records, at)
            if log_time >= LAST_NS:
                late += 1
                found.losses[offset] = f"{late} {TOO_LATE} at byte {offset}"
            elif channel in found.channels:
                yield channel, log_time, records[at + _MESSAGE.size : at + length]
            else:
                found.losses[offset] = f"messages at byte {offset} belong to no known topic"
        elif opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
            try:
                found.add(opcode, records[at : at + length])
            except _BROKEN:
                found.losses[offset] = f"a topic's record at byte {offset} is damaged"
        at += length


def _reason(error: BaseException) -> str:
    lines = str(error).splitlines()
    return lines[0] if lines else type(error).__name__


@contextmanager
def mapped(path: Path, name: Path) -> Iterator[mmap]:
    """Yield the bytes of a file. Raises BagError for ``name`` if it is empty or unreadable."""
    try:
        with path.open("rb") as file:
            if not os.fstat(file.fileno()).st_size:
                raise BagError(f"{name}: the file is empty")
            with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
                yield data
    except OSError as error:
        raise BagError(f"{name}: cannot be read: {error.strerror or error}") from None


def part_of_file(data: mmap, start: int, length: int) -> bytes:
    """Return a copy of a part, and release all pages mapped so far.

    Otherwise every page of a file that was read once counts as this process's memory until the
    file is closed.
    """
    part = data[start : start + length]
    data.madvise(MADV_DONTNEED)
    return part
