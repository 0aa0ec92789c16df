"""A video file from stamped frames: complete under its name, or not there."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import final

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.errors import VideoError

Pixels = npt.NDArray[np.uint8]

#: Frames that are looked at for the rate before the first is written.
_RATE_FROM = 10


@final
class VideoFile:
    """An MPEG-4 file (.mp4) of frames (h, w, 3) BGR; the rate is that of the first stamps.

    A context manager: the file takes its name when the block ends without an error, and if no
    frame came there is none. VideoError if it cannot be written or frames change their size.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.frames = 0
        self.rate_hz = float("nan")
        if self.path.suffix.lower() != ".mp4":
            raise VideoError(f"{self.path}: the video's name must end with .mp4")
        if not self.path.parent.is_dir():
            raise VideoError(f"{self.path}: no such folder {self.path.parent}")
        if self.path.exists() and not self.path.is_file():  # a device would be replaced
            raise VideoError(f"{self.path}: not a file; give the video another name")
        self._part = self.path.with_name(f".{self.path.stem}.{os.getpid()}.part.mp4")
        self._first: list[tuple[int, Pixels]] = []
        self._shape: tuple[int, ...] | None = None
        self._writer: cv2.VideoWriter | None = None

    def add(self, stamp_ns: int, pixels: Pixels) -> None:
        """Append a frame."""
        if self._shape is None:
            self._shape = pixels.shape
        if pixels.shape != self._shape:
            raise VideoError(
                f"{self.path}: a frame of {pixels.shape[1]}x{pixels.shape[0]} pixels follows "
                f"frames of {self._shape[1]}x{self._shape[0]}"
            )
        self.frames += 1
        if self._writer is not None:
            self._writer.write(pixels)
            return
        self._first.append((stamp_ns, pixels))
        if len(self._first) == _RATE_FROM:
            self._begin()

    def _begin(self) -> None:
        assert self._shape is not None
        self.rate_hz = _rate_hz([stamp_ns for stamp_ns, _ in self._first])
        code = cv2.VideoWriter.fourcc(*"mp4v")
        size = (self._shape[1], self._shape[0])
        self._writer = cv2.VideoWriter(str(self._part), code, self.rate_hz, size)
        if not self._writer.isOpened():
            raise VideoError(f"{self.path}: OpenCV cannot write MPEG-4 there")
        for _, pixels in self._first:
            self._writer.write(pixels)
        self._first.clear()

    def __enter__(self) -> VideoFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            if self._writer is not None:
                self._writer.release()
            with contextlib.suppress(FileNotFoundError):
                self._part.unlink()

    def _finish(self) -> None:
        if self._first:
            self._begin()
        if self._writer is not None:
            self._writer.release()
            self._part.replace(self.path)


def _rate_hz(stamps_ns: list[int]) -> float:
    """The middle of the intervals between stamps as a rate; 1 Hz where there is none."""
    steps = np.diff(np.array(stamps_ns, dtype=np.int64))
    steps = steps[steps > 0]
    return float(np.clip(1e9 / float(np.median(steps)), 0.1, 240.0)) if len(steps) else 1.0
