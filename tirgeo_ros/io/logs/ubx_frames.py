"""Find the frames of u-blox's UBX protocol in a stream of bytes.

A frame is two sync characters, class, id, length (little-endian), payload and two bytes of an
8-bit Fletcher sum (u-blox F9 interface description, UBX frame structure). Whatever stands between
frames is passed over: NMEA, RTCM, comments. A frame counts only with its sum right, and the search
goes on behind the sync characters of one that is wrong, so that a damaged length costs one frame.
(The reader of pyubx2 takes a damaged length at its word.)
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

_SYNC = b"\xb5\x62"
_HEAD, _SUM = 6, 2  # bytes before and behind the payload


def ubx_frames(data: bytes) -> Iterator[bytes | None]:
    """Yield the frames in order; None for sync characters without a whole frame behind them."""
    place = data.find(_SYNC)
    while place >= 0:
        end = place + _HEAD + int.from_bytes(data[place + 4 : place + 6], "little") + _SUM
        whole = end <= len(data) and _sum(data[place + 2 : end - _SUM]) == data[end - _SUM : end]
        yield data[place:end] if whole else None
        place = data.find(_SYNC, end if whole else place + len(_SYNC))


def is_ubx(head: bytes) -> bool:
    """Return whether a whole frame is in the first bytes of a file."""
    return any(ubx_frames(head))


def _sum(data: bytes) -> bytes:
    """Return the two bytes of the 8-bit Fletcher sum (RFC 1145)."""
    values = np.frombuffer(data, np.uint8).astype(np.int64)
    first = int(values.sum())
    second = int(values @ np.arange(len(values), 0, -1))
    return bytes([first & 255, second & 255])
