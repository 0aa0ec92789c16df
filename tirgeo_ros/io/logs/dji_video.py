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
up among the times of the cues. Pictures are decoded as they are asked for, from key frame to key
frame, so that only packets of one such group are in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
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
    NORTH_SIGMA_DEG,
    SECOND_NS,
    LogContents,
    LogOptions,
    Picture,
    written_time,
)

#: Kinds of the first box of a file; a MOV need not begin with ftyp.
_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")
_PICTURE = "picture"
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 95]
#: A group of pictures without a key frame is taken in parts of so many packets.
_MOST_PACKETS = 300
#: Colours of a grey picture are within this of 128, after compression.
_GREY_TOLERANCE = 3
_PLANAR = ("yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p")
_MOST_DIFFERENCE = 0.1  # between subtitles and video, of the duration
_LEAST_DIFFERENCE_S = 2.0
_DAY_NS = 86400 * SECOND_NS
_MAKER = "DJI"  # begins the name of the encoder, which goes on with the model

#: Number of a picture and its time in the video (ns) -> its stamp (ns), and the cue in force.
_Clock = Callable[[int, int], tuple[int, Moment]]
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
        text = _inner_text(container) if beside is None else ""
        length_s, frames = _length_s(container, video), int(video.frames)
        created = written_time(container.metadata.get("creation_time", ""))
        lens = _lens(container.metadata.get("encoder", ""), (video.width, video.height))
    if beside is not None:
        text = read_text(beside, LogError, MOST_BYTES, damaged=True)
    elif not text:
        raise LogError(
            f"{path}: neither subtitles in it nor {path.stem}.SRT beside it, which have the "
            "positions: copy that file from the card too, and record with video captions on"
        )
    if not text.strip():
        raise LogError(f"{beside}: no subtitles in it: copy it from the card again")
    contents, moments = read_cues(text, beside or path, options)
    _check_same(path, beside, moments, length_s)
    contents.notes += _notes(beside, moments, created and created.local_ns)
    contents.notes += _lens_notes(moments, lens)
    contents.parameters["north.sigma_deg"] = NORTH_SIGMA_DEG
    if lens(1.0) is not None:
        contents.parameters["confidence.focal_sigma"] = DATA_SHEET_SIGMA
    clock = _clock_of(moments, frames)
    contents.pictures = _Reader(path, contents, clock, lens, options.every_s).pictures()
    return contents


def _lens(encoder: str, size: tuple[int, int]) -> _Lens:
    """Return what makes the camera of a zoom, by the model that wrote the video."""
    maker, _, model = encoder.partition(" ")

    @lru_cache
    def lens(zoom: float) -> Camera | None:
        return camera_of(_MAKER, model.strip(), size, zoom) if maker == _MAKER else None

    return lens


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


def _length_s(container: Any, video: Any) -> float:
    if video.duration is not None:
        return float(video.duration * video.time_base)
    return (container.duration or 0) * 1e-6


def _inner_text(container: Any) -> str:
    """Return the subtitle track inside a video as the text of an SRT; empty if there is none."""
    from av.error import FFmpegError  # noqa: PLC0415  as above

    track = next(iter(container.streams.subtitles), None)
    if track is None:
        return ""
    for stream in container.streams:
        if stream is not track and hasattr(stream, "discard"):  # else all is read
            stream.discard = type(stream.discard)["all"]
    cues: list[str] = []
    with suppress(FFmpegError):  # cut off: its pictures too, which are counted
        for packet in container.demux(track):
            data = bytes(packet)
            if track.codec_context.name == "mov_text":  # two bytes of length, and boxes of style
                data = data[2 : 2 + int.from_bytes(data[:2], "big")]
            if data and packet.pts is not None:
                begin_ms = round(packet.pts * packet.time_base * 1000)
                body = data.decode("utf-8", "replace").strip()
                cues.append(
                    f"{len(cues) + 1}\n{_clock(begin_ms)} --> {_clock(begin_ms)}\n{body}\n"
                )
    return "\n".join(cues)


