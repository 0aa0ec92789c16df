"""Write a video file from stamped frames: under its name it is complete or absent."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any, final

import numpy as np

from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import VideoError
from tirgeo_ros.io.files.whole_files import check_place, part_of

#: Codec, its options and those of the container, by the ending of the file name. Every browser
#: and player shows 4:2:0 in 8 bit. The quality is the one at which thin lines of the map still
#: have their colours. A key frame comes every 100 frames at most.
_FORMS: Mapping[str, tuple[str, dict[str, str], dict[str, str]]] = {
    ".mp4": (
        "libx264",
        {"preset": "veryfast", "crf": "26", "g": "100"},
        {"movflags": "+faststart"},  # the index comes first, so that it plays while it loads
    ),
    ".webm": (
        "libvpx-vp9",
        {"deadline": "realtime", "cpu-used": "6", "crf": "38", "b:v": "0", "g": "100"},
        {},
    ),
}
_CLOCK_HZ = 90_000
_FIRST_STEP_NS = 100_000_000
_LONGEST_STEP_NS = 10_000_000_000


@final
class VideoFile:
    """Write frames (h, w, 3) BGR as H.264 (.mp4) or VP9 (.webm), each with its own duration.

    A step between stamps that is not between 0 and 10 s is replaced by the step before it. If a
    side has an odd number of pixels, its last pixel is repeated. This is a context manager: the
    file gets its name when the block ends without an error; without a frame there is no file.
    Raise VideoError if it cannot be written or frames change their size.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.frames = 0
        if self.path.suffix.lower() not in _FORMS:
            raise VideoError(f"{path}: the video's name must end with {' or '.join(_FORMS)}")
        if not self.path.parent.is_dir():
            raise VideoError(f"{self.path}: no such folder {self.path.parent}")
        check_place(self.path, VideoError)
        self._part = part_of(self.path).with_suffix(self.path.suffix)
        try:
            str(self._part).encode()
        except UnicodeEncodeError:
            raise VideoError(
                f"{self.path}: FFmpeg takes names in UTF-8 alone; give another one"
            ) from None
        try:
            import av  # noqa: PLC0415  35 MB that only videos need
        except ImportError as error:
            raise VideoError(f"{path}: a video needs PyAV: pip install av ({error})") from error
        self._av = av
        self._shape: tuple[int, ...] | None = None
        self._last_stamp_ns: int | None = None
        self._step_ns = _FIRST_STEP_NS
        self._time_ns = 0
        self._container: Any = None
        self._stream: Any = None

    @property
    def rate_hz(self) -> float:
        """Return the mean rate of the frames, 1/s; NaN for fewer than two."""
        return (self.frames - 1) / (self._time_ns * 1e-9) if self._time_ns else float("nan")

    def add(self, stamp_ns: int, pixels: Pixels) -> None:
        """Append a frame."""
        self._shape = self._shape or pixels.shape
        if pixels.shape != self._shape:
            raise VideoError(
                f"{self.path}: a frame of {pixels.shape[1]}x{pixels.shape[0]} pixels follows "
                f"frames of {self._shape[1]}x{self._shape[0]}"
            )
        if self._last_stamp_ns is not None:
            step_ns = stamp_ns - self._last_stamp_ns
            if 0 < step_ns < _LONGEST_STEP_NS:
                self._step_ns = step_ns
            self._time_ns += self._step_ns
        self._last_stamp_ns = stamp_ns
        height, width = pixels.shape[:2]
        if height % 2 or width % 2:
            pixels = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), "edge")
        frame = self._av.VideoFrame.from_ndarray(pixels, format="bgr24")
        frame.pts = round(self._time_ns * 1e-9 * _CLOCK_HZ)
        frame.time_base = Fraction(1, _CLOCK_HZ)
        with self._writing():
            if self._container is None:
                self._open(frame.width, frame.height)
            self._write(frame)
        self.frames += 1

    def _open(self, width: int, height: int) -> None:
        codec, options, of_container = _FORMS[self.path.suffix.lower()]
        self._container = self._av.open(str(self._part), "w", options=of_container)
        stream = self._container.add_stream(codec, rate=30, options=options)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = Fraction(1, _CLOCK_HZ)
        self._stream = stream

    def _write(self, frame: Any) -> None:
        """Encode a frame (None at the end) and write the packets that are ready."""
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:  # PyAV's own errors are OSErrors too
            raise VideoError(f"{self.path}: cannot be written: {error.strerror}") from error

    def __enter__(self) -> VideoFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None and self._container is not None:
                with self._writing():
                    self._write(None)
                    self._container.close()
                    self._part.replace(self.path)
        finally:
            if self._container is not None:
                with contextlib.suppress(OSError):
                    self._container.close()
            self._part.unlink(missing_ok=True)
