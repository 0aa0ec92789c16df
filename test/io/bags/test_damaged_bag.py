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
"""Bags that are cut off, damaged or packed too large: what can be read is read, the loss said."""

from __future__ import annotations

import random
import struct
import tracemalloc

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
from recorded_bags import segments_of

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags import mcap_file
from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.bags.mcap_file import MAGIC
from tirgeo_ros.io.bags.packed import MOST_BYTES

TYPE = "std_msgs/msg/Header"
COUNT = 600
cdr = Cdr()


def payload(number):
    """A message that does not compress, so that damage anywhere hits something."""
    kind = cdr.types(TYPE)
    stamp = cdr.types("builtin_interfaces/msg/Time")(sec=number, nanosec=0)
    text = np.random.default_rng(number).bytes(40).hex()
    return cdr.serialize(kind(stamp=stamp, frame_id=text), TYPE)


PAYLOADS = [payload(number) for number in range(COUNT)]


def bag(path, repeat=1, times=(), **options):
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=options.pop("chunk_size", 4000), **options)
        writer.start("ros2", "test")
        schema = writer.register_schema(TYPE, "ros2msg", cdr.definition(TYPE).encode())
        channel = writer.register_channel("/a", "cdr", schema)
        for number, data in enumerate(PAYLOADS * repeat):
            time_ns = dict(times).get(number, number)
            writer.add_message(channel, time_ns, data, time_ns)
        writer.finish()
    return path


FORMS = {
    "zstd": {},
    "lz4": {"compression": CompressionType.LZ4},
    "plain chunks": {"compression": CompressionType.NONE},
    "no chunks": {"use_chunking": False},
}


def read(path):
    """Numbers of the messages that come, each checked to be what was written."""
    reader = BagReader(path)
    result = list(reader.messages())
    assert all(m.data == PAYLOADS[m.log_time_ns] for m in result)
    return [m.log_time_ns for m in result], reader.damage


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("share", [0.15, 0.5, 0.9])
def test_a_cut_keeps_what_is_before_it(tmp_path, form, share):
    path = bag(tmp_path / "a.mcap", **FORMS[form])
    data = path.read_bytes()
    cut = int(share * len(data))
    path.write_bytes(data[:cut])
    numbers, damage = read(path)
    assert numbers == list(range(len(numbers)))
    # The messages take all but the summary's few per cent: a cut loses no more than a block that
    # was being compressed (lz4 64 KiB, zstd 128 KiB; both larger than these chunks of 4 kB).
    per_message = len(data) / COUNT
    assert len(numbers) >= cut / per_message - 4000 / per_message - 60
    assert damage.endswith(f"; {len(numbers)} messages were read")
    assert "no usable index at the end (the file ends early)" in damage


