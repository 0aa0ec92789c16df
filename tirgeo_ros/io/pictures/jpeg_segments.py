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
"""Read the segments of a JPEG, and keep a picture's metadata in another one (ITU-T T.81, B.1)."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from typing import BinaryIO

_SOI, SOS, _APP0, APP1 = b"\xff\xd8", 0xDA, 0xE0, 0xE1
_MOST = 1 << 14  # segments and fill bytes: the largest R-JPEG have some hundred
#: How segments APP1 with metadata begin: XMP, its extension, EXIF. FLIR has raw data in others.
XMP, EXTENSION = b"http://ns.adobe.com/xap/1.0/\0", b"http://ns.adobe.com/xmp/extension/\0"
_METADATA = (b"Exif\0", XMP, EXTENSION)


def segments(jpeg: bytes | BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield marker and content of each segment; the last of a whole file is SOS, before pixels.

    Of a cut file the whole ones are yielded, and of one with a header without end the first.
    """
    file = io.BytesIO(jpeg) if isinstance(jpeg, bytes) else jpeg
    file.seek(0)
    is_jpeg, marker = file.read(2) == _SOI, 0
    for _ in range(_MOST if is_jpeg else 0):
        if marker == SOS or file.read(1) != b"\xff":
            return
        marker = int.from_bytes(file.read(1), "big")
        if marker == 0xFF:  # fill bytes may stand before a marker
            file.seek(-1, os.SEEK_CUR)
            continue
        length = int.from_bytes(file.read(2), "big") - 2
        content = file.read(max(length, 0))
        if len(content) != length:
            return
        yield marker, content


def metadata_of(jpeg: bytes) -> bytes:
    """Return the segments with EXIF and XMP as they are; empty for a file that is no JPEG."""
    kept = (c for marker, c in segments(jpeg) if marker == APP1 and c.startswith(_METADATA))
    return b"".join(map(segment, kept))


def segment(content: bytes) -> bytes:
    """Return a segment APP1."""
    return b"\xff\xe1" + (len(content) + 2).to_bytes(2, "big") + content


def with_metadata(jpeg: bytes, metadata: bytes) -> bytes:
    """Return a JPEG with segments of ``metadata_of``, after its JFIF segment if it has one."""
    first = next(segments(jpeg), (0, b""))
    end = len(_SOI) + (4 + len(first[1]) if first[0] == _APP0 else 0)
    return jpeg[:end] + metadata + jpeg[end:]
