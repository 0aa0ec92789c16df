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

import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.io.logs.log_contents import LogContents
from tirgeo_ros.io.logs.misb_stream import packets
from tirgeo_ros.io.video.frame_metadata import KEY, ber, packet

WRONG_SUM, CUT_OFF = ("packet", "wrong checksum"), ("packet", "cut off")


def flight(number):
    """Packets at 1, 2, ... ms since 1970, each with a place."""
    return [packet(k * 1_000_000, {13: 48.0, 14: 11.0, 10: "x" * k}) for k in range(1, number + 1)]


def read(data):
    """Times (ms) of the packets, and what was refused."""
    contents = LogContents()
    times = [int.from_bytes(items[2], "big") // 1000 for _, items in packets(data, contents)]
    return times, contents.refused


@given(st.lists(st.binary(max_size=40), min_size=3, max_size=6))
def test_what_is_between_packets_is_passed_over(noises):
    pieces = zip(noises, flight(len(noises)), strict=True)
    stream = b"".join(noise.replace(KEY[:1], b"") + b"." + each for noise, each in pieces)
    assert read(stream) == ([*range(1, len(noises) + 1)], {})


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda p: p[:30] + bytes((p[30] ^ 1,)) + p[31:], WRONG_SUM),
        (lambda p: p[:16] + ber(len(p) + 60) + p[17:], CUT_OFF),  # it reaches into the next
        (lambda p: p[:40], CUT_OFF),  # a piece is lost
        (lambda p: p[:16] + b"\x88" + (1 << 60).to_bytes(8, "big") + p[17:], CUT_OFF),
        (lambda p: p[:16] + b"\xff" + p[17:], CUT_OFF),
    ],
)
def test_a_damaged_packet_costs_no_other(change, reason):
    first, second, third, fourth = flight(4)
    assert read(first + change(second) + third + fourth) == ([1, 3, 4], {reason: 1})
    assert read(third + first + change(second)) == ([3, 1], {reason: 1})


def test_packets_without_a_checksum_and_with_large_tags():
    items = b"\x02\x08" + (5000).to_bytes(8, "big") + b"\x81\x0e\x01\x1e"
    ((place, result),) = packets(b"." + KEY + ber(len(items)) + items, LogContents())
    assert (place, result) == (1, {2: items[2:10], 142: b"\x1e"})


def test_other_sets_are_refused_by_name():
    moving = bytes.fromhex("060e2b34020b01010e01030306000000") + ber(3) + b"abc"
    secure = bytes.fromhex("060e2b34020301010e01030302000000") + ber(130) + bytes(130)
    times, refused = read(moving + flight(1)[0] + secure)
    assert times == [1]
    assert {name for name, _ in refused} == {
        "moving targets of ST 0903",
        "security set of ST 0102",
    }


def test_hostile_bytes_are_looked_at_once():
    """Noise, keys that claim all that a packet may have, and many that hold nothing."""
    noise = random.Random(3).randbytes(1 << 20)
    stream = noise + (KEY + ber(65_000) + bytes(9)) * 10_000 + noise + (KEY + b"\0") * 10_000
    contents = LogContents()
    assert not any(items for _, items in packets(stream, contents))
    assert contents.refused == {CUT_OFF: 10_000}