@pytest.mark.parametrize("form", ["zstd", "lz4", "plain chunks"])
def test_a_cut_chunk_gives_its_beginning(tmp_path, form):
    """Of a chunk of megabytes, as a flight without pictures has it for some seconds."""
    path = bag(tmp_path / "a.mcap", chunk_size=1 << 24, repeat=40, **FORMS[form])
    (chunk,) = segments_of(path)
    path.write_bytes(path.read_bytes()[: chunk.offset + chunk.length * 2 // 3])
    reader = BagReader(path)
    assert 300 < len(list(reader.messages())) < COUNT * 40
    assert "is cut off" in reader.damage


@pytest.mark.parametrize("form", ["zstd", "lz4", "plain chunks"])
def test_a_damaged_chunk_is_left_out(tmp_path, form):
    path = bag(tmp_path / "a.mcap", **FORMS[form])
    data = bytearray(path.read_bytes())
    segment = segments_of(path)[10]
    middle = segment.offset + segment.length // 2
    data[middle : middle + 20] = bytes(b ^ 0x5A for b in data[middle : middle + 20])
    path.write_bytes(data)
    numbers, damage = read(path)
    assert numbers == sorted(numbers)
    assert COUNT - 60 < len(numbers) < COUNT  # a chunk holds 4000 / 140 messages
    assert (numbers[0], numbers[-1]) == (0, COUNT - 1)
    assert "the chunk at byte" in damage
    assert f"; {len(numbers)} messages were read" in damage


@pytest.mark.parametrize(
    ("head", "summary"),
    [(bytes(30), True), (bytes(30), False), (b"\x80", True)],  # the last: of an application
)
def test_damage_over_the_head_of_a_chunk(tmp_path, head, summary):
    """A file with its summary loses the chunk, one without it all that follows too."""
    path = bag(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    segment = segments_of(path)[5]
    data[segment.offset : segment.offset + len(head)] = head
    path.write_bytes(data if summary else data[:-100])
    numbers, damage = read(path)
    if summary:
        assert COUNT - 60 < len(numbers) < COUNT
        assert (numbers[0], numbers[-1]) == (0, COUNT - 1)
    else:
        assert numbers == list(range(segment.start_ns))
    assert f"from byte {segment.offset} are not readable" in damage


@pytest.mark.parametrize(
    ("place", "options", "damaged"),
    [
        # a topic's name in a chunk without a checksum: the index has the topic too
        (lambda data: data.index(b"/a"), {"enable_crcs": False}, "a topic's record at byte"),
        (lambda data: len(data) - 60, {}, "checksum of the index is wrong"),
    ],
)
def test_damage_that_costs_nothing(tmp_path, place, options, damaged):
    path = bag(tmp_path / "a.mcap", compression=CompressionType.NONE, **options)
    data = bytearray(path.read_bytes())
    data[place(data)] ^= 0x94
    path.write_bytes(data)
    numbers, damage = read(path)
    assert numbers == list(range(COUNT))
    assert damaged in damage


def test_what_is_lost_with_the_descriptions(tmp_path):
    path = bag(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    first = segments_of(path)[0]
    data[first.offset + first.length // 2] ^= 1
    path.write_bytes(data[:-100])  # neither the first chunk nor the summary says what /a is
    with pytest.raises(BagError, match=r"no message can be read; .*to no known topic"):
        BagReader(path)


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("form", FORMS)
def test_a_log_time_that_no_stamp_holds_costs_that_message(tmp_path, form, whole):
    """A stamp's seconds are an int32; the reader's span is that of the others."""
    late = {COUNT // 2: (1 << 31) * 10**9, COUNT - 1: (1 << 64) - 1}
    path = bag(tmp_path / "a.mcap", times=late, **FORMS[form])
    path.write_bytes(path.read_bytes()[: None if whole else -8])
    numbers, damage = read(path)
    assert numbers == [number for number in range(COUNT) if number not in late]
    assert BagReader(path).span_ns == (0, COUNT - 2)
    assert damage.count("1 messages with a log time after 2038 left out at byte ") == 2


def test_only_the_head_is_left(tmp_path):
    path = bag(tmp_path / "a.mcap")
    for size in (len(MAGIC), len(MAGIC) + 5, 40):
        path.write_bytes(path.read_bytes()[:size])
        with pytest.raises(BagError, match="no message can be read"):
            BagReader(path)


@pytest.mark.parametrize("form", FORMS)
def test_no_damage_raises_anything_else(tmp_path, form):
    """Many random cuts and hits: messages or a BagError, no other error.

    No message comes that was not written, except where MCAP has no checksum that could tell: in
    messages outside chunks and in a chunk that is both hit and cut off.
    """
    path = bag(tmp_path / "a.mcap", **FORMS[form])
    whole = path.read_bytes()
    rng = random.Random(11)
    for _ in range(60):
        data = bytearray(whole)
        for _ in range(rng.randrange(1, 4)):
            at = rng.randrange(len(MAGIC), len(data))
            size = rng.choice([1, 8, 200])
            data[at : at + size] = rng.randbytes(size)
        cut = rng.random() < 0.5
        if cut:
            data = data[: rng.randrange(len(MAGIC), len(data))]
        path.write_bytes(data)
        try:
            reader = BagReader(path)
            result = list(reader.messages())
        except BagError:
            continue
        wrong = [m for m in result if m.data != PAYLOADS[m.log_time_ns % COUNT]]
        assert cut or form == "no chunks" or not wrong
        assert len(result) <= COUNT + len(wrong)
        assert reader.damage or len(result) == COUNT


ZEROS = 40 << 20
MOST_PEAK = 8 << 20  # the pieces, of a megabyte that is said
GIGABYTES = 2_900_000_000
PACK = {"zstd": zstandard.compress, "lz4": lz4.frame.compress}


def peak_of(work):
    """Bytes that Python and its libraries took meanwhile."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def mcap(path, compression, size, packed):
    """A bag with one chunk, without an index."""
    name = compression.encode()
    body = struct.pack("<QQQII", 0, 1, size, 0, len(name)) + name
    body += struct.pack("<Q", len(packed)) + packed
    header = struct.pack("<I4sI4s", 4, b"ros2", 4, b"test")
    records = [(Opcode.HEADER, header), (Opcode.CHUNK, body)]
    data = b"".join(struct.pack("<BQ", op, len(item)) + item for op, item in records)
    path.write_bytes(MAGIC + data)
    return path


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_that_says_it_holds_gigabytes_or_holds_more_than_it_says(tmp_path, compression):
    packed = PACK[compression](bytes(MOST_BYTES + 1))
    path = mcap(tmp_path / "bomb", compression, GIGABYTES, packed)
    with pytest.raises(BagError, match=r"bomb: .*chunk at byte \d+ holds more than 64 MiB: not"):
        BagReader(path)
    path = mcap(tmp_path / "bomb", compression, 1 << 20, PACK[compression](bytes(ZEROS)))

    def read():
        with pytest.raises(BagError, match=r"bomb: no message .*the chunk at byte \d+ is"):
            BagReader(path)

    assert peak_of(read) < MOST_PEAK
    with pytest.raises(BagError, match="is compressed as 'rar', which is not supported"):
        BagReader(mcap(tmp_path / "a.mcap", "rar", 100, b"Rar!"))


def test_messages_that_all_overlap_in_time(tmp_path, monkeypatch):
    """Chunks that are each small enough, and all wait for the last of them."""
    cdr = Cdr()
    kind, time = cdr.types("std_msgs/msg/Header"), cdr.types("builtin_interfaces/msg/Time")
    data = cdr.serialize(
        kind(stamp=time(sec=0, nanosec=0), frame_id="x" * 100_000), kind.__msgtype__
    )
    path = tmp_path / "a.mcap"
    with BagWriter(path) as bag:
        for number in range(100):  # 10 messages a chunk
            bag.write("/a", kind.__msgtype__, data, 0 if number % 10 == 0 else number)
    assert len(list(BagReader(path).messages())) == 100
    monkeypatch.setattr(mcap_file, "_MOST_WAITING", 5 << 20)
    with pytest.raises(BagError, match=r"a\.mcap: more than 5 MiB of messages overlap in time"):
        list(BagReader(path).messages())
