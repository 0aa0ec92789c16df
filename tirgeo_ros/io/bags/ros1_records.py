"""Read the records of a ROS 1 bag (version 2.0) one after another, and skip broken ones.

A record is a header of ``name=value`` fields, then data, each preceded by its length. Source of
the layout: the ROS wiki, Bags/Format/2.0.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from enum import IntEnum
from mmap import mmap
from typing import NamedTuple

MAGIC = b"#ROSBAG V2.0\n"

_U32 = struct.Struct("<I")
_TIME = struct.Struct("<II")
_LONGEST_HEADER = 4096  # a topic's name is the longest part of any header
_OP = re.compile(rb"op=[\x02-\x07]")
_BEFORE_OP = 300  # the fields before it in a header are shorter

Bytes = bytes | mmap


class Op(IntEnum):
    """List the kinds of records."""

    MESSAGE = 2
    BAG = 3
    INDEX = 4
    CHUNK = 5
    CHUNK_INFO = 6
    CONNECTION = 7


#: Fields of each kind with their sizes in bytes (None = any).
_FIELDS: dict[int, dict[bytes, int | None]] = {
    Op.MESSAGE: {b"conn": 4, b"time": 8},
    Op.BAG: {b"index_pos": 8},
    Op.INDEX: {b"conn": 4, b"count": 4},
    Op.CHUNK: {b"compression": None, b"size": 4},
    Op.CHUNK_INFO: {b"chunk_pos": 8},
    Op.CONNECTION: {b"conn": 4, b"topic": None},
}


class Ros1Record(NamedTuple):
    """Hold a record and its position."""

    op: Op
    fields: dict[bytes, bytes]
    start: int
    offset: int  # of the data
    end: int
    cut: bool = False  # whether the data should continue behind the end

    def number(self, name: bytes) -> int:
        """Return a field of four bytes."""
        return int(_U32.unpack(self.fields[name])[0])

    def text(self, name: bytes) -> str:
        """Return a field of text."""
        return self.fields[name].decode(errors="replace")

    @property
    def time_ns(self) -> int:
        """Return when a message was recorded, in nanoseconds."""
        seconds, nanoseconds = _TIME.unpack(self.fields[b"time"])
        return int(seconds) * 1_000_000_000 + int(nanoseconds)


class Lost(NamedTuple):
    """Hold a range of bytes that are no record."""

    start: int
    end: int


def records(data: Bytes, start: int, end: int) -> Iterator[Ros1Record | Lost]:
    """Yield the records from a byte on; a record that is cut off ends at the next chunk."""
    while start < end:
        record = record_at(data, start, end)
        if record is None:
            begun, start = start, next_record(data, start + 1, end)
            yield Lost(begun, start)
            continue
        if record.end > end:
            record = record._replace(end=next_record(data, record.offset, end, Op.CHUNK), cut=True)
        yield record
        start = record.end


def record_at(data: Bytes, start: int, end: int) -> Ros1Record | None:
    """Return the record that begins at a byte; None if none does."""
    if start + 8 > end:
        return None
    (size,) = _U32.unpack_from(data, start)
    offset = start + 4 + size + 4
    if size > _LONGEST_HEADER or offset > end:
        return None
    fields = fields_of(data[start + 4 : offset - 4])
    kind = fields.get(b"op", b"") if fields else b""
    wanted = _FIELDS.get(kind[0]) if len(kind) == 1 else None
    if fields is None or wanted is None:
        return None
    for name, length in wanted.items():
        if name not in fields or length not in {None, len(fields[name])}:
            return None
    (length,) = _U32.unpack_from(data, offset - 4)
    return Ros1Record(Op(kind[0]), fields, start, offset, offset + length)


def next_record(data: Bytes, start: int, end: int, op: Op | None = None) -> int:
    """Return the offset of the next record, of kind ``op`` if given; the end if there is none."""
    for found in _OP.finditer(data, start, end):
        if op is not None and data[found.end() - 1] != op:
            continue
        for at in range(max(start, found.start() - _BEFORE_OP), found.start() - 7):
            if record_at(data, at, end) is not None:
                return at
    return end


def fields_of(header: bytes) -> dict[bytes, bytes] | None:
    """Return the fields of a header; None if it is invalid."""
    fields, at, end = {}, 0, len(header)
    while at < end:
        if at + 4 > end:
            return None
        (size,) = _U32.unpack_from(header, at)
        at += 4 + size
        name, equals, value = header[at - size : at].partition(b"=")
        if at > end or not equals:
            return None
        fields[name] = value
    return fields
