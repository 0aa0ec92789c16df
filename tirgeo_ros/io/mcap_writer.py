"""Writes MCAP files: chunks under zstd, with their indexes, a summary and checksums.

Records are those of the mcap package, and so are the bytes that its own writer makes of the same
calls. That one makes an object of every message and packs it field by field, which is felt at
hundreds of messages for each second of a flight; here a message is packed at once.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import IO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from tirgeo_ros.io.mcap_contents import MAGIC

_CHUNK_SIZE = 1 << 20  # bytes before compression; the message that passes it is the last
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_BEHIND_LENGTH = _MESSAGE.size - 9
_FOOTER_START = struct.Struct("<BQQQ")  # of a footer what its checksum covers
_MESSAGE_OPCODE = int(Opcode.MESSAGE)


class McapWriter:
    """Writes schemas, channels and messages to a stream, which it does not close."""

    def __init__(self, stream: IO[bytes], profile: str, library: str) -> None:
        self._stream = stream
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._counts: Counter[int] = Counter()  # messages by channel
        self._open: list[bytes] = []  # what the open chunk is made of
        self._size = 0  # of that, in bytes
        self._places: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)
        stream.write(MAGIC + _packed(Header(profile, library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema and return its number."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._append(_packed(schema))
        return len(self._schemas)

    def register_channel(self, topic: str, encoding: str, schema: int) -> int:
        """Add a channel for messages of a schema and return its number."""
        number = len(self._channels) + 1
        channel = Channel(
            id=number, topic=topic, message_encoding=encoding, schema_id=schema, metadata={}
        )
        self._channels.append(channel)
        self._append(_packed(channel))
        return number

    def add_message(self, channel: int, log_time: int, data: bytes, publish_time: int) -> None:
        """Add a message to a channel; times in nanoseconds."""
        length = _BEHIND_LENGTH + len(data)
        head = _MESSAGE.pack(_MESSAGE_OPCODE, length, channel, 0, log_time, publish_time)
        self._places[channel].append((log_time, self._size))
        self._append(head + data)

    def finish(self) -> None:
        """Write what is still open, and the summary."""
        self._end_chunk()
        self._stream.write(_packed(DataEnd(0)))
        start = self._stream.tell()
        groups: dict[Opcode, Sequence[McapRecord]] = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [self._statistics()],
            Opcode.CHUNK_INDEX: self._chunks,
            Opcode.ATTACHMENT_INDEX: [],  # none, and said to be none
            Opcode.METADATA_INDEX: [],
        }
        summary, offsets = b"", b""
        for opcode, records in groups.items():
            group = b"".join(map(_packed, records))
            offsets += _packed(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        self._stream.write(summary + offsets)
        self._stream.write(_footer(summary + offsets, start, start + len(summary)) + MAGIC)

    def _append(self, data: bytes) -> None:
        self._open.append(data)
        self._size += len(data)
        if self._size > _CHUNK_SIZE:
            self._end_chunk()

    def _end_chunk(self) -> None:
        if not self._places:
            return  # schemas and channels alone wait for a message
        data = b"".join(self._open)
        times = [time for places in self._places.values() for time, _ in places]
        packed = zstandard.compress(data)
        chunk = Chunk("zstd", packed, max(times), min(times), zlib.crc32(data), len(data))
        start = self._stream.tell()
        length = self._stream.write(_packed(chunk))
        offsets, indexes = {}, b""
        for channel, places in self._places.items():
            offsets[channel] = start + length + len(indexes)
            indexes += _packed(MessageIndex(channel, places))
            self._counts[channel] += len(places)
        self._stream.write(indexes)
        self._chunks.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=start,
                compression=chunk.compression,
                compressed_size=len(packed),
                message_end_time=chunk.message_end_time,
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=chunk.message_start_time,
                uncompressed_size=chunk.uncompressed_size,
            )
        )
        self._open, self._size = [], 0
        self._places.clear()

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self._counts.total(),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            message_start_time=min(
                (chunk.message_start_time for chunk in self._chunks), default=0
            ),
            metadata_count=0,
            schema_count=len(self._schemas),
        )


def _packed(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _footer(summary: bytes, start: int, offsets_start: int) -> bytes:
    head = _FOOTER_START.pack(Opcode.FOOTER, _FOOTER_START.size + 4 - 9, start, offsets_start)
    return _packed(Footer(start, offsets_start, zlib.crc32(head, zlib.crc32(summary))))
