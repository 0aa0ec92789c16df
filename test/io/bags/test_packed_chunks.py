"""Chunks that unpack to far more than they should: refused, and not in memory for a moment."""

from __future__ import annotations

import bz2
import struct
import tracemalloc
from functools import cache

import lz4.frame
import pytest
import zstandard
from mcap.opcode import Opcode

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags import mcap_file
from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.bags.bag_file import MOST_BYTES, unpacked
from tirgeo_ros.io.bags.mcap_file import MAGIC

ZEROS = 40 << 20
MOST_PEAK = 8 << 20  # the pieces, of a megabyte that is said
GIGABYTES = 2_900_000_000
PACK = {
    "zstd": zstandard.compress,
    "lz4": lz4.frame.compress,
    "bz2": lambda data: bz2.compress(data, 1),
}


@cache
def packed_zeros(name):
    return PACK[name](bytes(ZEROS))


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
    data = b"".join(struct.pack("<BQ", op, len(one)) + one for op, one in records)
    path.write_bytes(MAGIC + data)
    return path


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_that_says_it_holds_gigabytes(tmp_path, compression):
    packed = PACK[compression](bytes(MOST_BYTES + 1))
    path = mcap(tmp_path / "bomb", compression, GIGABYTES, packed)
    with pytest.raises(BagError, match=r"bomb: .*chunk at byte \d+ holds more than 64 MiB: not"):
        BagReader(path)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_that_holds_more_than_it_says(tmp_path, compression):
    path = mcap(tmp_path / "bomb", compression, 1 << 20, packed_zeros(compression))

    def read():
        with pytest.raises(BagError, match=r"bomb: no message .*the chunk at byte \d+ is"):
            BagReader(path)

    assert peak_of(read) < MOST_PEAK


@pytest.mark.parametrize("compression", PACK)
def test_a_chunk_that_is_cut_off(compression):
    data = b"".join(struct.pack("<Q", n * n) for n in range(60_000))
    packed = PACK[compression](data)
    assert unpacked(packed, compression, len(data)) == data
    with pytest.raises(ValueError, match="is cut off or damaged"):
        unpacked(packed[: len(packed) * 2 // 3], compression, len(data))


def test_a_chunk_packed_in_no_known_way(tmp_path):
    with pytest.raises(BagError, match="is packed as 'rar', which is not known"):
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
