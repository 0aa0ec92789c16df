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
"""Unpack what recorders compressed: chunks, single messages, whole files.

A packed kilobyte can hold gigabytes, hence MOST_BYTES. Recorders close a chunk at about a
megabyte, but one message may be larger: a 4K picture of 16 bits and three colours has 50 MB.
"""

from __future__ import annotations

import bz2
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import zstandard

from tirgeo_ros.core.types.errors import BagError

#: The largest unpacked size of a packed chunk.
MOST_BYTES = 64 << 20
_BROKEN = (zstandard.ZstdError, RuntimeError, OSError, EOFError, ValueError, MemoryError)
#: Bytes that stay free on the disk. A file may unpack to _MOST_RATIO times its size and 64 MiB:
#: recordings shrink to a third, pictures without noise to a hundredth.
_FREE_BYTES, _MOST_RATIO, _SMALL_BYTES = 256 << 20, 1000, 64 << 20
_PIECE = 1 << 20


def unpacked_message(data: bytes) -> bytes:
    """Return the CDR of a message packed by zstd. Raises ValueError as ``unpacked`` does."""
    try:
        size = zstandard.frame_content_size(data)
    except zstandard.ZstdError:
        raise ValueError("is cut off or damaged") from None
    return unpacked(data, "zstd", size if size >= 0 else None)


def unpacked(
    packed: bytes, compression: str, size: int | None = None, *, cut: bool = False
) -> bytes:
    """Return the unpacked data of a chunk; of one that is ``cut``, its beginning.

    ``compression`` is ``zstd``, ``lz4``, ``bz2``, ``none`` or empty; ``size`` is the unpacked size
    that the chunk declares, or None. Raises ValueError with words that continue a sentence about
    the chunk: ``is cut off or damaged``.
    """
    if compression in {"", "none"}:
        return packed
    if compression not in _UNPACK:
        raise ValueError(f"is compressed as {compression!r}, which is not supported")
    most = min(MOST_BYTES, MOST_BYTES if size is None else size)
    try:
        data = _UNPACK[compression](packed, most + 1)
    except _BROKEN:
        raise ValueError("is cut off or damaged") from None
    if len(data) > MOST_BYTES:
        raise ValueError(f"holds more than {MOST_BYTES >> 20} MiB: not read")
    if size is not None and len(data) != size and not cut:
        raise ValueError("is cut off or damaged")
    return data


def _by_zstd(packed: bytes, most: int) -> bytes:
    """Return at most ``most`` bytes; at once, in a third of the time, if the frame fits."""
    unpacker = zstandard.ZstdDecompressor()
    if zstandard.frame_content_size(packed) in range(most):
        with suppress(zstandard.ZstdError):  # a cut frame: the stream reads its beginning
            return unpacker.decompress(packed)
    return unpacker.stream_reader(packed).read(most)


def unpack_file(path: Path, copy: Path) -> None:
    """Unpack a file to ``copy``; a damaged one up to the fault, which its reader reports."""
    free = shutil.disk_usage(copy.parent).free - _FREE_BYTES
    most = path.stat().st_size * _MOST_RATIO + _SMALL_BYTES
    with path.open("rb") as file, copy.open("wb") as out, suppress(zstandard.ZstdError):
        stream = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
        while piece := stream.read(_PIECE):
            written = out.tell() + len(piece)
            if written > most:
                times = f"{_MOST_RATIO} times its size"
                raise BagError(f"{path}: unpacks to more than {times}: not read")
            if written > free:
                raise OSError(f"only {max(free, 0) >> 20} MiB are free there")
            out.write(piece)
    if not copy.stat().st_size:
        raise BagError(f"{path}: the compressed file is cut off or damaged: nothing can be read")


def _by_lz4(packed: bytes, most: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor  # noqa: PLC0415  only chunks of MCAP need it

    return bytes(LZ4FrameDecompressor().decompress(packed, most))


_UNPACK: dict[str, Callable[[bytes, int], bytes]] = {
    "zstd": _by_zstd,
    "lz4": _by_lz4,
    "bz2": lambda packed, most: bz2.BZ2Decompressor().decompress(packed, most),
}
