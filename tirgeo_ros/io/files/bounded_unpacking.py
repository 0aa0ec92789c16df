"""Unpack chunks of bags: no more than they declare, and never beyond a bound.

A kilobyte can hold gigabytes when unpacked. Recorders close a chunk at about a megabyte. It is
larger where a single message is: a 4K picture of 16 bits and three colours has 50 MB.
"""

from __future__ import annotations

import bz2
import contextlib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import zstandard
from lz4.frame import LZ4FrameDecompressor

#: The largest unpacked size of a packed chunk.
MOST_BYTES = 64 << 20
_PIECE = 1 << 16  # of a cut or damaged chunk all is read but at most this many last bytes
_BROKEN = (zstandard.ZstdError, RuntimeError, OSError, EOFError, ValueError, MemoryError)


class Unpacked(NamedTuple):
    """Hold the data of a chunk and its fault ("" = none), such as ``is cut off or damaged``."""

    data: bytes
    fault: str


def unpacked(packed: bytes, compression: str, size: int | None) -> Unpacked:
    """Return a chunk's data as far as it can be unpacked.

    ``compression`` is ``zstd``, ``lz4``, ``bz2``, ``none`` or empty; ``size`` is the unpacked size
    that the chunk declares (None if it does not, because it was never closed).
    """
    if compression in {"", "none"}:
        return Unpacked(packed, "")
    pieces = _PIECES.get(compression)
    if pieces is None:
        return Unpacked(b"", f"is packed as {compression!r}, which is not known")
    if size is not None and size > MOST_BYTES:
        most = MOST_BYTES >> 20
        return Unpacked(b"", f"holds {size >> 20} MiB, and a chunk may hold {most}: not read")
    found, total = [], 0
    try:
        for piece in pieces(packed, (MOST_BYTES if size is None else size) + 1):
            found.append(piece)
            total += len(piece)
    except _BROKEN:
        total = -1
    return Unpacked(b"".join(found)[:size], "" if total == size else "is cut off or damaged")


def _by_zstd(packed: bytes, most: int) -> Iterator[bytes]:
    """Yield at most ``most`` bytes, in one piece (a third of the time) if the frame fits."""
    if zstandard.frame_content_size(packed) in range(most):
        with contextlib.suppress(zstandard.ZstdError):  # damaged: its beginning is read in pieces
            yield zstandard.ZstdDecompressor().decompress(packed)
            return
    reader = zstandard.ZstdDecompressor().stream_reader(packed)
    while piece := reader.read(min(_PIECE, most)):
        most -= len(piece)
        yield piece


def _by_lz4(packed: bytes, most: int) -> Iterator[bytes]:
    return _fed(LZ4FrameDecompressor(), packed, most)


def _by_bz2(packed: bytes, most: int) -> Iterator[bytes]:
    return _fed(bz2.BZ2Decompressor(), packed, most)


def _fed(unpacker: Any, packed: bytes, most: int) -> Iterator[bytes]:
    at = 0
    while most and not unpacker.eof and (at < len(packed) or not unpacker.needs_input):
        fed = packed[at : at + _PIECE] if unpacker.needs_input else b""
        at += len(fed)
        piece = unpacker.decompress(fed, most)
        most -= len(piece)
        yield piece


_PIECES: dict[str, Callable[[bytes, int], Iterator[bytes]]] = {
    "zstd": _by_zstd,
    "lz4": _by_lz4,
    "bz2": _by_bz2,
}