def _clock(time_ms: int) -> str:
    minutes, ms = divmod(time_ms, 60_000)
    return f"{minutes // 60:02}:{minutes % 60:02}:{ms // 1000:02},{ms % 1000:03}"


def _check_same(path: Path, beside: Path | None, moments: list[Moment], length_s: float) -> None:
    """Raise LogError if the subtitles last longer or shorter than the video."""
    begins = _bounded(moment.begin_ns for moment in moments if moment.begin_ns is not None)
    if len(begins) < 2:
        return
    steps = np.diff(np.sort(begins))  # of the last cue the end is not read
    lasts_s = (np.percentile(begins, 99) / 0.99 + np.median(steps)) / SECOND_NS
    limit_s = max(
        _MOST_DIFFERENCE * length_s, _LEAST_DIFFERENCE_S, 2 * float(np.median(steps)) / 1e9
    )
    if abs(lasts_s - length_s) > limit_s:
        raise LogError(
            f"{beside or path}: subtitles of another video: they last {lasts_s:.1f} s, and "
            f"{path.name} {length_s:.1f} s; give each video the file of its own name"
        )


def _notes(beside: Path | None, moments: list[Moment], created_ns: int | None) -> Iterator[str]:
    """Yield what is assumed of a video's subtitles."""
    yield f"positions and gimbal are of {beside or 'the subtitles inside it'}"
    begun_ns = moments[0].stamp_ns if moments else 0
    if created_ns is not None and created_ns > 0 and abs(begun_ns - created_ns) > _DAY_NS:
        days = abs(begun_ns - created_ns) / _DAY_NS
        yield f"by its own date the video is {days:.0f} days from its subtitles: are they its own?"
    yield f"the gimbal's north is not calibrated: {NORTH_SIGMA_DEG:g} deg are assumed"


def _lens_notes(moments: list[Moment], lens: _Lens) -> Iterator[str]:
    """Yield what is assumed of a video's lens."""
    if camera := lens(1.0):
        yield f"the lens is not calibrated: focal length {camera.fx:.0f} px as published"
        return
    lengths = sorted({m.focal_mm for m in moments if m.focal_mm})
    length = f", of {lengths[0]:g} mm as for 36 x 24 mm" if lengths else ""
    yield f"no camera_info: give the lens{length} as --camera to what reads the bag"
    if len(lengths) > 1:
        yield f"it zooms to {lengths[-1]:g} mm: one --camera is not that of all pictures"


def _bounded(times_ns: Iterable[int]) -> IntArray:
    """Return times (N,), ns; a damaged one may be beyond 64 bits."""
    return np.array([min(max(time_ns, 0), LAST_NS) for time_ns in times_ns], np.int64)


def _clock_of(moments: list[Moment], frames: int) -> _Clock:
    """Return the clock of a video of so many pictures; cues with an outlying time are ignored."""
    stamps = _bounded(moment.stamp_ns for moment in moments)
    begins = _bounded(moment.begin_ns or 0 for moment in moments)
    by_number = abs(len(stamps) - frames) <= 1 and len(stamps) > 1
    places = np.arange(len(stamps)) if by_number else begins
    good = ~lone_stamps(stamps) & ~lone_stamps(begins)
    places, stamps = places[good], np.maximum.accumulate(stamps[good])
    order = np.argsort(places, kind="stable")
    moments = [moments[place] for place in np.flatnonzero(good)[order]]
    places, since = places[order], (stamps - stamps[0])[order].astype(float)
    first_ns = int(stamps[0])
    step_ns = (since[-1] / max(len(since) - 1, 1)) if by_number else 1.0

    def clock(number: int, time_ns: int) -> tuple[int, Moment]:
        place = number if by_number else time_ns
        outside = place - min(max(place, places[0]), places[-1])
        since_ns = float(np.interp(place, places, since)) + outside * step_ns
        begun = max(int(np.searchsorted(places, place, "right")) - 1, 0)
        return first_ns + round(since_ns), moments[begun]

    return clock


