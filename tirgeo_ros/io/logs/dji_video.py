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
up among the times of the cues.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache, partial
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import DATA_SHEET_SIGMA, camera_of
from tirgeo_ros.core.streams.stamps import lone_stamps
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.files.whole_files import read_text
from tirgeo_ros.io.logs.dji_srt import MOST_BYTES, Moment, read_cues
from tirgeo_ros.io.logs.log_contents import (
    NORTH_SIGMA_DEG,
    SECOND_NS,
    LogContents,
    LogOptions,
    written_time,
)
from tirgeo_ros.io.logs.video_pictures import clock, opened, pictures

#: Kinds of the first box of a file; a MOV need not begin with ftyp.
_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")
_MOST_SHARE = 0.1  # between subtitles and video, of the duration
_LEAST_DIFFERENCE_S = 2.0
_DAY_NS = 86400 * SECOND_NS


def is_dji_video(head: bytes) -> bool:
    """Return whether a file's first bytes are those of MP4 or MOV."""
    return head[4:8] in _BOXES


def own_subtitles(path: Path) -> Path | None:
    """Return the file of subtitles of a video's name beside it, or None."""
    files = (path.with_suffix(ending) for ending in (".SRT", ".srt", ".Srt"))
    return next((file for file in files if file.is_file()), None)


def read_dji_video(path: Path, options: LogOptions) -> LogContents:
    """Read a video with its subtitles; the pictures are decoded as they are asked for.

    Raise LogError if it cannot be read, has no subtitles or those of another video, or for an
    option that the subtitles need.
    """
    beside = own_subtitles(path)
    with opened(path) as container:
        video = container.streams.best("video")
        if video is None or video.codec_context is None:
            raise LogError(f"{path}: no video in it that can be decoded: copy it again")
        times_ns, text = _index(container, video)
        start_s = float((video.start_time or 0) * video.time_base)
        frames, length_s = video.frames, (container.duration or 0) * 1e-6
        created = written_time(container.metadata.get("creation_time", ""))
        maker, _, model = container.metadata.get("encoder", "").partition(" ")
        lens = lru_cache(partial(camera_of, maker, model.strip(), (video.width, video.height)))
    if beside is not None:
        text = read_text(beside, LogError, MOST_BYTES, damaged=True)
    elif not text:
        raise LogError(
            f"{path}: neither subtitles in it nor {path.stem}.SRT beside it, which have the "
            "positions: copy that file from the card too, and record with video captions on"
        )
    contents, moments = read_cues(text, beside or path, options)
    if abs(len(moments) - frames) <= 1:  # a cue for each picture, at its time
        pairs = zip(moments, times_ns, strict=False)
        moments = [moment._replace(begin_ns=time_ns) for moment, time_ns in pairs]
        moments = _fitting(moments, beside or path)
    else:
        moments = _fitting([m for m in moments if m.begin_ns is not None], beside or path)
        _check_same(beside or path, path.name, moments, length_s)
    contents.notes += _notes(beside, moments, created.local_ns if created else 0, lens(1.0))
    contents.parameters["north.sigma_deg"] = NORTH_SIGMA_DEG
    if lens(1.0) is not None:
        contents.parameters["confidence.focal_sigma"] = DATA_SHEET_SIGMA
    stamps_ns = np.array([moment.stamp_ns for moment in moments])
    begins_s = np.array([moment.begin_ns for moment in moments], float) / SECOND_NS + start_s

    def optics(stamp_ns: int, _width: int, _height: int) -> Camera | None:
        place = int(np.searchsorted(stamps_ns, stamp_ns, "right"))
        return lens(moments[max(place - 1, 0)].zoom or 1.0)

    utc_ns = clock(begins_s, stamps_ns)
    contents.pictures = pictures(path, contents, utc_ns, optics, options.every_s)
    return contents


def _index(container: Any, video: Any) -> tuple[list[int], str]:
    """Return the times (ns) of the pictures in the video, and the subtitles inside as an SRT."""
    from av.error import FFmpegError  # noqa: PLC0415  35 MB that only videos need

    ticks: set[int] = set()
    cues: list[str] = []
    with suppress(FFmpegError):  # cut off: missing pictures are counted
        for packet in container.demux(video, *container.streams.subtitles[:1]):
            if packet.pts is None:
                continue
            if packet.stream.index == video.index:
                ticks.add(packet.pts)
            else:
                data = bytes(packet)  # two bytes of length, text, boxes of style
                body = data[2 : 2 + int.from_bytes(data[:2], "big")].decode("utf-8", "replace")
                begin = np.datetime64(round(packet.pts * packet.time_base * 1000), "ms")
                time = str(begin).partition("T")[2]
                cues.append(f"{len(cues) + 1}\n{time} --> {time}\n{body.strip()}\n")
    since = np.array(sorted(ticks), float) - (video.start_time or 0)
    times_ns = np.clip(since * float(video.time_base) * SECOND_NS, 0, LAST_NS)
    return times_ns.round().astype(int).tolist(), "\n".join(cues)


def _fitting(moments: list[Moment], path: Path) -> list[Moment]:
    """Return moments in order, without outlying times; raise LogError if fewer than two are."""
    times_ns = np.array([(m.stamp_ns, m.begin_ns) for m in moments], np.int64).reshape(-1, 2)
    alone = lone_stamps(times_ns[:, 0]) | lone_stamps(times_ns[:, 1])
    moments = sorted(compress(moments, ~alone), key=lambda moment: moment.begin_ns or 0)
    if len(moments) < 2:
        raise LogError(f"{path}: no two of its times fit together: copy it from the card again")
    return moments


def _check_same(path: Path, video: str, moments: list[Moment], length_s: float) -> None:
    """Raise LogError if the subtitles last longer or shorter than the video."""
    begins_s = np.array([moment.begin_ns for moment in moments], float) / SECOND_NS
    step_s = float(np.median(np.diff(begins_s)))  # of the last cue the end is not read
    lasts_s = begins_s[-1] + step_s
    if abs(lasts_s - length_s) > max(_MOST_SHARE * length_s, _LEAST_DIFFERENCE_S, 2 * step_s):
        raise LogError(
            f"{path}: subtitles of another video: they last {lasts_s:.1f} s, and {video} "
            f"{length_s:.1f} s; give each video the file of its own name"
        )


def _notes(
    beside: Path | None, moments: list[Moment], created_ns: int, camera: Camera | None
) -> Iterator[str]:
    """Yield what is assumed of a video's subtitles and lens."""
    yield f"positions and gimbal are of {beside or 'the subtitles inside it'}"
    days = abs(moments[0].stamp_ns - created_ns) / _DAY_NS if created_ns > 0 else 0.0
    if days > 1:
        yield f"by its own date the video is {days:.0f} days from its subtitles: are they its own?"
    yield f"the gimbal's north is not calibrated: {NORTH_SIGMA_DEG:g} deg are assumed"
    if camera is not None:
        yield f"the lens is not calibrated: focal length {camera.fx:.0f} px as published"
        return
    lengths = sorted({m.focal_mm for m in moments if m.focal_mm})
    length = f", of {lengths[0]:g} mm as for 36 x 24 mm" if lengths else ""
    yield f"no camera_info: give the lens{length} as --camera to what reads the bag"
    if len(lengths) > 1:
        yield f"it zooms to {lengths[-1]:g} mm: one --camera is not that of all pictures"
