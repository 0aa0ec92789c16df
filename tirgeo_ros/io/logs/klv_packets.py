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
key: a lost piece of a stream costs no packet but its own. Other bytes between packets, such as the
heads of metadata's access unit cells (ISO 13818-1, 2.12.4), are passed over.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TypeAlias

from tirgeo_ros.io.logs.log_contents import LogContents, Refused, must
from tirgeo_ros.io.video.frame_metadata import CHECKSUM, KEY, checksum

Items: TypeAlias = dict[int, bytes]

#: The beginning of every key of SMPTE.
PREFIX = KEY[:4]
PACKET = "packet"
#: Limits a false length. A packet has some hundred bytes, with moving targets some thousand.
_MOST_BYTES = 1 << 16
_IMPOSSIBLE = "its length is impossible"
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
        while (begin := buffer.find(PREFIX, at)) >= 0:
            name, at = PACKET, begin + len(PREFIX)
            try:
                content, end = _content(buffer, begin + len(KEY))
                key = buffer[begin : begin + len(KEY)]
                name = PACKET if key == KEY else _OTHERS.get(key[8:14], "set of another key")
                self._read[name] += 1
                if name != PACKET or self._spare < len(content):
                    at = end
                must(name == PACKET, "only ST 0601 is read")
                self._spare -= len(content)
                items = _checked_items(content, buffer[begin:end])
            except _CutOff:
                if not last:
                    break
                self._refused[PACKET, "cut off"] += 1
            except Refused as error:
                self._refused[name, str(error)] += 1
            else:
                yield items, self._held_s if begin < before else time_s
                self._spare, at = self._spare + len(content), end
        if begin < 0:
            begin = len(buffer) - next(n for n in (3, 2, 1, 0) if buffer.endswith(PREFIX[:n]))
        self._held_s, self._held = self._held_s if begin < before else time_s, buffer[begin:]


def _checked_items(content: bytes, packet: bytes) -> Items:
    """Return a packet's items; raise Refused if they do not fill it or its sum is wrong."""
    try:
        items = dict(_items(content))
    except _CutOff:
        raise Refused("an item runs over its end") from None
    of_sum = bytes((CHECKSUM, 2)) + checksum(packet[:-2]).to_bytes(2, "big")
    must(CHECKSUM not in items or packet.endswith(of_sum), "wrong checksum")
    return items


def _items(content: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(content):
        tag, byte = 0, 0x80
        while byte >= 0x80:  # seven bits a byte
            (byte,), at = _piece(content, at, 1)
            tag = tag << 7 | byte & 0x7F
        value, at = _content(content, at)
        yield tag, value


def _content(data: bytes, at: int) -> tuple[bytes, int]:
    """Return what a length in BER at ``at`` is of, and where that ends."""
    (length,), at = _piece(data, at, 1)
    if length >= 0x80:
        must(0x80 < length <= 0x88, _IMPOSSIBLE)
        number, at = _piece(data, at, length - 0x80)
        length = int.from_bytes(number, "big")
    must(length <= _MOST_BYTES, _IMPOSSIBLE)
    return _piece(data, at, length)


def _piece(data: bytes, at: int, size: int) -> tuple[bytes, int]:
    """Return bytes from ``at`` on, and where they end; raise _CutOff if data end before."""
    if at + size > len(data):
        raise _CutOff
    return data[at : at + size], at + size
