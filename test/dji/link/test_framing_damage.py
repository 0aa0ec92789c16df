"""Frames in streams that are damaged, cut and put together wrongly, in pieces of any size."""

from __future__ import annotations

import json
import random
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dev.dji_damage import KEY, damaged_stream
from tirgeo_ros.dji.link import framing
from tirgeo_ros.dji.link.framing import MAX_BYTES, FrameReader, crc16, encode_frame

FRAMES = [encode_frame(bytes([2, 0, *range(size)]), sequence=size) for size in (2, 60, 31, 200)]


def read_all(data, key=None):
    reader = FrameReader(key)
    return reader.feed(data) + reader.rescan(), reader.counts


def read_in(pieces, key=None):
    reader, frames = FrameReader(key), []
    for piece in pieces:
        frames += reader.feed(piece)
        assert reader.held < MAX_BYTES
    frames += reader.rescan()
    assert reader.held == 0
    return frames, reader.counts


def offsets(frames):
    return [frame.offset for frame in frames]


def cut_at(data, places):
    places = [0, *sorted(places), len(data)]
    return [data[start:stop] for start, stop in pairwise(places)]


def false_header(length=MAX_BYTES):
    """A header with a right check sum; nothing of its frame behind it."""
    head = bytes([0xAA, length & 0xFF, length >> 8, *[0] * 7])
    return head + crc16(head).to_bytes(2, "little")


@given(seed=st.integers(0, 2**32), data=st.data())
@settings(max_examples=60)
def test_the_frames_do_not_depend_on_the_pieces(seed, data):
    stream = damaged_stream(random.Random(seed), 4000)
    places = data.draw(st.lists(st.integers(0, len(stream)), max_size=60))
    expected = read_all(stream, KEY)
    assert read_in(cut_at(stream, places), KEY) == expected
    assert read_in(cut_at(stream, range(len(stream))), KEY) == expected


def test_no_flipped_bit_is_accepted():
    before, hit, behind = FRAMES[0], FRAMES[1], FRAMES[2]
    for bit in range(8 * len(hit)):
        damaged = bytearray(hit)
        damaged[bit // 8] ^= 1 << bit % 8
        frames, counts = read_all(before + damaged + behind)
        assert offsets(frames) == [0, len(before) + len(hit)]
        assert counts["skipped_bytes"] == len(hit)


def test_a_frame_cut_anywhere_costs_no_other():
    """Not even where its header claims bytes of the frames behind it."""
    for kept in range(len(FRAMES[3])):
        frames, counts = read_all(FRAMES[3][:kept] + FRAMES[0] + FRAMES[2])
        assert offsets(frames) == [kept, kept + len(FRAMES[0])]
        assert counts["skipped_bytes"] == kept
        # Its header is known to be one, and the rest is wrong or does not come.
        assert counts["truncated"] + counts["bad_crc32"] == (kept >= 12)


@pytest.mark.parametrize("before", [b"\xaa", b"\xaa\xaa", b"\xaa\x20\x00"])
def test_a_stray_start_costs_no_frame_of_any_length(before):
    """It may make a header of the frame's own first bytes."""
    for size in range(1008):
        whole = encode_frame(bytes(size), session=1)
        frames, counts = read_all(before + whole)
        assert [(f.offset, f.length) for f in frames] == [(len(before), len(whole))]
        assert counts["skipped_bytes"] == len(before)


@pytest.mark.parametrize("seed", range(6))
def test_the_example_frames_among_damage(shared, seed):
    """Each intact one is found, with all its bytes, and nothing else is."""
    data = (shared / "dji" / "frames.bin").read_bytes()
    lines = map(json.loads, (shared / "dji" / "frames.jsonl").read_text().splitlines())
    examples = [data[line["offset"] : line["offset"] + line["length"]] for line in lines]
    rng = random.Random(seed)
    stream, expected = b"", []
    for example in rng.sample(examples * 4, 128):
        stream += damage(rng, example)
        expected.append((len(stream), example))
        stream += example
    frames, counts = read_in(cut_at(stream, rng.sample(range(len(stream)), 300)))
    assert [(f.offset, stream[f.offset : f.offset + f.length]) for f in frames] == expected
    assert counts["bytes"] == len(stream)
    assert counts["skipped_bytes"] == len(stream) - sum(len(whole) for _, whole in expected)


def damage(rng, whole):
    """Something that holds no intact frame, though nearly one."""
    at = rng.randrange(1, len(whole))
    flipped = bytearray(whole)
    flipped[at] ^= 1 << rng.randrange(8)
    return rng.choice(
        [
            b"",
            rng.randbytes(rng.randrange(300)),
            b"\xaa" * rng.randrange(300),
            bytes(rng.choices([0xAA, 0, 0x14], k=100)),
            bytes(flipped),
            whole[:at],
            whole[at:],
            whole[:at] + rng.randbytes(2) + whole[at:],
            false_header(rng.randrange(16, 1024)),
        ]
    )


def test_a_frame_given_up_frees_those_behind_it():
    """What a pause of the line is for: 1023 bytes are promised, and two frames stand there."""
    reader = FrameReader()
    assert reader.feed(false_header() + FRAMES[0] + FRAMES[1]) == []
    assert reader.held == 12 + len(FRAMES[0] + FRAMES[1])
    assert offsets(reader.rescan()) == [12, 12 + len(FRAMES[0])]
    assert reader.held == 0
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
    """Counted, not timed: a CRC-32 once a header, a CRC-16 twice where the frame is waited for."""
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
