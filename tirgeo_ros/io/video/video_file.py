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
"""Encode pictures, each at its own time, into a video file that is complete or absent."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np

from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import VideoError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.files.whole_files import check_place, part_of, writing

_CLOCK_HZ = 90_000
_FIRST_STEP_NS = 100_000_000
_SHORTEST_STEP_NS = 100_000  # nine ticks of the clock, so that no two frames share one
_LONGEST_STEP_NS = 10_000_000_000
#: With this crf, thin lines of the map still have their colours. A key frame comes at least every
#: 100 frames. x264's bytes depend on its number of threads, by default on that of the cores.
_H264 = {"preset": "veryfast", "crf": "26", "g": "100", "threads": "2"}


class Form(NamedTuple):
    """Hold a container's name in FFmpeg, and the options of H.264 and of the container."""

    container: str
    options: Mapping[str, str]
    container_options: Mapping[str, str]


#: By the ending of the file's name. Every browser and player shows 4:2:0 in 8 bit.
_FORMS: Mapping[str, Form] = {
    # The index comes first, so that a video plays while it loads.
    ".mp4": Form("mp4", _H264, {"movflags": "+faststart"}),
    ".ts": Form("mpegts", _H264, {}),
}


class FrameTimes:
    """Turn stamps into times from 0, ns, that always increase.

    A step between stamps that is not between 0.1 ms and 10 s is replaced by the step before it.
    """

    def __init__(self) -> None:
        self.time_ns = 0
        self._last_stamp_ns: int | None = None
        self._step_ns = _FIRST_STEP_NS

    def at(self, stamp_ns: int) -> int:
        """Return the next frame's time, ns."""
        if self._last_stamp_ns is not None:
            step_ns = stamp_ns - self._last_stamp_ns
            if _SHORTEST_STEP_NS <= step_ns < _LONGEST_STEP_NS:
                self._step_ns = step_ns
            self.time_ns += self._step_ns
        self._last_stamp_ns = stamp_ns
        return self.time_ns


@contextlib.contextmanager
def _as_os_errors() -> Iterator[None]:
    """Raise OSError for any error of PyAV: some are ValueErrors, OverflowErrors and others."""
    from av.error import FFmpegError  # noqa: PLC0415  35 MB that only videos need

    try:
        yield
    except FFmpegError as error:
        raise OSError(error.errno, error.strerror) from error


@final
class Encoder:
    """Write pictures (h, w, 3) BGR of one size to a file or an address; raise OSError.

    If a side has an odd number of pixels, its last pixel is repeated. With ``metadata`` there
    is a data stream of KLV beside the video: then each picture needs its packet, because the
    container waits for the stream that lags.
    """

    @_as_os_errors()
    def __init__(
        self, target: str, form: Form, size: tuple[int, int], *, metadata: bool = False
    ) -> None:
        import av  # noqa: PLC0415  35 MB that only videos need

        self._av = av
        options = dict(form.container_options)
        self._container: Any = av.open(target, "w", format=form.container, options=options)
        width, height = size
        video: Any = self._container.add_stream("libx264", rate=30, options=dict(form.options))
        video.width, video.height = width + width % 2, height + height % 2
        video.pix_fmt = "yuv420p"
        video.codec_context.time_base = Fraction(1, _CLOCK_HZ)
        self._video = video
        self._klv: Any = self._container.add_data_stream("klv") if metadata else None

    @_as_os_errors()
    def add(self, time_ns: int, pixels: Pixels, metadata: bytes = b"") -> None:
        """Append a picture at a time from 0, ns, with its metadata."""
        height, width = pixels.shape[:2]
        if height % 2 or width % 2:
            pixels = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), "edge")
        frame = self._av.VideoFrame.from_ndarray(pixels, format="bgr24")
        frame.pts = round(time_ns * 1e-9 * _CLOCK_HZ)
        frame.time_base = Fraction(1, _CLOCK_HZ)
        self._write(frame)
        if self._klv is not None:  # after the picture, which then need not wait
            packet = self._av.Packet(metadata)
            packet.stream, packet.time_base = self._klv, frame.time_base
            packet.pts = packet.dts = frame.pts
            self._container.mux(packet)

    @_as_os_errors()
    def finish(self) -> None:
        """Write the pictures that the codec holds back, and the container's end."""
        self._write(None)
        self._container.close()

    @_as_os_errors()
    def close(self) -> None:
        """Close the container; without ``finish`` a file stays incomplete."""
        self._container.close()

    def _write(self, frame: Any) -> None:
        for packet in self._video.encode(frame):
            self._container.mux(packet)


@final
class VideoFile:
    """Write frames (h, w, 3) BGR as H.264 (.mp4, .ts), each at its own time.

    A step between stamps that is not between 0.1 ms and 10 s is replaced by the step before it.
    If a side has an odd number of pixels, its last pixel is repeated. This is a context manager:
    the file gets its name when the block ends without an error; without a frame there is no file.
    A ``growing`` file (.ts) has its name from the start and plays as far as it is written. Raise
    VideoError if it cannot be written or frames change their size.
    """

    def __init__(self, path: str | os.PathLike[str], *, growing: bool = False) -> None:
        self.path = Path(path)
        self._growing = growing
        self.frames = 0
        if self.path.suffix.lower() not in _FORMS:
            raise VideoError(f"{path}: the video's name must end with {' or '.join(_FORMS)}")
        if not self.path.parent.is_dir():
            raise VideoError(f"{self.path}: no such folder; make it, or give another place")
        check_place(self.path, VideoError)
        part = part_of(self.path).with_suffix(self.path.suffix)
        self._part = self.path if growing else part
        try:
            str(self._part).encode()
        except UnicodeEncodeError:
            raise VideoError(
                f"{self.path}: the name is not UTF-8, as FFmpeg needs it; give another one"
            ) from None
        needed("av", f"writing {path}", VideoError)
        self._shape: tuple[int, ...] | None = None
        self._times = FrameTimes()
        self._encoder: Encoder | None = None

    @property
    def takes_metadata(self) -> bool:
        """Return whether the file holds a packet of metadata to each frame (.ts)."""
        return self.path.suffix.lower() == ".ts"

    @property
    def rate_hz(self) -> float:
        """Return the mean rate of the frames, 1/s; NaN for fewer than two."""
        time_ns = self._times.time_ns
        return (self.frames - 1) / (time_ns * 1e-9) if time_ns else float("nan")

    def add(self, stamp_ns: int, pixels: Pixels, metadata: bytes = b"") -> None:
        """Append a frame with its metadata, which all frames have or none has."""
        self._shape = self._shape or pixels.shape
        if pixels.shape != self._shape:
            raise VideoError(
                f"{self.path}: a frame of {pixels.shape[1]}x{pixels.shape[0]} pixels follows "
                f"frames of {self._shape[1]}x{self._shape[0]}"
            )
        with writing(self.path, VideoError):
            if self._encoder is None:
                form, size = _FORMS[self.path.suffix.lower()], (pixels.shape[1], pixels.shape[0])
                self._encoder = Encoder(str(self._part), form, size, metadata=bool(metadata))
            self._encoder.add(self._times.at(stamp_ns), pixels, metadata)
        self.frames += 1

    def __enter__(self) -> VideoFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if (kind is None or self._growing) and self._encoder is not None:
                with writing(self.path, VideoError):
                    self._encoder.finish()
                    self._part.replace(self.path)
        finally:
            if self._encoder is not None:
                with contextlib.suppress(OSError):
                    self._encoder.close()
            if not self._growing:
                self._part.unlink(missing_ok=True)
