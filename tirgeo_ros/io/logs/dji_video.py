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
"""Read DJI's videos (MP4, MOV): each picture at its time, with position and gimbal from subtitles.

The subtitles are in a file of the same name beside the video, or in a track inside it. Where they
have one cue a picture, a picture has the time of its own cue; else its presentation time is looked
up among the times of the cues. Pictures are decoded as they are asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import DATA_SHEET_SIGMA, camera_of
from tirgeo_ros.core.streams.stamps import lone_stamps
from tirgeo_ros.core.types.arrays import IntArray
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.files.whole_files import read_text, reading
from tirgeo_ros.io.logs.dji_srt import MOST_BYTES, Moment, read_cues
from tirgeo_ros.io.logs.log_contents import (
    SECOND_NS,
    LogContents,
    LogOptions,
    Picture,
    note_uncalibrated,
    written_time,
)

#: Kinds of the first box of a file; a MOV need not begin with ftyp.
_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")
_PICTURE = "picture"
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 95]
#: Colours of a grey picture are within this of 128, after compression.
_GREY_TOLERANCE = 3
_PLANAR = ("yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p")
_MOST_SHARE = 0.1  # between subtitles and video, of the duration
_LEAST_DIFFERENCE_S = 2.0
_DAY_NS = 86400 * SECOND_NS

#: Presentation time (ticks) of a picture -> its stamp (ns), and the cue in force.
_Wanted = dict[int, tuple[int, Moment]]
#: Digital zoom -> the camera, if it is known.
_Lens = Callable[[float], Camera | None]


def is_dji_video(head: bytes) -> bool:
    """Return whether a file's first bytes are those of MP4 or MOV."""
    return head[4:8] in _BOXES


def own_subtitles(path: Path) -> Path | None:
    """Return the file of subtitles of a video's name beside it, or None."""
    files = (path.with_suffix(ending) for ending in (".SRT", ".srt", ".Srt"))
    return next((file for file in files if file.is_file()), None)