class _Reader:
    """Decode the pictures of a video, all or one each ``every_s``, and count them."""

    def __init__(
        self, path: Path, contents: LogContents, clock: _Clock, lens: _Lens, every_s: float
    ) -> None:
        self._path, self._contents = path, contents
        self._clock, self._lens = clock, lens
        self._every_ns = round(every_s * SECOND_NS)
        self._due_ns = self._number = 0
        #: Presentation time (ticks) -> stamp (ns), and the cue then.
        self._wanted: dict[int, tuple[int, Moment]] = {}

    def pictures(self) -> Iterator[Picture]:
        """Yield the pictures in order; count those that are damaged or cut off."""
        from av.error import FFmpegError  # noqa: PLC0415  as above
        from av.video.reformatter import VideoReformatter  # noqa: PLC0415  as above

        last_ns, reformatter = -1, VideoReformatter()
        with _opened(self._path) as container:
            video = container.streams.best("video")
            video.codec_context.thread_type = "AUTO"
            try:
                for frame in self._frames(container, video):
                    if frame.pts not in self._wanted:
                        continue
                    stamp_ns, moment = self._wanted.pop(frame.pts)
                    if frame.is_corrupt:
                        self._refuse("damaged", 1)
                    elif stamp_ns > last_ns:  # so that they stay in order
                        self._contents.read[_PICTURE] += 1
                        last_ns = stamp_ns
                        camera = self._lens(moment.zoom or 1.0)
                        yield Picture(stamp_ns, jpeg(frame, reformatter), camera)
            except FFmpegError:
                self._contents.damaged = True
            self._refuse("cannot be decoded", len(self._wanted))
            self._refuse("cut off", int(video.frames) - self._number)

    def _refuse(self, reason: str, number: int) -> None:
        if number > 0:
            self._contents.damaged = True
            self._contents.refused[_PICTURE, reason] += number

    def _frames(self, container: Any, video: Any) -> Iterator[Any]:
        """Yield decoded frames; packets behind the last wanted one of a group are not decoded."""
        for packets, whole in _groups(container, video):
            wanted = self._choose(packets, video)
            if self._every_ns and whole:
                last = max((k for k, p in enumerate(packets) if p.pts in wanted), default=-1)
                for packet in packets[: last + 1]:
                    yield from _decoded(packet)
                yield from _rest(video)
            else:
                for packet in packets:
                    yield from _decoded(packet)
        yield from _rest(video)

    def _choose(self, packets: list[Any], video: Any) -> set[int]:
        """Return the presentation times (ticks) of the wanted pictures of a group."""
        wanted = set()
        start = video.start_time or 0
        for ticks in sorted(packet.pts for packet in packets):
            time_ns = round((ticks - start) * video.time_base * SECOND_NS)
            if time_ns >= self._due_ns or not self._every_ns:
                wanted.add(ticks)
                self._wanted[ticks] = self._clock(self._number, time_ns)
                self._due_ns = (
                    (time_ns // self._every_ns + 1) * self._every_ns if self._every_ns else 0
                )
            self._number += 1
        return wanted


def _groups(container: Any, video: Any) -> Iterator[tuple[list[Any], bool]]:
    """Yield packets from key frame to key frame, and whether they are such a whole group."""
    packets: list[Any] = []
    whole = True
    for packet in container.demux(video):
        if packet.pts is None:
            continue
        if packets and (packet.is_keyframe or len(packets) == _MOST_PACKETS):
            yield packets, whole and packet.is_keyframe
            packets, whole = [], packet.is_keyframe
        packets.append(packet)
    if packets:
        yield packets, whole


def _decoded(packet: Any) -> list[Any]:
    """Return the frames that a packet completes; a damaged one completes none."""
    from av.error import InvalidDataError  # noqa: PLC0415  as above

    try:
        return list(packet.decode())
    except InvalidDataError:
        return []


def _rest(video: Any) -> list[Any]:
    """Return the frames that the decoder holds back; it then begins anew."""
    from av.error import InvalidDataError  # noqa: PLC0415  as above

    frames: list[Any] = []
    with suppress(InvalidDataError, EOFError):
        frames = video.codec_context.decode(None)
    video.codec_context.flush_buffers()
    return frames


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
