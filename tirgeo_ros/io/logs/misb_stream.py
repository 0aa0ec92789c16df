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
"""Take the packets of MISB ST 0601 out of streams and bare files, which may be damaged.

A packet is a key of 16 bytes, a length in BER and items: tag in BER-OID, length in BER, value
(SMPTE 336M). A set ends where the next key is, at the latest: a lost piece costs no packet but its
own. Other bytes between packets, such as the heads of metadata's access unit cells (ISO 13818-1,
2.12.4), are passed over.
"""

from __future__ import annotations

import math
import mmap
import re
from bisect import bisect_right
from collections.abc import Iterator
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, TypeAlias

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.io.files.whole_files import reading
from tirgeo_ros.io.logs.log_contents import LogContents, Refused, must
from tirgeo_ros.io.logs.video_pictures import opened
from tirgeo_ros.io.video.frame_metadata import CHECKSUM, KEY, checksum

Items: TypeAlias = dict[int, bytes]
#: A packet's items and its time in the stream (s); nan where it has none.
Timed: TypeAlias = tuple[Items, float]

PACKET = "packet"
#: The beginning of every key of SMPTE.
PREFIX = KEY[:4]
#: Sets in such streams, by the bytes 8 to 13 of their keys, which name them.
_SETS = {
    KEY[8:14]: PACKET,
    bytes.fromhex("0e0101020101"): "universal set of EG 0104, older than ST 0601",
    bytes.fromhex("0e0103030600"): "moving targets of ST 0903",
    bytes.fromhex("0e0103030200"): "security set of ST 0102",
}
_NAMES = b"|".join(map(re.escape, _SETS))
_KEYS = re.compile(re.escape(PREFIX) + b"....(" + _NAMES + b")..", re.DOTALL)
#: Limits a false length. A packet has some hundred bytes, with moving targets some thousand.
_MOST_BYTES = 1 << 16
_SYNC, _PROGRAMME = 0x47, b"\0\0\1\xba"
#: Distance and offset of the sync bytes: in a transport stream, and with a time before each.
_TRANSPORT = ((188, 0), (192, 4))
_UNTIMED = (
    "the metadata has no times in the stream: a picture without a time stamp of its own has about "
    "the time of the metadata beside it"
)


def is_stream(head: bytes) -> bool:
    """Return whether a file's first bytes are an MPEG transport or programme stream."""
    return head.startswith(_PROGRAMME) or any(
        len(head) > first + 2 * step and {*head[first : first + 2 * step + 1 : step]} == {_SYNC}
        for step, first in _TRANSPORT
    )


def bare_packets(path: Path, contents: LogContents, time_s: float = math.nan) -> Iterator[Timed]:
    """Yield the packets of a file by their keys, whatever is between them, all with one time."""
    with (
        reading(path, LogError),
        path.open("rb") as file,
        mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data,
    ):
        for _, items in packets(data, contents):
            yield items, time_s


def stream_packets(path: Path, contents: LogContents) -> Iterator[Timed]:
    """Yield the packets of the first stream of metadata that has any; LogError without PyAV."""
    from av.error import FFmpegError  # noqa: PLC0415  35 MB that only videos need

    tracks: dict[int, _Track] = {}
    begin_s = video_s = math.nan
    try:
        with opened(path) as container:
            for part in container.demux(*container.streams.video[:1], *container.streams.data):
                if part.stream.type == "data":
                    tracks.setdefault(part.stream.index, _Track()).add(part, video_s)
                elif part.dts is not None:
                    video_s = float(part.dts * part.time_base)
                    begin_s = video_s if math.isnan(begin_s) else begin_s
    except (FFmpegError, IndexError):  # of a stream that a damage has made
        contents.damaged = True
    track = next((track for track in tracks.values() if KEY in track.data), None)
    if track is None or track.untimed:
        contents.notes.append(_UNTIMED)
    if track is None:  # PyAV finds no metadata in a programme stream
        yield from bare_packets(path, contents, begin_s)
    else:
        for at, items in packets(bytes(track.data), contents):
            yield items, track.times_s[bisect_right(track.begins, at) - 1]


class _Track:
    """Hold the bytes of a stream of metadata, with places and times (s) at which pieces begin."""

    def __init__(self) -> None:
        self.data, self.untimed = bytearray(), False
        self.begins: list[int] = []
        self.times_s: list[float] = []

    def add(self, part: Any, video_s: float) -> None:
        """Add a piece of the stream; without its own time it has that of the video."""
        self.untimed |= part.pts is None
        self.begins.append(len(self.data))
        self.times_s.append(video_s if part.pts is None else float(part.pts * part.time_base))
        self.data += bytes(part)


def packets(data: bytes | mmap.mmap, contents: LogContents) -> Iterator[tuple[int, Items]]:
    """Yield the items of each packet and its place; count in ``contents`` what is refused."""
    begins = ((match.start(), _SETS[match[1]]) for match in _KEYS.finditer(data))
    for (at, name), (end, _) in pairwise(chain(begins, [(len(data), "")])):
        contents.read[name] += 1
        try:
            must(name == PACKET, "only ST 0601 is read")
            items = _items(data[at : min(end, at + _MOST_BYTES)])
        except (Refused, IndexError) as error:
            reason = str(error) if isinstance(error, Refused) else "cut off"
            contents.refused[name, reason] += 1
        else:
            yield at, items


def _items(piece: bytes) -> Items:
    """Return the items of the packet that a piece begins with.

    Raise Refused for a wrong checksum, IndexError if it is not whole.
    """
    content, end = _value(piece, len(KEY))
    items, at = {}, 0
    while at < len(content):
        tag, byte = 0, 0x80
        while byte >= 0x80:  # seven bits a byte
            byte, at = content[at], at + 1
            tag = tag << 7 | byte & 0x7F
        items[tag], at = _value(content, at)
    of_sum = bytes((CHECKSUM, 2)) + checksum(piece[: end - 2]).to_bytes(2, "big")
    must(CHECKSUM not in items or piece[:end].endswith(of_sum), "wrong checksum")
    return items


def _value(data: bytes, at: int) -> tuple[bytes, int]:
    """Return the value of the length in BER at a place, and its end; IndexError if cut off."""
    length, at = data[at], at + 1
    if length >= 0x80:
        size = length & 0x7F
        length, at = int.from_bytes(data[at : at + size], "big"), at + size
    if at + length > len(data):
        raise IndexError
    return data[at : at + length], at + length
