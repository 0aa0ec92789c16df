"""Unpack chunks of bags: no more than they declare, and never beyond a bound.

A kilobyte can hold gigabytes when unpacked. Recorders close a chunk at about a megabyte. It is
larger where a single message is: a 4K picture of 16 bits and three colours has 50 MB.
"""

from __future__ import annotations

import bz2
from collections.abc import Callable
from contextlib import suppress

import zstandard
from lz4.frame import LZ4FrameDecompressor

#: The largest unpacked size of a packed chunk.
MOST_BYTES = 64 << 20
_BROKEN = (zstandard.ZstdError, RuntimeError, OSError, EOFError, ValueError, MemoryError)


def unpacked(
    packed: bytes, compression: str, size: int | None = None, *, cut: bool = False
) -> bytes:
    """Return the data of a chunk.

    ``compression`` is ``zstd``, ``lz4``, ``bz2``, ``none`` or empty; ``size`` is the unpacked size
    that the chunk declares, where it does. Of a chunk that is ``cut`` the beginning is returned.
    Raises ValueError: ``is cut off or damaged``.
    """
    if compression in {"", "none"}:
        return packed
    if compression not in _UNPACK:
        raise ValueError(f"is packed as {compression!r}, which is not known")
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
    """Return at most ``most`` bytes, in one piece (a third of the time) if the frame fits."""
    unpacker = zstandard.ZstdDecompressor()
    if zstandard.frame_content_size(packed) in range(most):
        with suppress(zstandard.ZstdError):  # a cut one has a beginning
            return unpacker.decompress(packed)
    return unpacker.stream_reader(packed).read(most)


_UNPACK: dict[str, Callable[[bytes, int], bytes]] = {
    "zstd": _by_zstd,
    "lz4": lambda packed, most: bytes(LZ4FrameDecompressor().decompress(packed, most)),
    "bz2": lambda packed, most: bz2.BZ2Decompressor().decompress(packed, most),
}
