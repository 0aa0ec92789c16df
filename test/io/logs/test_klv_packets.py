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
"""Packets out of damaged and hostile bytes: none is lost but the damaged one, all are counted."""

from __future__ import annotations

import random
import tracemalloc
from itertools import pairwise

import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.io.logs.klv_packets import PacketReader
from tirgeo_ros.io.logs.log_contents import LogContents
from tirgeo_ros.io.video.frame_metadata import KEY, ber, packet

WRONG_SUM = ("packet", "wrong checksum")
CUT_OFF = ("packet", "cut off")
IMPOSSIBLE = ("packet", "its length is impossible")
TOO_LONG = ("packet", "an item runs over its end")


def flight(number):
    """Packets at 1, 2, ... ms since 1970, each with a place."""
    return [packet(k * 1_000_000, {13: 48.0, 14: 11.0, 10: "x" * k}) for k in range(1, number + 1)]


def read(*pieces):
    """Times (us) of the packets in the pieces, with the piece's number, and what was refused."""
    contents = LogContents()
    reader, sets = PacketReader(contents), []
    for number, piece in enumerate(pieces):
        sets += reader.take(piece, float(number))
    sets += reader.take(b"", last=True)
    times = [(int.from_bytes(items[2], "big"), time_s) for items, time_s in sets]
    return times, contents.refused


@given(st.data(), st.lists(st.binary(max_size=40), min_size=3, max_size=6))
def test_packets_are_whole_however_the_bytes_come(data, noises):
    """In pieces of any size, with noise between; each has the time of the piece it begins in."""
    packets, stream, begins = flight(len(noises)), b"", []
    for noise, content in zip(noises, packets, strict=True):
        stream += noise.replace(KEY[:1], b"") + b"."
        begins.append(len(stream))
        stream += content
    cuts = data.draw(st.sets(st.integers(1, len(stream) - 1), max_size=8))
    ends = [0, *sorted(cuts), len(stream)]
    times, refused = read(*(stream[a:b] for a, b in pairwise(ends)))
    piece_of = [sum(begin >= end for end in ends[1:]) for begin in begins]
    assert times == [(1000 * (k + 1), float(piece)) for k, piece in enumerate(piece_of)]
    assert not refused


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda p: p[:30] + bytes((p[30] ^ 1,)) + p[31:], WRONG_SUM),
        (lambda p: p[:16] + ber(len(p) + 60) + p[17:], TOO_LONG),  # it reaches into the next
        (lambda p: p[:40], TOO_LONG),  # a piece is lost
        (lambda p: p[:16] + b"\x88" + (1 << 60).to_bytes(8, "big") + p[17:], IMPOSSIBLE),
        (lambda p: p[:16] + b"\x80" + p[17:], IMPOSSIBLE),  # the indefinite form
        (lambda p: p[:16] + b"\xff" + p[17:], IMPOSSIBLE),
    ],
)
def test_a_damaged_packet_costs_no_other(change, reason):
    first, second, third, fourth = flight(4)
    times, refused = read(first + change(second) + third + fourth)
    assert [time for time, _ in times] == [1000, 3000, 4000]
    assert refused == {reason: 1}


def test_a_packet_without_its_end_is_counted():
    first, second = flight(2)
    assert read(first + second[:-5]) == ([(1000, 0.0)], {CUT_OFF: 1})
    times, refused = read(KEY + ber(60_000) + first)  # the false length reaches over the end
    assert (times, refused) == ([(1000, 0.0)], {CUT_OFF: 1})


def test_packets_without_a_checksum_and_with_large_tags():
    items = b"\x02\x08" + (5000).to_bytes(8, "big") + b"\x81\x0e\x01\x1e"
    contents = LogContents()
    ((result, _),) = PacketReader(contents).take(KEY + ber(len(items)) + items)
    assert result == {2: items[2:10], 142: b"\x1e"}
    assert contents.read == {"packet": 1}


def test_other_sets_are_refused_by_name():
    moving = bytes.fromhex("060e2b34020b01010e01030306000000") + ber(3) + b"abc"
    secure = bytes.fromhex("060e2b34020301010e01030302000000") + ber(130) + bytes(130)
    times, refused = read(moving + flight(1)[0] + secure)
    assert [time for time, _ in times] == [1000]
    assert {name for name, _ in refused} == {
        "moving targets of ST 0903",
        "security set of ST 0102",
    }


def test_hostile_bytes_take_bounded_memory_and_time():
    """Noise, keys that claim all that a packet may have, and many that hold nothing."""
    rng, contents = random.Random(3), LogContents()
    noise, reader = rng.randbytes(1 << 20), PacketReader(contents)
    claims = b"".join(KEY + ber(65_000) + rng.randbytes(9) for _ in range(3000))
    stream = noise + claims + noise + (KEY + b"\0") * 20_000 + noise
    tracemalloc.start()
    for begin in range(0, len(stream), 1000):
        assert not any(items for items, _ in reader.take(stream[begin : begin + 1000]))
    assert not list(reader.take(b"", last=True))
    assert tracemalloc.get_traced_memory()[1] < 2 << 20
    tracemalloc.stop()
    assert contents.read["packet"] > 15_000  # a false length may cost some of the small ones
    assert 0 < contents.refused[TOO_LONG] < 100  # each byte is looked at twice at most


def test_heads_of_metadata_cells_are_passed_over():
    """A head of 5 bytes before each packet, as in synchronous metadata of transport streams."""
    packets = flight(3)
    cells = [bytes((0, k, 0xD0)) + len(p).to_bytes(2, "big") + p for k, p in enumerate(packets)]
    assert read(b"".join(cells)) == ([(1000, 0.0), (2000, 0.0), (3000, 0.0)], {})
