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
(SMPTE 336M). If a checksum is wrong or an item runs over the end, the search goes on behind the
key: a lost piece of a stream costs no packet but its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TypeAlias

from tirgeo_ros.io.logs.log_contents import LogContents, Refused
from tirgeo_ros.io.video.frame_metadata import CHECKSUM, KEY, checksum

Items: TypeAlias = dict[int, bytes]

#: The beginning of every key of SMPTE.
PREFIX = KEY[:4]
PACKET = "packet"
#: Limits a false length. A packet has some hundred bytes, with moving targets some thousand.
_MOST_BYTES = 1 << 16
#: Other sets in such streams, by the bytes 8 to 13 of their keys, which name them.
_OTHERS = {
    bytes.fromhex("0e0101020101"): "universal set of EG 0104, older than ST 0601",
    bytes.fromhex("0e0103030600"): "moving targets of ST 0903",
    bytes.fromhex("0e0103030200"): "security set of ST 0102",
}


class _CutOff(Exception):  # noqa: N818  more bytes may follow
    """Say that something does not end in the bytes at hand."""


class PacketReader:
    """Find packets in bytes as they come; count in ``contents`` what is read and refused."""

    def __init__(self, contents: LogContents) -> None:
        self._read, self._refused = contents.read, contents.refused
        self._held, self._held_s = b"", math.nan  # a packet's begin, and its time
        self._spare = _MOST_BYTES  # bytes that may be looked at again: hostile ones end

    def take(
        self, data: bytes, time_s: float = math.nan, *, last: bool = False
    ) -> Iterator[tuple[Items, float]]:
        """Yield the packets that these bytes complete, each with the time of its first bytes."""
        before, buffer, at = len(self._held), self._held + data, 0
        self._spare += len(data)
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
                    yield items, self._held_s if at < before else time_s
                at = end
        if at < 0:
            at = len(buffer) - next(n for n in (3, 2, 1, 0) if buffer.endswith(PREFIX[:n]))
        self._held_s, self._held = self._held_s if at < before else time_s, buffer[at:]

    def _packet(self, buffer: bytes, at: int) -> tuple[Items | None, int]:
        """Return the items of the packet at ``at`` (None: not usable), and where to go on."""
        key = buffer[at : at + len(KEY)]
        length, begin = _length(buffer, at + len(KEY))
        end = begin + length
        if length > _MOST_BYTES:
            raise Refused("its length is impossible")
        if end > len(buffer):
            raise _CutOff
        if key == KEY:
            self._read[PACKET] += 1
            try:
                return _checked_items(buffer[at:end], begin - at), end
            except Refused as error:
                self._refused[PACKET, str(error)] += 1
            if self._spare < length:
                return None, end
            self._spare -= length
            return None, at + len(PREFIX)
        name = _OTHERS.get(key[8:14], "set of another key")
        self._read[name] += 1
        self._refused[name, "only ST 0601 is read"] += 1
        return None, end


def without_cell_heads(data: bytes) -> bytes:
    """Return the content of metadata's access unit cells (ISO 13818-1, 2.12.4); else the bytes.

    A cell has a head of 5 bytes, the last two of which are the length of its content.
    """
    at, content = 0, b""
    while not data.startswith(PREFIX) and at + 5 <= len(data):
        begin, at = at + 5, at + 5 + int.from_bytes(data[at + 3 : at + 5], "big")
        content += data[begin:at]
    return content if content and at == len(data) else data


def _checked_items(packet: bytes, begin: int) -> Items:
    """Return a packet's items; raise Refused if they do not fill it or its sum is wrong."""
    try:
        items = dict(_items(packet, begin))
    except _CutOff:
        raise Refused("an item runs over its end") from None
    at_end = packet[-4:-2] == bytes((CHECKSUM, 2))
    if CHECKSUM in items and not (at_end and checksum(packet[:-2]) == _number(packet[-2:])):
        raise Refused("wrong checksum")
    return items


def _items(packet: bytes, at: int) -> Iterator[tuple[int, bytes]]:
    while at < len(packet):
        tag, more = 0, True
        while more:  # seven bits a byte
            tag, more = tag << 7 | packet[at] & 0x7F, packet[at] >= 0x80
            at += 1
            if at == len(packet):
                raise _CutOff
        length, at = _length(packet, at)
        if at + length > len(packet):
            raise _CutOff
        yield tag, packet[at : at + length]
        at += length


def _length(data: bytes, at: int) -> tuple[int, int]:
    """Return a length in BER and where it ends."""
    if at >= len(data):
        raise _CutOff
    first, begin = data[at], at + 1
    if first < 0x80:
        return first, begin
    end = begin + first - 0x80
    if not begin < end <= begin + 8:
        raise Refused("its length is impossible")
    if end > len(data):
        raise _CutOff
    return _number(data[begin:end]), end


def _number(content: bytes) -> int:
    return int.from_bytes(content, "big")
