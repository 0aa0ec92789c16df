"""Streams that a receiver must survive: intact frames among every kind of damage, from a seed."""

from __future__ import annotations

import random
from collections.abc import Callable

from tirgeo_ros.dji.link.framing import MAX_DATA_BYTES, crc16, encode_frame
from tirgeo_ros.dji.protocol.broadcast import Layout, broadcast_length
from tirgeo_ros.dji.protocol.subscription import USUAL_PACKAGES

#: What a part of the encrypted frames is encrypted with; the others have another key.
KEY = bytes(range(32))
_OTHER_KEY = bytes(32)
_MAX_GARBAGE = 200
_HEADER_VALUES = b"\xaa\x00\x01\x03\x10\x20\xff"


def damaged_stream(rng: random.Random, size: int) -> bytes:
    """``size`` bytes of pieces of every kind below, one behind another; the last may be cut."""
    pieces: list[bytes] = []
    left = size
    while left > 0:
        pieces.append(rng.choice(_KINDS)(rng))
        left -= len(pieces[-1])
    return b"".join(pieces)[:size]


def any_frame(rng: random.Random) -> bytes:
    """An intact frame with any data: of any length, ack, session, header alone, encrypted."""
    most = rng.choice((2, 40, 300, MAX_DATA_BYTES - 16))
    return encode_frame(
        rng.randbytes(rng.randint(0, most)),
        session=rng.randrange(32),
        sequence=rng.randrange(0x10000),
        is_ack=rng.random() < 0.2,
        key=rng.choice((None, None, None, KEY, _OTHER_KEY)),
    )


def _broadcast(rng: random.Random) -> bytes:
    """A push whose length fits its mask, of any numbers: NaN, infinities and all."""
    layout = rng.choice(tuple(Layout))
    mask = rng.getrandbits(rng.choice((3, 14)))
    length = broadcast_length(layout, mask) or 2
    return encode_frame(b"\x02\x00" + mask.to_bytes(2, "little") + rng.randbytes(length - 2))


def _push(rng: random.Random) -> bytes:
    package = rng.choice(USUAL_PACKAGES)
    return encode_frame(bytes([2, 5, package.id]) + rng.randbytes(package.length - 1))


def _false_header(rng: random.Random) -> bytes:
    """A header with any length, legal or not, and a right CRC-16; something else behind it."""
    length = rng.randrange(0x400)
    fields = bytes((0xAA, length & 0xFF, length >> 8, 0, rng.randrange(256), 0, 0, 0))
    fields += rng.randbytes(2)
    return fields + crc16(fields).to_bytes(2, "little")


def _flipped(rng: random.Random) -> bytes:
    frame = bytearray(any_frame(rng))
    frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
    return bytes(frame)


def _cut(rng: random.Random) -> bytes:
    frame = any_frame(rng)
    at = rng.randrange(len(frame))
    return frame[at:] if rng.random() < 0.3 else frame[:at]


def _shifted(rng: random.Random) -> bytes:
    """A byte too many or one lost, as by an overrun of the serial port."""
    frame = any_frame(rng)
    at = rng.randrange(len(frame))
    return frame[:at] + (rng.randbytes(1) + frame[at:] if rng.random() < 0.5 else frame[at + 1 :])


def _nested(rng: random.Random) -> bytes:
    """A frame, intact or not, in the data of another, intact or not."""
    inner = rng.choice((any_frame, _flipped, _false_header))(rng)[:500]
    outer = encode_frame(rng.randbytes(rng.randrange(30)) + inner + rng.randbytes(5))
    return outer if rng.random() < 0.5 else outer[:-1] + bytes([outer[-1] ^ 1])


_KINDS: tuple[Callable[[random.Random], bytes], ...] = (
    any_frame,
    _broadcast,
    _push,
    lambda rng: rng.randbytes(rng.randint(1, _MAX_GARBAGE)),
    # bytes that each could begin a frame
    lambda rng: b"\xaa" * rng.randint(1, _MAX_GARBAGE),
    # bytes of the values that headers are made of
    lambda rng: bytes(rng.choices(_HEADER_VALUES, k=rng.randint(12, _MAX_GARBAGE))),
    _false_header,
    _flipped,
    _cut,
    _shifted,
    _nested,
)
