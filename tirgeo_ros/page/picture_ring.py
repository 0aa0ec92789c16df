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
"""Keep the newest pictures of a video with what is drawn on them, in a file of limited size."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass, replace
from typing import IO, NamedTuple

#: Bytes of the disk that are left free for targets and recordings, but for so small a file.
_LEFT_FREE, _LEAST = 256 * 1024**2, 16 * 1000**2


@dataclass(frozen=True, slots=True)
class Picture:
    """Hold one picture of the video, and what is drawn on it."""

    number: int  # 1, 2, ... since the start
    stamp_ns: int
    begun_ns: int  # server's clock: when the picture was taken
    jpeg: bytes  # nothing is drawn on it
    shapes: bytes  # of io.messages.shapes_codec
    width: int
    height: int


class _Entry(NamedTuple):
    first: int  # place in the file
    picture: Picture  # without jpeg and shapes
    shapes_bytes: int
    jpeg_bytes: int

    @property
    def end(self) -> int:
        return self.first + self.shapes_bytes + self.jpeg_bytes


class PictureRing:
    """Keep the newest pictures, as many as fit into ``most_bytes``, fewer on a nearly full disk.

    They are in a file without a name, which ends with the program; a new picture is written over
    the oldest ones. ``fault`` is why the newest could not be kept, as on a full disk. Not
    thread-safe.
    """

    def __init__(self, most_bytes: int) -> None:
        self.fault = ""
        self._most, self._next, self._size = most_bytes, 0, 0
        self._entries: dict[int, _Entry] = {}  # by stamp, the oldest first
        self._file: IO[bytes] | None = None
        self._may_grow = True  # the disk has room left

    def add(self, picture: Picture) -> None:
        """Keep a picture; an empty one, or one larger than the whole file, is not kept."""
        size = len(picture.shapes) + len(picture.jpeg)
        if not 0 < size <= self._most:
            return
        self._entries.pop(picture.stamp_ns, None)
        if not self._has_room(self._next + size):
            self._drop_from(self._next, self._most)
            self._next = 0
        self._drop_from(self._next, self._next + size)
        if not self._written(picture.shapes + picture.jpeg):
            return
        bare = replace(picture, jpeg=b"", shapes=b"")
        entry = _Entry(self._next, bare, len(picture.shapes), len(picture.jpeg))
        self._entries[picture.stamp_ns] = entry
        self._next = entry.end
        self._size = max(self._size, entry.end)

    def _has_room(self, end: int) -> bool:
        """Return whether the file may reach to this place."""
        return end <= self._most and (self._may_grow or end <= max(self._size, _LEAST))

    def _written(self, data: bytes) -> bool:
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115  until close
            whole = os.pwrite(self._file.fileno(), data, self._next) == len(data)
            self.fault = "" if whole else "the disk is full"
            disk = os.fstatvfs(self._file.fileno())
            self._may_grow = disk.f_bavail * disk.f_frsize > _LEFT_FREE
        except OSError as error:
            self.fault = str(error.strerror or error)
        return not self.fault

    def get(self, stamp_ns: int) -> Picture | None:
        """Return the picture of a stamp, or None if it is not kept any more, or the disk fails."""
        entry = self._entries.get(stamp_ns)
        if entry is None or self._file is None:
            return None
        try:
            data = os.pread(self._file.fileno(), entry.end - entry.first, entry.first)
        except OSError as error:
            self.fault = str(error.strerror or error)
            return None
        cut = entry.shapes_bytes
        return replace(entry.picture, jpeg=data[cut:], shapes=data[:cut])

    def stamps_ns(self) -> list[int]:
        """Return the stamps of all pictures, in the order in which they came."""
        return [*self._entries]

    def close(self) -> None:
        """Remove the file."""
        self._entries.clear()
        if self._file is not None:
            self._file.close()

    def _drop_from(self, first: int, end: int) -> None:
        """Forget the pictures that lie in this part of the file: they are the oldest."""
        while self._entries:
            stamp, entry = next(iter(self._entries.items()))
            if entry.first >= end or entry.end <= first:
                return
            del self._entries[stamp]