def read_dji_video(path: Path, options: LogOptions) -> LogContents:
    """Read a video with its subtitles; the pictures are read later.

    Raise LogError if it cannot be read, has no subtitles or those of another video, or for an
    option that the subtitles need.
    """
    beside = own_subtitles(path)
    with _opened(path) as container:
        video = container.streams.best("video")
        if video is None or video.codec_context is None:
            raise LogError(f"{path}: no video in it that can be decoded: copy it again")
        ticks, text = _index(container, video)
        start, tick_s, frames = video.start_time or 0, video.time_base, int(video.frames)
        length_s = (container.duration or 0) * 1e-6
        created = written_time(container.metadata.get("creation_time", ""))
        maker, _, model = container.metadata.get("encoder", "").partition(" ")
        size = video.width, video.height
    lens = lru_cache(partial(camera_of, maker, model.strip(), size))
    if beside is not None:
        text = read_text(beside, LogError, MOST_BYTES, damaged=True)
    elif not text:
        raise LogError(
            f"{path}: neither subtitles in it nor {path.stem}.SRT beside it, which have the "
            "positions: copy that file from the card too, and record with video captions on"
        )
    contents, moments = read_cues(text, beside or path, options)
    _check_same(path, beside, moments, length_s)
    contents.notes += _notes(beside, moments, created.local_ns if created else 0, lens(1.0))
    note_uncalibrated(contents, [(camera, DATA_SHEET_SIGMA)] if (camera := lens(1.0)) else [])
    times_ns = _bounded(round((each - start) * tick_s * SECOND_NS) for each in ticks)
    by_number = abs(len(moments) - frames) <= 1 and len(moments) > 1
    clock = _clock(moments, times_ns, beside or path, by_number=by_number)
    every_ns = max(round(options.every_s * SECOND_NS), 1)
    first_of_each = np.unique(times_ns // every_ns, return_index=True)[1]
    wanted = {ticks[number]: clock[number] for number in first_of_each}
    _refuse(contents, "cut off", frames - len(ticks))
    contents.pictures = _pictures(path, contents, wanted, lens)
    return contents


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a video; raise LogError naming it if that fails."""
    import av  # noqa: PLC0415  35 MB that only videos need

    with reading(path, LogError):
        try:
            container = av.open(str(path), metadata_errors="replace")
        except av.error.FFmpegError as fault:
            raise LogError(
                f"{path}: not a whole video ({fault.strerror}): one that was cut off while it was "
                "recorded or copied lacks its index (moov); copy it again, or let the aircraft "
                "repair it"
            ) from None
    with container:
        yield container


def _index(container: Any, video: Any) -> tuple[list[int], str]:
    """Return the times (ticks) of the pictures in order, and the subtitles inside as an SRT."""
    from av.error import FFmpegError  # noqa: PLC0415  as above

    ticks: set[int] = set()
    cues: list[str] = []
    with suppress(FFmpegError):  # cut off: missing pictures are counted
        for packet in container.demux(video, *container.streams.subtitles[:1]):
            if packet.pts is None:
                continue
            if packet.stream.index == video.index:
                ticks.add(packet.pts)
            elif body := _body(packet):
                begin = _written(round(packet.pts * packet.time_base * 1000))
                cues.append(f"{len(cues) + 1}\n{begin} --> {begin}\n{body}\n")
    return sorted(ticks), "\n".join(cues)


def _body(packet: Any) -> str:
    data = bytes(packet)
    if packet.stream.codec_context.name == "mov_text":  # two bytes of length, and boxes of style
        data = data[2 : 2 + int.from_bytes(data[:2], "big")]
    return data.decode("utf-8", "replace").strip()


def _written(time_ms: int) -> str:
    minutes, ms = divmod(time_ms, 60_000)
    return f"{minutes // 60:02}:{minutes % 60:02}:{ms // 1000:02},{ms % 1000:03}"


def _check_same(path: Path, beside: Path | None, moments: list[Moment], length_s: float) -> None:
    """Raise LogError if the subtitles last longer or shorter than the video."""
    begins = _bounded(moment.begin_ns for moment in moments if moment.begin_ns is not None)
    if len(begins) < 2:
        return
    # Of the last cue the end is not read.
    step_s = float(np.median(np.diff(np.sort(begins)))) / SECOND_NS
    lasts_s = np.percentile(begins, 99) / 0.99 / SECOND_NS + step_s
    if abs(lasts_s - length_s) > max(_MOST_SHARE * length_s, _LEAST_DIFFERENCE_S, 2 * step_s):
        raise LogError(
            f"{beside or path}: subtitles of another video: they last {lasts_s:.1f} s, and "
            f"{path.name} {length_s:.1f} s; give each video the file of its own name"
        )


def _notes(
    beside: Path | None, moments: list[Moment], created_ns: int, camera: Camera | None
) -> Iterator[str]:
    """Yield what is assumed of a video's subtitles and lens."""
    yield f"positions and gimbal are of {beside or 'the subtitles inside it'}"
    days = abs(moments[0].stamp_ns - created_ns) / _DAY_NS if created_ns > 0 else 0.0
    if days > 1:
        yield f"by its own date the video is {days:.0f} days from its subtitles: are they its own?"
    if camera is not None:
        return
    lengths = sorted({m.focal_mm for m in moments if m.focal_mm})
    length = f", of {lengths[0]:g} mm as for 36 x 24 mm" if lengths else ""
    yield f"no camera_info: give the lens{length} as --camera to what reads the bag"
    if len(lengths) > 1:
        yield f"it zooms to {lengths[-1]:g} mm: one --camera is not that of all pictures"


def _bounded(times_ns: Iterable[int]) -> IntArray:
    """Return times (N,), ns; a damaged one may be beyond 64 bits."""
    return np.array([min(max(time_ns, 0), LAST_NS) for time_ns in times_ns], np.int64)


def _clock(
    moments: Sequence[Moment], times_ns: IntArray, path: Path, *, by_number: bool
) -> list[tuple[int, Moment]]:
    """Return stamp (ns) and cue in force of the pictures at ``times_ns`` (N,), in order.

    ``by_number``: there is a cue for each picture. Cues with an outlying time are ignored; raise
    LogError if no other is left.
    """
    stamps = _bounded(moment.stamp_ns for moment in moments)
    begins = _bounded(moment.begin_ns or 0 for moment in moments)
    good = np.flatnonzero(~lone_stamps(stamps) & ~lone_stamps(begins))
    if not len(good):
        raise LogError(f"{path}: no two of its times fit together: copy it from the card again")
    places = np.arange(len(stamps)) if by_number else begins
    asked = np.arange(len(times_ns)) if by_number else times_ns
    order = np.argsort(places[good], kind="stable")
    places = places[good][order]
    since = np.maximum.accumulate(stamps[good])[order] - stamps[good[0]]
    step_ns = since[-1] / max(len(since) - 1, 1) if by_number else 1.0
    inside = np.clip(asked, places[0], places[-1])
    since_ns = np.interp(inside, places, since) + (asked - inside) * step_ns
    of_pictures = stamps[good[0]] + np.clip(since_ns, -LAST_NS, LAST_NS).round().astype(np.int64)
    begun = good[order][np.maximum(np.searchsorted(places, asked, "right") - 1, 0)]
    return [(stamp, moments[k]) for stamp, k in zip(of_pictures.tolist(), begun, strict=True)]


def _pictures(
    path: Path, contents: LogContents, wanted: _Wanted, lens: _Lens
) -> Iterator[Picture]:
    """Decode the wanted pictures in order; count those that are damaged."""
    from av.video.reformatter import VideoReformatter  # noqa: PLC0415  as above

    last_ns, reformatter = -1, VideoReformatter()
    with _opened(path) as container:
        for frame in _frames(container):
            if frame.pts not in wanted:
                continue
            stamp_ns, moment = wanted.pop(frame.pts)
            if frame.is_corrupt:
                _refuse(contents, "damaged", 1)
            elif stamp_ns > last_ns:  # so that they stay in order
                contents.read[_PICTURE] += 1
                last_ns = stamp_ns
                yield Picture(stamp_ns, jpeg(frame, reformatter), lens(moment.zoom or 1.0))
    _refuse(contents, "cannot be decoded", len(wanted))


def _frames(container: Any) -> Iterator[Any]:
    from av.error import FFmpegError, InvalidDataError  # noqa: PLC0415  as above

    video = container.streams.best("video")
    video.codec_context.thread_type = "AUTO"
    with suppress(FFmpegError):  # cut off
        for packet in container.demux(video):
            if packet.is_corrupt:  # its error would take with it what the decoder's threads hold
                continue
            with suppress(InvalidDataError):  # a damaged packet completes no picture
                yield from packet.decode()


def _refuse(contents: LogContents, reason: str, number: int) -> None:
    if number > 0:
        contents.damaged = True
        contents.refused[_PICTURE, reason] += number


def jpeg(frame: Any, reformatter: Any) -> bytes:
    """Return a frame as JPEG, with one channel if its colours are grey."""
    pixels = reformatter.reformat(frame, format="gray" if _is_grey(frame) else "bgr24")
    return cv2.imencode(".jpg", pixels.to_ndarray(), _JPEG)[1].tobytes()


def _is_grey(frame: Any) -> bool:
    if frame.format.name not in _PLANAR:
        return bool(frame.format.name.startswith("gray"))
    return all(
        cv2.norm(_plane(plane), cv2.NORM_INF) <= _GREY_TOLERANCE for plane in frame.planes[1:]
    )


def _plane(plane: Any) -> npt.NDArray[np.int16]:
    """Return a plane of colours (h, w), as differences from grey."""
    rows = np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)
    return rows[:, : plane.width].astype(np.int16) - 128
