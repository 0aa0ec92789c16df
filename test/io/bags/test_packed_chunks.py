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
from tirgeo_ros.io.bags import time_order
from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.bags.mcap_contents import MAGIC
from tirgeo_ros.io.bags.ros1_bag import Ros1Bag
from tirgeo_ros.io.bags.ros1_records import MAGIC as ROS1
from tirgeo_ros.io.files.bounded_unpacking import unpacked

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


def mcap(path, compression, size, packed, cut=0):
    """A bag with one chunk, without an index."""
    name = compression.encode()
    body = struct.pack("<QQQII", 0, 1, size, 0, len(name)) + name
    body += struct.pack("<Q", len(packed)) + packed
    header = struct.pack("<I4sI4s", 4, b"ros2", 4, b"test")
    records = [(Opcode.HEADER, header), (Opcode.CHUNK, body)]
    data = b"".join(struct.pack("<BQ", op, len(one)) + one for op, one in records)
    path.write_bytes(MAGIC + data[: len(data) - cut])
    return path


def ros1(path, compression, size, packed):
    """The same of ROS 1."""

    def record(data, **fields):
        values = [f"{name}=".encode() + value for name, value in fields.items()]
        header = b"".join(struct.pack("<I", len(one)) + one for one in values)
        return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data

    head = record(b" ", op=b"\x03", index_pos=bytes(8), conn_count=bytes(4), chunk_count=bytes(4))
    chunk = {"compression": compression.encode(), "size": struct.pack("<I", size)}
    path.write_bytes(ROS1 + head + record(packed, op=b"\x05", **chunk))
    return path


FORMS = [
    (mcap, BagReader, "zstd"),
    (mcap, BagReader, "lz4"),
    (ros1, Ros1Bag, "bz2"),
    (ros1, Ros1Bag, "lz4"),
]


@pytest.mark.parametrize(("write", "reader", "compression"), FORMS)
def test_a_chunk_that_says_it_holds_gigabytes(tmp_path, write, reader, compression):
    path = write(tmp_path / "bomb", compression, GIGABYTES, packed_zeros(compression))

    def read():
        with pytest.raises(BagError, match=r"bomb: .*chunk at byte \d+ holds 2765 MiB, and a"):
            reader(path)

    assert peak_of(read) < MOST_PEAK


@pytest.mark.parametrize(("write", "reader", "compression"), FORMS)
def test_a_chunk_that_holds_more_than_it_says(tmp_path, write, reader, compression):
    path = write(tmp_path / "bomb", compression, 1 << 20, packed_zeros(compression))

    def read():
        with pytest.raises(BagError, match=r"bomb: no message .*the chunk at byte \d+ is"):
            reader(path)

    assert peak_of(read) < MOST_PEAK


def test_a_chunk_that_is_cut_off_too(tmp_path):
    path = mcap(tmp_path / "bomb", "zstd", 1 << 20, packed_zeros("zstd"), cut=3)

    def read():
        with pytest.raises(BagError, match=r"bomb: no message .*the chunk at byte \d+ is cut off"):
            BagReader(path)

    assert peak_of(read) < MOST_PEAK


@pytest.mark.parametrize("compression", PACK)
def test_what_was_in_the_beginning_is_kept(compression):
    """Of a chunk that was cut off; the block is lost that was being packed (bz2: 100 kB)."""
    packed = PACK[compression](b"".join(struct.pack("<Q", n * n) for n in range(60_000)))
    whole = unpacked(packed, compression, 480_000)
    part = unpacked(packed[: len(packed) * 2 // 3], compression, 480_000)
    assert whole.fault == ""
    assert part.fault == "is cut off or damaged"
    assert part.data == whole.data[: len(part.data)]
    assert len(part.data) > 200_000


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
    monkeypatch.setattr(time_order, "MOST_BYTES", 5 << 20)
    with pytest.raises(BagError, match=r"a\.mcap: more than 5 MiB of messages overlap in time"):
        list(BagReader(path).messages())
