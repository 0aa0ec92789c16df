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
"""Read pictures for calibrations: from files, from folders, or from a bag's thermal video."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.calibration.board_detection import grey_of
from tirgeo_ros.core.calibration.checkerboard import RefusalReason, Refused
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import RawPixels
from tirgeo_ros.core.types.errors import BagError, CalibrationError, TirgeoError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr, by_numbers, is_bag
from tirgeo_ros.io.messages import pictures as picture_messages
from tirgeo_ros.io.messages.pictures import MOST_OF_FILE, unpacked
from tirgeo_ros.io.messages.topics import CAMERA_INFO, resolved
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.replay.registration import picture_topic

_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".webp")
#: Why a picture without pixels is not used.
UNREADABLE = Refused(RefusalReason.UNREADABLE, "it is not a picture of 8 or 16 bits")
_ANY_DEPTH = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR


class Picture(NamedTuple):
    """Hold one picture; its pixels are None if it cannot be read."""

    name: str
    stamp_ns: int | None  # of a picture from a bag
    pixels: RawPixels | None


def opened(inputs: Sequence[Path], namespace: str) -> tuple[list[Path], BoardVideo | None]:
    """Return the files to read, and the video if the only input is a bag.

    Raise CalibrationError for a bag among other inputs, or inputs without pictures; BagError.
    """
    bags = [path for path in inputs if is_bag(path)]
    if bags and len(inputs) > 1:
        raise CalibrationError(f"{bags[0]}: give either one bag or pictures")
    return (bags, BoardVideo(bags[0], namespace)) if bags else (files_of(inputs), None)


def files_of(paths: Sequence[Path]) -> list[Path]:
    """Return the picture files: the given ones, and those in folders, sorted by their numbers.

    Raise CalibrationError for a path that does not exist, or a folder without pictures.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            inside = [file for file in path.iterdir() if file.suffix.lower() in _SUFFIXES]
            if not inside:
                raise CalibrationError(f"{path}: no pictures in it; use {' '.join(_SUFFIXES)}")
            files += sorted(inside, key=by_numbers)
        elif path.is_file():
            files.append(path)
        else:
            raise CalibrationError(f"{path}: there is no such file or folder")
    return list(dict.fromkeys(files))


def pictures_of_files(files: Sequence[Path], progress: Report) -> Iterator[Picture]:
    """Yield the pictures of files, in order: (h, w) uint8 or uint16, or (h, w, 3) uint8.

    They are named by file name, or by path if two files have the same name. Raise
    CalibrationError for a picture that is too large.
    """
    short = len({path.name for path in files}) == len(files)
    for number, path in enumerate(files):
        progress(number, len(files))
        pixels = None
        with suppress(OSError):
            try:
                pixels = unpacked(path.read_bytes(), _ANY_DEPTH, MOST_OF_FILE)
            except ValueError as error:
                raise CalibrationError(f"{path}: {error}") from None
        if pixels is not None and pixels.ndim == 3 and pixels.dtype == np.uint16:
            pixels = pixels[..., 0]  # 16 bit grey, written as colour by a program that lacks it
        readable = pixels is not None and pixels.dtype in (np.uint8, np.uint16)
        yield Picture(path.name if short else str(path), None, pixels if readable else None)


class BoardVideo:
    """Read the thermal pictures of a bag, and its camera.

    Raise BagError if there are no pictures.
    """

    def __init__(self, bag: Path, namespace: str) -> None:
        self.reader = BagReader(bag)
        self._topic, self._name = picture_topic(self.reader, namespace)
        self._info = resolved(CAMERA_INFO, namespace)
        self._cdr = Cdr()

    def pictures(self, progress: Report) -> Iterator[Picture]:
        """Yield all pictures, in order; call ``progress`` with seconds."""
        first_ns, last_ns = self.reader.span_ns
        for message in self.reader.messages([self._name]):
            progress((message.log_time_ns - first_ns) * 1e-9, (last_ns - first_ns) * 1e-9)
            try:
                decoded = self._cdr.deserialize(message.data, message.typename)
                stamp_ns = convert.stamp_ns(decoded)
                pixels = picture_messages.pixels(self._topic, decoded)
                yield Picture(f"{stamp_ns / 1e9:.3f}", stamp_ns, pixels)
            except TirgeoError:
                yield Picture(f"{message.log_time_ns / 1e9:.3f}", None, None)

    def camera(self) -> Camera:
        """Return the camera of the first ``thermal/camera_info``. Raise BagError, CameraError."""
        if self._info not in self.reader.topics():
            raise BagError(f"{self.reader.path}: topic absent: {self._info}; give --camera")
        message = next(iter(self.reader.messages([self._info])), None)
        if message is None:
            raise BagError(
                f"{self.reader.path}: no message of {self._info} can be read; give --camera"
            )
        decoded = self._cdr.deserialize(message.data, message.typename)
        return picture_messages.camera(decoded, self._info)


def sharpest(pictures: Iterator[Picture], every_s: float) -> Iterator[Picture]:
    """Yield the sharpest picture of each ``every_s`` of a video, and all unreadable ones."""
    best: Picture | None = None
    most, begun_ns = 0.0, 0
    for picture in pictures:
        if picture.pixels is None or picture.stamp_ns is None:
            yield picture
            continue
        if best is not None and not 0 <= picture.stamp_ns - begun_ns < every_s * 1e9:
            yield best
            best = None
        # The mean square gradient of the slightly smoothed picture: noise counts little.
        smooth = cv2.GaussianBlur(grey_of(picture.pixels).astype(np.float32), (0, 0), 1.0)
        score = float(sum((np.diff(smooth, axis=axis) ** 2).mean() for axis in (0, 1)))
        if best is None:
            begun_ns, most = picture.stamp_ns, -1.0
        if score > most:
            most, best = score, picture
    if best is not None:
        yield best


def thinned(pictures: Iterator[Picture], rate_hz: float) -> Iterator[Picture]:
    """Yield ``rate_hz`` pictures a second of a video, evenly spaced, and all unreadable ones."""
    step_ns = 1e9 / rate_hz
    due_ns = -math.inf
    for picture in pictures:
        if picture.stamp_ns is None:
            yield picture
        elif not due_ns - 2 * step_ns < picture.stamp_ns < due_ns:
            # Begin the steps anew at the first picture, after a gap, and after a clock was set.
            anew = not 0 <= picture.stamp_ns - due_ns < step_ns
            due_ns = (picture.stamp_ns if anew else due_ns) + step_ns
            yield picture
