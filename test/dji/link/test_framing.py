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
"""Frames, check sums, encoding, AES-256; damaged and cut streams, in pieces of any size."""

from __future__ import annotations

import random
import sys
from itertools import pairwise

import pytest
from hypothesis import given, settings, strategies as st

from dev.fuzz import KEY, damaged_stream
from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.link import framing
from tirgeo_ros.dji.link.framing import (
    MAX_BYTES,
    FrameReader,
    ProtocolFrame,
    crc16,
    crc32,
    encode_frame,
    parse_key,
)

KNOWN = bytes.fromhex("aa140000000000003800164e02000000d8afa076")


def read_with(data, key=None):
    reader = FrameReader(key)
    return reader.feed(data) + reader.rescan(), reader.counts


def raw_frame(head, data=b""):
    """Return a frame with any first ten bytes and right check sums."""
    head = bytes(head)
    head += crc16(head).to_bytes(2, "little")
    return head + data + crc32(head + data).to_bytes(4, "little")


def test_a_known_frame_is_read():
    ((frame,), counts) = read_with(KNOWN)
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
    ((frame,), _) = read_with(b"\xaa\x00" + whole)
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
    frames, counts = read_with(lone + bare + longest + lone)
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
        *[(1, length) for length in (*range(12), 13, 14, 15)],
    ],
)
def test_header_fields_that_are_refused(byte, value):
    """The check sums are right, so that only these fields are wrong."""
    head = bytearray(KNOWN[:10])
    head[byte] = value
    frames, counts = read_with(raw_frame(head, KNOWN[12:16]) + KNOWN)
    assert [f.offset for f in frames] == [20]
    assert counts["skipped_bytes"] == 20
    assert counts["bad_headers"] == (byte == 1)
    assert counts["truncated"] == counts["bad_crc32"] == 0  # refused before its length is believed


FRAMES = [encode_frame(bytes([2, 0, *range(size)]), sequence=size) for size in (2, 60, 31, 200)]


def read_in(pieces, key=None):
    reader, frames = FrameReader(key), []
    for piece in pieces:
        frames += reader.feed(piece)
        assert reader.buffered < MAX_BYTES
    frames += reader.rescan()
    assert reader.buffered == 0
    return frames, reader.counts


def offsets(frames):
    return [frame.offset for frame in frames]


def cut_at(data, places):
    places = [0, *sorted(places), len(data)]
    return [data[start:stop] for start, stop in pairwise(places)]


def false_header(length=MAX_BYTES):
    """Return a header with a right check sum, without the rest of its frame."""
    return raw_frame([0xAA, length & 0xFF, length >> 8, *[0] * 7])[:12]


@given(seed=st.integers(0, 2**32), data=st.data())
@settings(max_examples=60)
def test_the_frames_do_not_depend_on_the_pieces(seed, data):
    stream = damaged_stream(random.Random(seed), 4000)
    places = data.draw(st.lists(st.integers(0, len(stream)), max_size=60))
    expected = read_with(stream, KEY)
    assert read_in(cut_at(stream, places), KEY) == expected
    assert read_in(cut_at(stream, range(len(stream))), KEY) == expected


