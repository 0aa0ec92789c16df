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
"""Take pictures out of videos by PyAV: each as JPEG, at the UTC of its time in the video.

A video's records (a cue of subtitles, a packet of metadata) have both times. A picture that has a
precision time stamp of its own (ST 0604) has that one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.files.whole_files import reading
from tirgeo_ros.io.logs.log_contents import SECOND_NS, LogContents, Picture

#: Time in the video (s) -> UTC (ns), or 0 if it is not known.
Clock = Callable[[float], int]
#: Stamp (ns), width and height of a picture -> its camera, or None if it is not known.
Optics = Callable[[int, int, int], Camera | None]

_PICTURE = "picture"
_MOST_PIXELS = str(1 << 25)  # 8K: a damaged size takes no more memory
_OWN_TIME = b"MISPmicrosectime"
#: Times so near each other are one: a picture's, a record's, and that at which one is due.
_SAME_NS = 2_000_000
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 95]
_GREY = range(125, 132)  # both colours of a grey picture are 128, before compression


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open a video; raise LogError naming it if that fails, or without PyAV."""
    av = needed("av", f"reading {path}", LogError)
    with reading(path, LogError):
        try:
            container = av.open(str(path), metadata_errors="replace")
        except av.error.FFmpegError as fault:
            raise LogError(
                f"{path}: not a whole video ({fault.strerror}): an MP4 that was cut off while it "
                "was recorded or copied lacks its index (moov); copy it again, or let the "
                "aircraft repair it"
            ) from None
    with container:
        yield container


def video_of(container: Any) -> Any:
    """Return the video in a container, of several the thermal one: sensors of heat are 5 to 4.

    None without any.
    """
    decodable = [video for video in container.streams.video if video.codec_context is not None]
    thermal = [video for video in decodable if video.width * 4 == video.height * 5]
    return thermal[0] if thermal else container.streams.best("video")


def clock(times_s: Array, stamps_ns: IntArray, neighbours: int = 1) -> Clock:
    """Return what gives the UTC of a time in the video.

    ``times_s`` (in the video) and ``stamps_ns`` (N,) are of records. Their difference is the
    median of so many ``neighbours``, so that neither jitter nor drift of a clock counts.
    """
    order = np.unique(times_s, return_index=True)[1]  # the first record of one time
    order = order[np.isfinite(times_s[order])]
    if not order.size:
        return lambda _: 0
    begin_ns, sorted_ns = int(stamps_ns[0]), np.sort(stamps_ns)
    offsets_s = (stamps_ns - begin_ns) * 1e-9 - times_s
    parts = np.array_split(order, -(-len(order) // neighbours))
    middles = np.array([[np.median(x[part]) for part in parts] for x in (times_s, offsets_s)])

    def utc_ns(time_s: float) -> int:
        stamp_ns = begin_ns + round((time_s + float(np.interp(time_s, *middles))) * SECOND_NS)
        place = int(np.searchsorted(sorted_ns, stamp_ns))
        near = sorted_ns[max(place - 1, 0) : place + 1].tolist()
        nearest: int = min(near, key=lambda other: abs(other - stamp_ns))
        return nearest if abs(nearest - stamp_ns) < _SAME_NS else stamp_ns

    return utc_ns


def pictures(
    path: Path, contents: LogContents, utc_ns: Clock, optics: Optics, every_s: float
) -> Iterator[Picture]:
    """Decode a picture each ``every_s`` (0: all), in order; count those read and refused."""
    from av.video.reformatter import VideoReformatter  # noqa: PLC0415  35 MB that videos need

    last_ns, decoded, errors, reformatter = 0, 0, 0, VideoReformatter()
    due_ns = 0.0
    with opened(path) as container:
        video = video_of(container)
        for frame, own_ns in _frames(container, video) if video else ():
            if frame is None:
                errors += 1
                continue
            decoded += 1
            stamp_ns = own_ns or (0 if frame.time is None else utc_ns(frame.time))
            if frame.is_corrupt:
                _refuse(contents, "damaged", 1)
            elif stamp_ns <= last_ns:
                contents.refused[_PICTURE, "no time, or one before the last picture's"] += 1
            else:
                last_ns = stamp_ns
                if stamp_ns >= due_ns:
                    due_ns = stamp_ns + every_s * SECOND_NS - _SAME_NS
                    contents.read[_PICTURE] += 1
                    camera = optics(stamp_ns, frame.width, frame.height)
                    yield Picture(stamp_ns, _jpeg(frame, reformatter), camera)
        lost = video.frames - decoded if video and video.frames else errors
    _refuse(contents, "cut off, or cannot be decoded", lost)


def _frames(container: Any, video: Any) -> Iterator[tuple[Any, int]]:
    """Yield the pictures in order, with their own UTC (ns) or 0, as far as a file goes.

    A picture is None where a packet cannot be decoded.
    """
    from av.error import FFmpegError  # noqa: PLC0415  as above

    video.codec_context.thread_type = "AUTO"
    video.codec_context.options = {"max_pixels": _MOST_PIXELS}
    own_ns: dict[int, int] = {}
    with suppress(FFmpegError):  # cut off
        for packet in container.demux(video):
            if packet.is_corrupt:  # its error would take with it what the decoder's threads hold
                yield None, 0
                continue
            own_ns[packet.pts] = _own_time_ns(bytes(packet))
            try:
                for frame in packet.decode():
                    yield frame, own_ns.pop(frame.pts, 0)
            except FFmpegError:
                yield None, 0


def _refuse(contents: LogContents, reason: str, number: int) -> None:
    if number > 0:
        contents.damaged = True
        contents.refused[_PICTURE, reason] += number


def _own_time_ns(data: bytes) -> int:
    """Return the precision time stamp of a picture of H.264 or H.265 (ST 0604), or 0.

    It is in the user data: name, status, microseconds with 0xff after each second byte. (As the
    frame's side data it would be held, with the frame, until Python's next search for cycles.)
    """
    digits = data.partition(_OWN_TIME)[2][1:12]
    return int.from_bytes(b"".join(digits[k : k + 2] for k in (0, 3, 6, 9)), "big") * 1000


def _jpeg(frame: Any, reformatter: Any) -> bytes:
    """Return a frame as JPEG, with one channel if its colours are grey."""
    width, height = frame.width // 2 * 2, frame.height // 2 * 2  # two pixels have one colour
    planes = reformatter.reformat(frame, width, height, "yuv420p").to_ndarray()
    colours = planes[height:]
    is_grey = colours.min() in _GREY and colours.max() in _GREY
    pixels = reformatter.reformat(frame, format="gray" if is_grey else "bgr24")
    return cv2.imencode(".jpg", pixels.to_ndarray(), _JPEG)[1].tobytes()
