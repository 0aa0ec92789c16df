"""The check sums: their published check values, their zero, and bit by bit."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.dji.protocol.crc import crc16, crc32

#: Check sum, polynomial, start in unreflected notation, bits.
SUMS = [(crc16, 0x8005, 0xC55C, 16), (crc32, 0x04C11DB7, 0xC55C0000, 32)]


def reversed_bits(value, bits):
    return int(f"{value:0{bits}b}"[::-1], 2)


def bit_by_bit(data, polynomial, start, bits):
    """The long division as books give it: unreflected, with bytes and result turned round."""
    top, register = 1 << (bits - 1), start
    for byte in data:
        register ^= reversed_bits(byte, 8) << (bits - 8)
        for _ in range(8):
            register = (register << 1) ^ (polynomial if register & top else 0)
            register &= 2 * top - 1
    return reversed_bits(register, bits)


@pytest.mark.parametrize(("check_sum", "expected"), [(crc16, 0x2752), (crc32, 0xE4D9DC14)])
def test_check_values(check_sum, expected):
    assert check_sum(b"123456789") == expected


@pytest.mark.parametrize(("check_sum", "polynomial", "start", "bits"), SUMS)
@given(data=st.binary(max_size=40))
def test_equals_the_long_division(check_sum, polynomial, start, bits, data):
    assert check_sum(data) == bit_by_bit(data, polynomial, start, bits)
