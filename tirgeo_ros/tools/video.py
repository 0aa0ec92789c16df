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
from tirgeo_ros.io.whole_files import check_place, part_of

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
        check_place(self.path, VideoError)
        self._part = part_of(self.path).with_suffix(".mp4")
        if not _in_utf8(self._part):
            raise VideoError(f"{self.path}: OpenCV takes names in UTF-8 alone; give another one")
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
            self._check_whole()
            self._part.replace(self.path)

    def _check_whole(self) -> None:
        """Raise VideoError for less than was written: OpenCV says nothing of a full disk.

        After a write that failed nothing more is written, so that the index at the end tells all.
        """
        found = cv2.VideoCapture(str(self._part))
        count = int(found.get(cv2.CAP_PROP_FRAME_COUNT)) if found.isOpened() else 0
        found.release()
        if count != self.frames:
            why = _why_not_writable(self._part) or f"{count} of {self.frames} frames are in it"
            raise VideoError(f"{self.path}: cannot be written: {why}")


def _in_utf8(path: Path) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _why_not_writable(path: Path) -> str:
    """What the system says to more of a file; empty where it takes it."""
    try:
        with path.open("ab") as file:
            file.write(bytes(1 << 16))
            os.fsync(file.fileno())
    except OSError as error:
        return error.strerror or str(error)
    return ""


def _rate_hz(stamps_ns: list[int]) -> float:
    """The middle of the intervals between stamps as a rate; 1 Hz where there is none."""
    steps = np.diff(np.array(stamps_ns, dtype=np.int64))
    steps = steps[steps > 0]
    return float(np.clip(1e9 / float(np.median(steps)), 0.1, 240.0)) if len(steps) else 1.0
