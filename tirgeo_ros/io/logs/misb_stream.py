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
"""Take the packets and the pictures of MISB streams out of their containers, by PyAV.

A picture's time is that of its own time stamp (ST 0604) if it has one. Else it follows from the
metadata's time stamps and times in the stream: their difference as the median over neighbouring
packets, so that neither jitter nor drift of a clock counts.
"""

from __future__ import annotations

import contextlib
import math
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import median_filter

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.files.whole_files import reading
from tirgeo_ros.io.logs.klv_packets import LocalSet, PacketReader, without_cell_heads
from tirgeo_ros.io.logs.log_contents import SECOND_NS, LogContents, Picture
from tirgeo_ros.io.messages.pictures import MOST_OF_VIDEO

_SYNC = 0x47
_PROGRAMME = b"\0\0\1\xba"
#: Distance and offset of the sync bytes: in a transport stream, and with a time before each.
_TRANSPORT = ((188, 0), (192, 4))
_PIECE = 1 << 20
_PICTURE = "picture"
_OWN_TIME = b"MISPmicrosectime"
#: Neighbouring packets whose times in the stream give a picture's: some seconds.
_NEIGHBOURS = 101
#: A picture whose time is so near a packet's is of that packet's time.
_SAME_NS = 2_000_000
#: Beyond this, a picture's own time stamp is of another clock than the metadata.
_FAR_NS = SECOND_NS
#: Largest difference of the colours of a grey picture after compression.
_GREY = 8


def is_stream(head: bytes) -> bool:
    """Return whether a file's first bytes are an MPEG transport or programme stream."""
    return head.startswith(_PROGRAMME) or any(
        len(head) > first + 2 * step and {*head[first : first + 2 * step + 1 : step]} == {_SYNC}
        for step, first in _TRANSPORT
    )


def bare_packets(path: Path, contents: LogContents) -> Iterator[LocalSet]:
    """Yield the packets of a file by their keys, whatever is between them."""
    reader, position = PacketReader(contents), 0
    with reading(path, LogError), path.open("rb") as file:
        while piece := file.read(_PIECE):
            yield from reader.take(piece, position=position)
            position += len(piece)
    yield from reader.take(b"", last=True)


class Stream:
    """Read a stream twice: its packets, then the pictures of its first video.

    Raise LogError if PyAV is not installed or cannot open the file.
    """

    def __init__(self, path: Path, contents: LogContents) -> None:
        self._path, self._contents = path, contents
        self._av = needed("av", f"reading {path}", LogError)
        self._at, self._times_s = array("d"), array("d")  # places and times of the video
        self._clock: _Clock | None = None

    def packets(self) -> Iterator[LocalSet]:
        """Yield the packets of the first stream of metadata that has any."""
        readers = defaultdict(lambda: PacketReader(self._contents))
        chosen = None
        with self._opened() as container:
            video = [*container.streams.video[:1]]
            for part in self._parts(container, [*video, *container.streams.data]):
                time_s, index = _seconds(part, part.pts), part.stream.index
                if part.stream in video:
                    if part.dts is not None and part.pos is not None:
                        self._at.append(part.pos)
                        self._times_s.append(_seconds(part, part.dts))
                elif chosen in {None, index}:
                    content = without_cell_heads(bytes(part))
                    for packet in readers[index].take(content, time_s, part.pos or 0):
                        chosen = index
                        yield packet
        for index, reader in readers.items():
            yield from reader.take(b"", last=True) if chosen in {None, index} else ()
        if not self._contents.read:  # PyAV finds no metadata in a programme stream
            yield from bare_packets(self._path, self._contents)

    def set_times(
        self, times_s: Sequence[float], positions: Sequence[int], stamps_ns: Sequence[int]
    ) -> None:
        """Set from the packets of metadata how the stream's times (s, nan: none) become UTC."""
        known_s, at = np.array(times_s), np.array(positions)
        if len(self._at) and np.isnan(known_s).any():
            order = np.argsort(self._at, kind="stable")
            by_place_s = np.interp(at, np.array(self._at)[order], np.array(self._times_s)[order])
            known_s = np.where(np.isnan(known_s), by_place_s, known_s)
            self._contents.notes.append(
                "the metadata has no times in the stream: a picture without a time stamp of its "
                "own has about the time of the metadata beside it in the file"
            )
        timed = np.isfinite(known_s)
        if timed.any():
            self._clock = _Clock(known_s[timed], np.array(stamps_ns)[timed])

    def pictures(
        self, camera: Callable[[int, int, int], Camera | None], every_s: float
    ) -> Iterator[Picture]:
        """Yield the pictures as JPEG, each with ``camera(stamp_ns, width, height)``."""
        last_ns, due_ns = 0, 0.0
        for frame in self._frames():
            self._contents.read[_PICTURE] += 1
            stamp_ns = self._stamp_ns(frame)
            if stamp_ns <= last_ns:
                self._refuse("no time, or one before the last picture's")
                continue
            last_ns = stamp_ns
            if stamp_ns >= due_ns:
                due_ns = stamp_ns + every_s * SECOND_NS - _SAME_NS
                optics = camera(stamp_ns, frame.width, frame.height)
                yield Picture(stamp_ns, _jpeg(frame), optics)

    def _frames(self) -> Iterator[Any]:
        with self._opened() as container:
            videos = container.streams.video[:1]
            for stream in videos:
                stream.thread_type = "AUTO"
                stream.codec_context.options = {"max_pixels": str(MOST_OF_VIDEO)}
            for part in self._parts(container, videos):
                try:
                    yield from part.decode()
                except self._av.error.FFmpegError:  # noqa: PERF203  the next may be whole
                    self._refuse("cannot be decoded")

    def _stamp_ns(self, frame: Any) -> int:
        """Return a picture's time, 0 if it has none."""
        own_ns, time_s = _own_time_ns(frame), frame.time
        if self._clock is None or time_s is None:
            return own_ns
        stamp_ns = self._clock.at_ns(time_s)
        return own_ns if abs(own_ns - stamp_ns) < _FAR_NS else stamp_ns

    def _refuse(self, reason: str) -> None:
        self._contents.refused[_PICTURE, reason] += 1

    def _opened(self) -> contextlib.AbstractContextManager[Any]:
        try:
            opened: contextlib.AbstractContextManager[Any] = self._av.open(str(self._path))
        except (self._av.error.FFmpegError, OSError) as error:
            raise LogError(f"{self._path}: cannot be read as a video: {error.strerror}") from None
        return opened

    def _parts(self, container: Any, streams: Sequence[Any]) -> Iterator[Any]:
        """Yield the packets of the container, as far as it can be read."""
        try:
            yield from container.demux(*streams) if streams else ()
        except self._av.error.FFmpegError:
            self._contents.damaged = True


