"""Find the messages of a ROS 1 bag, also of one that was cut off or never closed.

Chunks contain messages and descriptions of connections. An index follows each chunk, and another
is at the end of the file; a recorder that was killed did not write it. The records are therefore
walked whether there is an index or not: valid ones are used, broken ones are skipped and noted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from mmap import mmap
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.ros1_records import (
    MAGIC,
    Bytes,
    Lost,
    Op,
    Ros1Record,
    fields_of,
    record_at,
    records,
)
from tirgeo_ros.io.files.bounded_unpacking import unpacked
from tirgeo_ros.io.files.mapped_file import part_of_file


class Connection(NamedTuple):
    """Hold the topic and type of a connection."""

    topic: str
    typename: str  # as in ROS 2: sensor_msgs/msg/Imu
    definition: str  # the text of the type's definition, with all parts


class RawMessage(NamedTuple):
    """Hold a message of a chunk."""

    record_ns: int
    connection: int
    data: bytes


@dataclass(slots=True)
class Chunk:
    """Hold a part of a file that contains messages."""

    offset: int  # of its data in the file
    length: int
    compression: str
    size: int | None  # of its data when unpacked; None = it was not closed
    start_ns: int | None = None  # record time of the first message, where known
    end_ns: int | None = None
    connections: set[int] = field(default_factory=set)
    indexed: int = 0  # number of messages in its index

    def reach(self, start_ns: int, end_ns: int) -> None:
        """Extend the time span to these times of messages."""
        self.start_ns = start_ns if self.start_ns is None else min(self.start_ns, start_ns)
        self.end_ns = end_ns if self.end_ns is None else max(self.end_ns, end_ns)


@dataclass(slots=True)
class Ros1Contents:
    """Hold a file's chunks in the order of their times, its connections, and its faults."""

    chunks: list[Chunk] = field(default_factory=list)
    connections: dict[int, Connection] = field(default_factory=dict)
    losses: dict[int, str] = field(default_factory=dict)  # byte offset -> what is lost there

    def messages(self, data: mmap, chunk: Chunk) -> Iterator[RawMessage]:
        """Yield the messages in a chunk; add the connections that are described in it."""
        packed = part_of_file(data, chunk.offset, chunk.length)
        inside, fault = unpacked(packed, chunk.compression, chunk.size)
        if fault:
            self.lose(chunk, fault)
        number = 0
        for record in records(inside, 0, len(inside)):
            if isinstance(record, Lost) or record.cut:
                self.lose(chunk, "is cut off or damaged")
            elif record.op == Op.CONNECTION:
                self.connect(inside, record)
            elif record.op == Op.MESSAGE:
                body = inside[record.offset : record.end]
                number += 1
                yield RawMessage(record.time_ns, record.number(b"conn"), body)
        if number < chunk.indexed:
            self.lose(chunk, "is damaged")

    def connect(self, data: Bytes, record: Ros1Record) -> None:
        """Add the description of a connection."""
        described = fields_of(data[record.offset : record.end])
        if not described or b"type" not in described:
            return  # its messages then have no known topic, which is noted
        package, _, name = described[b"type"].decode(errors="replace").rpartition("/")
        topic = record.text(b"topic")
        parts = (part for part in topic.split("/") if part)
        connection = Connection(
            "/" * topic.startswith("/") + "/".join(parts),
            f"{package.removesuffix('/msg')}/msg/{name}",
            described.get(b"message_definition", b"").decode(errors="replace"),
        )
        self.connections.setdefault(record.number(b"conn"), connection)

    def lose(self, chunk: Chunk, what: str) -> None:
        """Record what is wrong with a chunk."""
        self.losses.setdefault(chunk.offset, f"the chunk at byte {chunk.offset} {what}")


def contents_of(data: mmap, name: str) -> Ros1Contents:
    """Return the contents of a file that begins with the magic.

    Raises BagError naming ``name`` if it is encrypted.
    """
    found, indexed = Ros1Contents(), False
    for record in records(data, len(MAGIC), len(data)):
        if isinstance(record, Lost):
            found.losses[record.start] = (
                f"the bytes from {record.start} to {record.end} are not readable"
            )
        elif record.op == Op.BAG:
            indexed = _is_indexed(data, record, name)
        else:
            _take(found, data, record)
            if found.chunks and found.chunks[-1].size is None:
                break  # up to the end of the file: what looks like records in it is packed data
            if record.cut and record.op != Op.CHUNK:
                found.losses[record.start] = f"the record at byte {record.start} is cut off"
    if not indexed:
        found.losses[len(data)] = "no index at the end: it is cut off, or was not closed"
    _complete(found, data)
    return found


def _is_indexed(data: mmap, record: Ros1Record, name: str) -> bool:
    if record.fields.get(b"encryptor"):
        raise BagError(f"{name}: the bag is encrypted; decrypt it with ROS 1's rosbag")
    at = int.from_bytes(record.fields[b"index_pos"], "little")
    return at == len(data) or (0 < at < len(data) and record_at(data, at, len(data)) is not None)


def _take(found: Ros1Contents, data: mmap, record: Ros1Record) -> None:
    """Add a record to the contents; others than these kinds are not needed."""
    if record.op == Op.CHUNK:
        compression, size = record.text(b"compression"), record.number(b"size")
        chunk = Chunk(record.offset, record.end - record.offset, compression, size)
        if not chunk.length and not size and compression != "none":
            chunk.length, chunk.size = len(data) - record.offset, None  # it was not closed
        if record.cut:
            found.lose(chunk, "is cut off or damaged")
        found.chunks.append(chunk)
    elif record.op == Op.INDEX:
        _add_times(found, data, record)
    elif record.op == Op.MESSAGE:  # outside chunks: in one that was not closed at the end
        length = record.end - record.start
        found.chunks.append(Chunk(record.start, length, "none", length))
    elif record.op == Op.CONNECTION:
        found.connect(data, record)


def _add_times(found: Ros1Contents, data: mmap, record: Ros1Record) -> None:
    """Add the index of the chunk before it: seconds, nanoseconds, offset of each message."""
    whole = (record.end - record.offset) // 12 * 12
    entries = np.frombuffer(data[record.offset : record.offset + whole], "<u4").reshape(-1, 3)
    if found.chunks and len(entries):
        times_ns = entries[:, 0].astype(np.int64) * 1_000_000_000 + entries[:, 1]
        chunk = found.chunks[-1]
        chunk.reach(int(times_ns.min()), int(times_ns.max()))
        chunk.connections.add(record.number(b"conn"))
        chunk.indexed += len(entries)


def _complete(found: Ros1Contents, data: mmap) -> None:
    """Read the chunks without an index, and sort all by time."""
    for chunk in found.chunks:
        if chunk.start_ns is None or not chunk.connections <= found.connections.keys():
            for message in found.messages(data, chunk):
                chunk.reach(message.record_ns, message.record_ns)
                chunk.connections.add(message.connection)
    found.chunks = [chunk for chunk in found.chunks if chunk.start_ns is not None]
    found.chunks.sort(key=lambda chunk: (chunk.start_ns, chunk.offset))
