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
"""Take metadata and pictures of MISB streams out of their containers, by PyAV.

A picture's time is that of its own time stamp (ST 0604) if it has one. Else it follows from the
metadata's time stamps and times in the stream: their difference as medians of neighbouring
packets, so that neither jitter nor drift of a clock counts.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.files.whole_files import reading
from tirgeo_ros.io.logs.dji_video import jpeg
from tirgeo_ros.io.logs.klv_packets import Items, PacketReader
from tirgeo_ros.io.logs.log_contents import SECOND_NS, LogContents, Picture
from tirgeo_ros.io.messages.pictures import MOST_OF_VIDEO

_SYNC, _PROGRAMME = 0x47, b"\0\0\1\xba"
#: Distance and offset of the sync bytes: in a transport stream, and with a time before each.
_TRANSPORT = ((188, 0), (192, 4))
_PICTURE = "picture"
_OWN_TIME = b"MISPmicrosectime"
#: Neighbouring packets whose times in the stream give one median: some seconds.
_NEIGHBOURS = 50
#: A picture whose time is so near a packet's is of that packet's time.
_SAME_NS = 2_000_000
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


def bare_packets(path: Path, contents: LogContents) -> Iterator[tuple[Items, float]]:
    """Yield the packets of a file by their keys, whatever is between them; without times (nan)."""
    reader = PacketReader(contents)
    with reading(path, LogError), path.open("rb") as file:
        while piece := file.read(1 << 20):
            yield from reader.take(piece)
    yield from reader.take(b"", last=True)


class Stream:
    """Read a stream twice: its metadata, then its pictures. Raise LogError without PyAV."""

    def __init__(self, path: Path, contents: LogContents) -> None:
        self._path, self._contents = path, contents
        self._av = needed("av", f"reading {path}", LogError)

    def packets(self) -> Iterator[tuple[Items, float]]:
        """Yield the packets of the first stream of metadata that has any, and their times (s)."""
        readers = defaultdict[int, PacketReader](lambda: PacketReader(self._contents))
        chosen, begin_s, video_s, untimed = None, math.nan, math.nan, False
        for part in self._parts(with_data=True):
            index = part.stream.index
            if part.stream.type == "video":
                video_s = video_s if part.dts is None else float(part.dts * part.time_base)
                begin_s = video_s if math.isnan(begin_s) else begin_s
            elif chosen in {None, index}:
                time_s = video_s if part.pts is None else float(part.pts * part.time_base)
                for packet in readers[index].take(bytes(part), time_s):
                    chosen, untimed = index, untimed or part.pts is None
                    yield packet
        for reader in readers.values():
            yield from reader.take(b"", last=True)
        if not self._contents.read:  # PyAV finds no metadata in a programme stream
            for items, _ in bare_packets(self._path, self._contents):
                untimed = True
                yield items, begin_s
        if untimed:
            self._contents.notes.append(_UNTIMED)

    def pictures(
        self,
        utc_ns: Callable[[float], int],
        camera: Callable[[int, int, int], Camera | None],
        every_s: float,
    ) -> Iterator[Picture]:
        """Yield the pictures as JPEG, with ``camera(stamp_ns, width, height)``, by a ``clock``."""
        last_ns, due_ns, refused = 0, 0.0, self._contents.refused
        reformatter = self._av.video.reformatter.VideoReformatter()
        for part in self._parts(with_data=False):
            try:
                frames = part.decode()
            except self._av.error.FFmpegError:
                refused[_PICTURE, "cannot be decoded"] += 1
                continue
            for frame in frames:
                self._contents.read[_PICTURE] += 1
                timed = frame.time is not None
                stamp_ns = _own_time_ns(frame) or (utc_ns(frame.time) if timed else 0)
                if stamp_ns <= last_ns:
                    refused[_PICTURE, "no time, or one before the last picture's"] += 1
                    continue
                last_ns = stamp_ns
                if stamp_ns >= due_ns:
                    due_ns = stamp_ns + every_s * SECOND_NS - _SAME_NS
                    optics = camera(stamp_ns, frame.width, frame.height)
                    yield Picture(stamp_ns, jpeg(frame, reformatter), optics)

    def _parts(self, *, with_data: bool) -> Iterator[Any]:
        """Yield the packets of the first video and of metadata, as far as the file is whole."""
        try:
            with self._av.open(str(self._path)) as container:
                videos = container.streams.video[:1]
                for video in videos:
                    video.thread_type = "AUTO"
                    video.codec_context.options = {"max_pixels": str(MOST_OF_VIDEO)}
                streams = [*videos, *(container.streams.data if with_data else ())]
                yield from container.demux(streams) if streams else ()
        except (self._av.error.FFmpegError, IndexError):  # of a stream that a damage has made
            self._contents.damaged = True


def clock(times_s: Array, stamps_ns: IntArray) -> Callable[[float], int]:
    """Return what gives the UTC (ns) of a time in the stream (s), or 0 where no time is finite.

    ``times_s`` and sorted ``stamps_ns`` (N,) are of packets; a stamp that almost fits is taken.
    """
    order = np.unique(times_s, return_index=True)[1]  # of a programme stream the first packet
    order = order[np.isfinite(times_s[order])]
    if not order.size:
        return lambda _: 0
    offsets_s = (stamps_ns - stamps_ns[0]) * 1e-9 - times_s
    parts = np.array_split(order, len(order) // _NEIGHBOURS + 1)
    middles = np.array([[np.median(x[part]) for part in parts] for x in (times_s, offsets_s)])

    def utc_ns(time_s: float) -> int:
        after_s = time_s + float(np.interp(time_s, *middles))
        stamp_ns = int(stamps_ns[0]) + round(after_s * SECOND_NS)
        place = int(np.searchsorted(stamps_ns, stamp_ns))
        near = stamps_ns[max(place - 1, 0) : place + 1].tolist()
        nearest: int = min(near, key=lambda other: abs(other - stamp_ns))
        return nearest if abs(nearest - stamp_ns) < _SAME_NS else stamp_ns

    return utc_ns


def _own_time_ns(frame: Any) -> int:
    """Return the precision time stamp of a picture of H.264 or H.265 (ST 0604), or 0.

    It is in the user data: name, status, microseconds with 0xff after each second byte.
    """
    for content in map(bytes, frame.side_data):
        if content.startswith(_OWN_TIME) and len(content) == len(_OWN_TIME) + 12:
            digits = content[-11:]
            return int.from_bytes(b"".join(digits[k : k + 2] for k in (0, 3, 6, 9)), "big") * 1000
    return 0