def test_no_flipped_bit_is_accepted():
    before, hit, behind = FRAMES[0], FRAMES[1], FRAMES[2]
    for bit in range(8 * len(hit)):
        damaged = bytearray(hit)
        damaged[bit // 8] ^= 1 << bit % 8
        frames, counts = read_with(before + damaged + behind)
        assert offsets(frames) == [0, len(before) + len(hit)]
        assert counts["skipped_bytes"] == len(hit)


def test_a_frame_cut_anywhere_costs_no_other():
    """Not even if its length field includes bytes of the next frames."""
    for kept in range(len(FRAMES[3])):
        frames, counts = read_with(FRAMES[3][:kept] + FRAMES[0] + FRAMES[2])
        assert offsets(frames) == [kept, kept + len(FRAMES[0])]
        assert counts["skipped_bytes"] == kept
        # Its header is known to be one, and the rest is wrong or does not come.
        assert counts["truncated"] + counts["bad_crc32"] == (kept >= 12)


@pytest.mark.parametrize("before", [b"\xaa", b"\xaa\xaa", b"\xaa\x20\x00"])
def test_a_stray_start_costs_no_frame_of_any_length(before):
    """It may form a header with the frame's own first bytes."""
    for size in range(1008):
        whole = encode_frame(bytes(size), session=1)
        frames, counts = read_with(before + whole)
        assert [(f.offset, f.length) for f in frames] == [(len(before), len(whole))]
        assert counts["skipped_bytes"] == len(before)


def test_frames_after_a_dropped_frame_are_read():
    """As after a pause of the line: a header states 1023 bytes, but two frames follow."""
    reader = FrameReader()
    assert reader.feed(false_header() + FRAMES[0] + FRAMES[1]) == []
    assert reader.buffered == 12 + len(FRAMES[0] + FRAMES[1])
    assert offsets(reader.rescan()) == [12, 12 + len(FRAMES[0])]
    assert reader.buffered == 0
    assert reader.counts["truncated"] == 1
    # The stream goes on: offsets count from its beginning.
    at = 12 + len(FRAMES[0] + FRAMES[1])
    assert offsets(reader.feed(FRAMES[2])) == [at]


HOSTILE = {
    "starts": b"\xaa" * 200_000,
    "headers": false_header() * 20_000,
    "headers_of_all_lengths": b"".join(map(false_header, range(16, 1024))) * 10,
    "wrong_headers": (false_header()[:-1] + b"\x00") * 20_000,
    "zeros": bytes(200_000),
    "starts_and_zeros": b"\xaa\x10" + b"\x00" * 6 + b"\xaa\x20\x00" * 60_000,
}


@pytest.mark.parametrize("most", [1, 64, 5000, 10**6])
@pytest.mark.parametrize("name", HOSTILE)
def test_the_work_on_hostile_streams_is_bounded(name, most, monkeypatch):
    """Counted, not timed: one CRC-32 per header, two CRC-16 if the reader waits for the frame."""
    stream = HOSTILE[name]
    if most == 1:
        stream = stream[:20_000]
    summed = {"crc16": 0, "crc32": 0}

    def counting(name, function):
        def count(data):
            summed[name] += len(data)
            return function(data)

        return count

    for each in summed:
        monkeypatch.setattr(framing, each, counting(each, getattr(framing, each)))
    frames, counts = read_in(cut_at(stream, range(most, len(stream), most)))
    assert frames == []
    assert counts["skipped_bytes"] == len(stream)
    headers = counts["bad_headers"] + counts["bad_crc32"] + counts["truncated"]
    # Of eight bytes from a header's first on, but one can start another: its second or its fifth.
    assert headers <= 2 * len(stream) / 8
    assert summed["crc16"] <= 2 * 12 * headers
    assert summed["crc32"] <= MAX_BYTES * counts["bad_crc32"]


CIPHER_KEY = bytes(range(32))

#: NIST SP 800-38A, F.1.5 and F.1.6: ECB-AES256, four blocks.
NIST_KEY = "603deb1015ca71be2b73aef0857d77811f352c073b6108d72d9810a30914dff4"
NIST_CLEAR = bytes.fromhex(
    "6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e51"
    "30c81c46a35ce411e5fbc1191a0a52eff69f2445df4f9b17ad2b417be66c3710"
)
NIST_CIPHER = bytes.fromhex(
    "f3eed1bdb5d2a03c064b5a7e3db181f8591ccb10d410ed26dc5ba74a31362870"
    "b6ed21b99ca6f4f9f153e7b1beafed1d23304b7a39f9f3ff067d8d8f9e24ecc7"
)


def read(data, key=CIPHER_KEY):
    reader = FrameReader(key)
    (frame,) = reader.feed(data)
    return frame, reader.counts


def frame_of(cipher, padding, encryption=1):
    """Return a frame of data that is encrypted already."""
    plain = encode_frame(cipher)
    head = plain[:4] + bytes([padding | encryption << 5]) + plain[5:10]
    return raw_frame(head, cipher)


def test_the_published_vector_in_a_frame():
    """The vector's last block is taken as padding: the first three are returned."""
    frame, counts = read(frame_of(NIST_CIPHER, 16), parse_key(NIST_KEY))
    assert frame.data == NIST_CLEAR[:48]
    assert (frame.encryption, frame.padding, frame.is_encrypted) == (1, 16, False)
    assert (frame.cmd_set, frame.cmd_id) == (0x6B, 0xC1)
    assert counts["encrypted"] == 1


def test_without_a_key_it_is_counted_and_not_read():
    whole = encode_frame(b"\x02\x00\x00\x00", key=CIPHER_KEY)
    frame, counts = read(whole, key=None)
    assert frame.is_encrypted
    assert frame.data == whole[12:-4]
    assert (frame.cmd_set, frame.cmd_id, frame.value) == (None, None, b"")
    assert counts["encrypted"] == 1


@pytest.mark.parametrize(
    ("size", "padding"), [(0, 16), (4, 4), (17, 1), (31, 8), (16, 0), (32, 17), (32, 31)]
)
def test_data_that_cannot_be_encrypted_is_counted(size, padding):
    empty = raw_frame([0xAA, 16, 0, 0, padding | 1 << 5, *[0] * 5])
    frame, counts = read(frame_of(bytes(size), padding) if size else empty)
    assert frame.is_encrypted
    assert frame.data == bytes(size)
    assert frame.value == b""
    assert (counts["frames"], counts["encrypted"]) == (1, 1)


@pytest.mark.parametrize(
    "text", ["ab" * 31, "ab" * 33, "xy" * 32, "ab " * 21 + "a", "0x" + "ab" * 31, "\u0663" * 64]
)
def test_an_invalid_key_is_refused(text):
    with pytest.raises(DjiError, match=r"^key: \d+ characters .* 64 hexadecimal digits") as caught:
        parse_key(text)
    assert text not in str(caught.value)  # it may be a secret but for one digit
    assert "\n" not in str(caught.value)


def test_without_the_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography.hazmat.primitives.ciphers", None)
    line = r'^key needs cryptography: pip install "tirgeo\[dji\]"$'
    with pytest.raises(DjiError, match=line):
        FrameReader(CIPHER_KEY)
    with pytest.raises(DjiError, match=line):
        encode_frame(b"\x00\x00", key=CIPHER_KEY)
    assert FrameReader().feed(encode_frame(b"\x00\x00")) != []
