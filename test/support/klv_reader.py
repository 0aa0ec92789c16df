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
"""Read packets of MISB ST 0601 by the standard's text, with nothing of the code that writes them.

klvdata reads them too, but neither checks sums nor takes every value at a range's edge.
"""

from __future__ import annotations

from typing import NamedTuple

import av
import klvdata
from klvdata.common import packet_checksum

KEY = bytes.fromhex("060e2b34020b01010e01030101000000")

#: Tag -> (lowest, highest, bytes): unsigned, from the lowest value at 0 to the highest.
UNSIGNED = {
    5: (0, 360, 2),
    15: (-900, 19000, 2),
    16: (0, 180, 2),
    17: (0, 180, 2),
    18: (0, 360, 4),
    20: (0, 360, 4),
    21: (0, 5_000_000, 4),
    22: (0, 10_000, 2),
    25: (-900, 19000, 2),
    45: (0, 4095, 2),
    46: (0, 4095, 2),
    75: (-900, 19000, 2),
    78: (-900, 19000, 2),
}
#: Tag -> (highest, bytes): signed, symmetrical.
SIGNED = {
    6: (20, 2),
    7: (50, 2),
    13: (90, 4),
    14: (180, 4),
    19: (180, 4),
    23: (90, 4),
    24: (180, 4),
    **dict.fromkeys(range(26, 34), (0.075, 2)),
    **{tag: (180 if tag % 2 else 90, 4) for tag in range(82, 90)},
    90: (90, 4),
    91: (90, 4),
}


def step_of(tag: int) -> float:
    """The difference between two neighbouring values."""
    if tag in UNSIGNED:
        low, high, count = UNSIGNED[tag]
        return (high - low) / (256**count - 1)
    high, count = SIGNED[tag]
    return high / (128 * 256 ** (count - 1) - 1)


def number_of(tag: int, content: bytes) -> float:
    if tag in UNSIGNED:
        low, _, count = UNSIGNED[tag]
        assert len(content) == count
        return low + int.from_bytes(content, "big") * step_of(tag)
    assert len(content) == SIGNED[tag][1]
    number = int.from_bytes(content, "big", signed=True)
    assert number > -(128 * 256 ** (len(content) - 1)), f"tag {tag} says that it is an error"
    return number * step_of(tag)


def items_in(packet: bytes) -> list[tuple[int, bytes]]:
    """The items of a packet in order, after a look at key, length, checksum and order."""
    assert packet[:16] == KEY
    length, begin = length_at(packet, 16)
    assert begin + length == len(packet)
    even, odd = packet[0:-2:2], packet[1:-2:2]
    assert (sum(even) * 256 + sum(odd)) % 65536 == int.from_bytes(packet[-2:], "big")
    items = []
    while begin < len(packet):
        tag = packet[begin]
        assert tag < 128
        length, begin = length_at(packet, begin + 1)
        items.append((tag, packet[begin : begin + length]))
        begin += length
    tags = [tag for tag, _ in items]
    assert tags[0] == 2
    assert tags[-1] == 1
    assert 65 in tags
    assert len(set(tags)) == len(tags)
    return items


def length_at(data: bytes, place: int) -> tuple[int, int]:
    """A BER length and where its value begins."""
    first = data[place]
    if first < 128:
        return first, place + 1
    end = place + 1 + (first - 128)
    return int.from_bytes(data[place + 1 : end], "big"), end


def values_in(packet: bytes) -> dict[int, float]:
    """The numbers of a packet by tag; tag 2 in microseconds."""
    known = UNSIGNED.keys() | SIGNED.keys()
    items = items_in(packet)
    return {2: int.from_bytes(items[0][1], "big")} | {
        tag: number_of(tag, content) for tag, content in items if tag in known
    }


def by_klvdata(packet: bytes) -> dict[int, str]:
    """What klvdata makes of a packet, by tag: all of its items."""
    (parsed,) = klvdata.StreamParser(packet)
    assert packet_checksum(packet) == packet[-2:]
    result = {tag: words[3] for tag, words in parsed.MetadataList().items()}
    assert result.keys() == {tag for tag, _ in items_in(packet)}
    return result


class Demuxed(NamedTuple):
    """What PyAV finds in a transport stream."""

    frame_s: list[float]
    packet_s: list[float]
    packets: list[bytes]


def demuxed(path, most=None) -> Demuxed:
    """The times of frames and packets, in the file or at the address, in their order."""
    result = Demuxed([], [], [])
    with av.open(str(path)) as container:
        assert [item.type for item in container.streams] == ["video", "data"]
        for item in container.demux():
            if item.pts is None:
                continue
            if item.stream.type == "data":
                result.packet_s.append(float(item.pts * item.time_base))
                result.packets.append(bytes(item))
            else:
                result.frame_s.append(float(item.pts * item.time_base))
            if most is not None and min(len(result.frame_s), len(result.packets)) >= most:
                break
    result.frame_s.sort()
    return result


def live_packet(address: str) -> dict[int, str]:
    """Return the first packet of metadata with a frame's centre: values of klvdata by tag."""
    with av.open(f"{address}?timeout=60000000") as live:
        for part in live.demux(live.streams.data[0]):
            for packet in klvdata.StreamParser(bytes(part)):
                values = {tag: value for tag, (_, _, _, value) in packet.MetadataList().items()}
                if 23 in values:
                    return values
    raise AssertionError("the stream ended")