class _Clock:
    """Convert times in the stream to UTC."""

    def __init__(self, times_s: Array, stamps_ns: IntArray) -> None:
        order = np.argsort(times_s, kind="stable")
        self._stamps_ns, self._begin_ns = np.sort(stamps_ns), int(stamps_ns[0])
        self._times_s = times_s[order]
        offsets_s = (stamps_ns[order] - self._begin_ns) * 1e-9 - self._times_s
        self._offsets_s = median_filter(offsets_s, _NEIGHBOURS, mode="reflect")

    def at_ns(self, time_s: float) -> int:
        """Return the UTC of a time in the stream; that of a packet if it is as good as equal."""
        after_s = time_s + float(np.interp(time_s, self._times_s, self._offsets_s))
        stamp_ns = self._begin_ns + round(after_s * SECOND_NS)
        place = int(np.searchsorted(self._stamps_ns, stamp_ns))
        near = self._stamps_ns[max(place - 1, 0) : place + 1].tolist()
        nearest = min(near, key=lambda other: abs(other - stamp_ns))
        return int(nearest) if abs(nearest - stamp_ns) < _SAME_NS else stamp_ns


def _seconds(part: Any, ticks: int | None) -> float:
    return math.nan if ticks is None else float(ticks * part.time_base)


def _own_time_ns(frame: Any) -> int:
    """Return the precision time stamp of a picture (ST 0604.6, figure 1), or 0.

    It is in the H.264's or H.265's user data: name, status, then the eight bytes of the
    microseconds with 0xff after each second one.
    """
    for part in frame.side_data:
        content = bytes(part)
        if content.startswith(_OWN_TIME) and len(content) == len(_OWN_TIME) + 12:
            digits = content[len(_OWN_TIME) + 1 :]
            return int.from_bytes(b"".join(digits[k : k + 2] for k in (0, 3, 6, 9)), "big") * 1000
    return 0


def _jpeg(frame: Any) -> bytes:
    """Return a picture as JPEG, of one channel if it is grey."""
    pixels = frame.to_ndarray(format="bgr24")
    grey = frame.to_ndarray(format="gray")
    if int(cv2.absdiff(pixels, cv2.merge([grey] * 3)).max()) <= _GREY:
        pixels = grey
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
