"""Frames as they are laid out, their check sums, and the writer."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame, crc16, crc32, encode_frame

KNOWN = bytes.fromhex("aa140000000000003800164e02000000d8afa076")


def read_all(data):
    reader = FrameReader()
    frames = reader.feed(data) + reader.rescan()
    return frames, reader.counts


def raw_frame(head, data=b""):
    """A frame of any first ten bytes, with right check sums."""
    head = bytes(head)
    head += crc16(head).to_bytes(2, "little")
    return head + data + crc32(head + data).to_bytes(4, "little")


def test_a_known_frame_is_read():
    ((frame,), counts) = read_all(KNOWN)
    assert frame == ProtocolFrame(0, 20, 0, False, 0, 0, 56, b"\x02\x00\x00\x00", False)
    assert (frame.cmd_set, frame.cmd_id, frame.value) == (2, 0, b"\x00\x00")
    assert counts["frames"] == 1
    assert counts["bytes"] == 20
    assert sum(counts.values()) == 21  # nothing else is counted


@given(
    data=st.binary(max_size=1007),
    session=st.integers(0, 31),
    sequence=st.integers(0, 0xFFFF),
    is_ack=st.booleans(),
)
def test_round_trip(data, session, sequence, is_ack):
    whole = encode_frame(data, session=session, sequence=sequence, is_ack=is_ack)
    ((frame,), _) = read_all(b"\xaa\x00" + whole)
    length = len(data) + 16 if data else 12
    assert frame == ProtocolFrame(2, length, session, is_ack, 0, 0, sequence, data, False)
    assert len(whole) == length


def test_the_shortest_and_the_longest():
    lone, bare = (
        raw_frame([0xAA, 12, 0, 0, 0, 0, 0, 0, 9, 0])[:12],
        raw_frame([0xAA, 16, *[0] * 8]),
    )
    longest = encode_frame(bytes(1007))
    assert len(longest) == 1023
    frames, counts = read_all(lone + bare + longest + lone)
    assert [(f.offset, f.length, len(f.data)) for f in frames] == [
        (0, 12, 0),
        (12, 16, 0),
        (28, 1023, 1007),
        (1051, 12, 0),
    ]
    assert counts["skipped_bytes"] == 0
    assert frames[0].sequence == 9
    assert encode_frame(b"", sequence=9) == lone


@pytest.mark.parametrize(
    ("byte", "value"),
    [
        *[(2, version << 2) for version in (1, 2, 32, 63)],
        *[(3, reserved << 6) for reserved in (1, 2, 3)],
        *[(byte, value) for byte in (5, 6, 7) for value in (1, 128, 255)],
        *[(0, sof) for sof in (0, 0x55, 0xA8, 0xAB)],
    ],
)
def test_header_fields_that_are_refused(byte, value):
    """With check sums that are right, so that these alone speak against it."""
    head = bytearray(KNOWN[:10])
    head[byte] = value
    frames, counts = read_all(raw_frame(head, KNOWN[12:16]) + KNOWN)
    assert [f.offset for f in frames] == [20]
    assert counts["skipped_bytes"] == 20
    assert counts["truncated"] == counts["bad_crc32"] == 0  # refused before its length is believed


@pytest.mark.parametrize("length", [*range(12), 13, 14, 15])
def test_lengths_that_are_refused(length):
    head = bytearray(KNOWN[:10])
    head[1] = length
    frames, counts = read_all(raw_frame(head, KNOWN[12:16]) + KNOWN)
    assert [f.offset for f in frames] == [20]
    assert counts["bad_headers"] == 1
    assert counts["bad_crc32"] == counts["truncated"] == 0


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
