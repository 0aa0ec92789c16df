"""Compute the two check sums of the OPEN protocol.

Both are reflected, start from a shift register of 0x3AA3 and end without an XOR. Computed over
data that is followed by its own check sum (little-endian), each is 0.
"""

from __future__ import annotations

import zlib

#: Initial value of both shift registers.
START = 0x3AA3
_POLYNOMIAL_16 = 0xA001  # 0x8005 reflected
_ALL_ONES = 0xFFFFFFFF


def _table() -> tuple[int, ...]:
    """Return the effect of eight shifts on each value of the low byte."""
    entries = []
    for value in range(256):
        register = value
        for _ in range(8):
            register = (register >> 1) ^ (_POLYNOMIAL_16 if register & 1 else 0)
        entries.append(register)
    return tuple(entries)


_TABLE_16 = _table()


def crc16(data: bytes) -> int:
    """Return the CRC-16 of a header's first ten bytes; 0 over all twelve of an intact header."""
    register = START
    for byte in data:
        register = (register >> 8) ^ _TABLE_16[(register ^ byte) & 0xFF]
    return register


def crc32(data: bytes) -> int:
    """Return the CRC-32 of a frame without its last four bytes; 0 over the whole intact frame.

    zlib's CRC-32 has the same polynomial, but inverts the register before the first byte and after
    the last.
    """
    return zlib.crc32(data, START ^ _ALL_ONES) ^ _ALL_ONES
