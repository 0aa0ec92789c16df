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
"""Take packets of MISB ST 0601 out of bytes that may be damaged.

A packet is a key of 16 bytes, a length in BER and items: tag in BER-OID, length in BER, value
(SMPTE 336M). A packet with a wrong checksum, or with an item that runs over its end, is refused,
and the search goes on behind its key: a lost piece of a stream costs no packet but its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from tirgeo_ros.io.logs.log_contents import LogContents, Refused
from tirgeo_ros.io.video.frame_metadata import CHECKSUM, KEY, checksum

#: The beginning of every key of SMPTE.
PREFIX = KEY[:4]
PACKET = "packet"
#: Limits a false length. A packet has some hundred bytes, with moving targets some thousand.
_MOST_BYTES = 1 << 16
_LONGEST_LENGTH = 9  # bytes of a length
_LONGEST_TAG = 3  # bytes: the standard's largest tag takes two
#: Other sets in such streams, by the bytes 8 to 13 of their keys, which name them.
_OTHERS = {
    bytes.fromhex("0e0101020101"): "universal set of EG 0104, older than ST 0601",
    bytes.fromhex("0e0103030600"): "moving targets of ST 0903",
    bytes.fromhex("0e0103030200"): "security set of ST 0102",
}
_CELL_HEAD = 5


class LocalSet(NamedTuple):
    """Hold a packet: its items by tag, and its time (s; nan: none) and place in the stream."""

    items: dict[int, bytes]
    time_s: float
    position: int


class _CutOff(Exception):  # noqa: N818  more bytes may follow
    """Say that a packet does not end in the bytes at hand."""


class PacketReader:
    """Find packets in bytes as they come; count in ``contents`` what is read and refused."""

    def __init__(self, contents: LogContents) -> None:
        self._read, self._refused = contents.read, contents.refused
        self._held = b""  # begins with a packet that is not yet complete
        self._mark = math.nan, 0  # its time and place

    def take(
        self, data: bytes, time_s: float = math.nan, position: int = 0, *, last: bool = False
    ) -> Iterator[LocalSet]:
        """Yield the packets that are complete with these bytes, which have a time and a place."""
        before, buffer, at = len(self._held), self._held + data, 0

        def mark(at: int) -> tuple[float, int]:
            return self._mark if at < before else (time_s, position + at - before)

        while (at := buffer.find(PREFIX, at)) >= 0:
            try:
                items, end = self._packet(buffer, at)
            except _CutOff:  # noqa: PERF203  the next packet may be whole
                if not last:
                    break
                self._refused[PACKET, "cut off"] += 1
                at += len(PREFIX)
            except Refused as error:
                self._refused[PACKET, str(error)] += 1
                at += len(PREFIX)
            else:
                if items is not None:
                    yield LocalSet(items, *mark(at))
                at = end
        if at < 0:
            at = len(buffer) - next(n for n in (3, 2, 1, 0) if buffer.endswith(PREFIX[:n]))
        self._mark, self._held = mark(at), buffer[at:]

    def _packet(self, buffer: bytes, at: int) -> tuple[dict[int, bytes] | None, int]:
        """Return items (None for another set) and end of the packet that begins at ``at``."""
        key = buffer[at : at + len(KEY)]
        length, begin = _length(buffer, at + len(KEY))
        end = begin + length
        if length > _MOST_BYTES:
            raise Refused("its length is impossible")
        if end > len(buffer):
            raise _CutOff
        if key != KEY:
            name = _OTHERS.get(key[8:14], "set of another key")
            self._read[name] += 1
            self._refused[name, "only ST 0601 is read"] += 1
            return None, end
        self._read[PACKET] += 1
        return _checked_items(buffer[at:end], begin - at), end


def without_cell_heads(data: bytes) -> bytes:
    """Return the content of metadata's access unit cells (ISO 13818-1, 2.12.4); else the bytes.

    A cell has a head of 5 bytes, the last two of which are the length of its content.
    """
    at, parts = 0, []
    while not data.startswith(PREFIX) and at + _CELL_HEAD <= len(data):
        begin = at + _CELL_HEAD
        at = begin + int.from_bytes(data[begin - 2 : begin], "big")
        parts.append(data[begin:at])
    return b"".join(parts) if parts and at == len(data) else data


def _checked_items(packet: bytes, begin: int) -> dict[int, bytes]:
    """Return a packet's items; raise Refused if they do not fill it or its sum is wrong."""
    try:
        items = dict(_items(packet, begin))
    except _CutOff:
        raise Refused("an item runs over its end") from None
    if CHECKSUM in items:
        if packet[-4:-2] != bytes((CHECKSUM, 2)):
            raise Refused("its checksum is not at its end")
        if checksum(packet[:-2]) != int.from_bytes(packet[-2:], "big"):
            raise Refused("wrong checksum")
    return items


def _items(packet: bytes, at: int) -> Iterator[tuple[int, bytes]]:
    while at < len(packet):
        tag, at = _tag(packet, at)
        length, at = _length(packet, at)
        if at + length > len(packet):
            raise _CutOff
        yield tag, packet[at : at + length]
        at += length


def _tag(data: bytes, at: int) -> tuple[int, int]:
    """Return a tag in BER-OID, seven bits a byte, and where it ends."""
    tag = 0
    for place in range(at, min(at + _LONGEST_TAG, len(data))):
        tag = tag << 7 | data[place] & 0x7F
        if data[place] < 0x80:
            return tag, place + 1
    raise _CutOff


def _length(data: bytes, at: int) -> tuple[int, int]:
    """Return a length in BER and where it ends."""
    if at >= len(data):
        raise _CutOff
    first, begin = data[at], at + 1
    if first < 0x80:
        return first, begin
    end = begin + first - 0x80
    if not begin < end < begin + _LONGEST_LENGTH:
        raise Refused("its length is impossible")
    if end > len(data):
        raise _CutOff
    return int.from_bytes(data[begin:end], "big"), end
