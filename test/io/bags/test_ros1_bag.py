"""ROS 1 bags: whole, cut off, damaged, never closed; read as far as they go, and the loss said."""

from __future__ import annotations

import random
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from ros1_bags import BEGUN_NS, Bag
from rosbags.rosbag1 import Writer

from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.io.bags.bag import Cdr
from tirgeo_ros.io.bags.ros1_bag import Ros1Bag
from tirgeo_ros.io.bags.ros1_records import MAGIC, Op, record_at, records

COUNT = 500  # on each of two topics
STEP_NS = 1_000_000
PACKED = {
    "none": None,
    "bz2": Writer.CompressionFormat.BZ2,
    "lz4": Writer.CompressionFormat.LZ4,
}
UINT8, INT16 = "std_msgs/msg/UInt8", "std_msgs/msg/Int16"


def numbers_bag(path: Path, packed: str = "none", chunk_bytes: int = 2500) -> Path:
    """Two topics whose messages tell their place."""
    bag = Bag()
    for k in range(COUNT):
        at_ns = BEGUN_NS + k * STEP_NS
        bag.add(at_ns, "/a", bag.new(UINT8, data=k % 256))
        bag.add(at_ns + STEP_NS // 2, "/b", bag.new(INT16, data=k))
    return bag.write(path, compression=PACKED[packed], chunk_bytes=chunk_bytes)


def read(path: Path) -> tuple[list[tuple[int, str, int]], str | None]:
    bag = Ros1Bag(path)
    found = [(m.record_ns, m.topic, bag.decoded(m).data) for m in bag.messages()]
    return found, bag.damage


EXPECTED = sorted(
    [(BEGUN_NS + k * STEP_NS, "/a", k % 256) for k in range(COUNT)]
    + [(BEGUN_NS + k * STEP_NS + STEP_NS // 2, "/b", k) for k in range(COUNT)]
)


@pytest.mark.parametrize("packed", PACKED)
def test_a_whole_bag(tmp_path, packed):
    path = numbers_bag(tmp_path / "a.bag", packed)
    assert read(path) == (EXPECTED, None)
    bag = Ros1Bag(path)
    assert bag.topics() == {"/a": (UINT8,), "/b": (INT16,)}
    assert bag.span_ns == (EXPECTED[0][0], EXPECTED[-1][0])


def test_order_is_that_of_the_record_where_chunks_overlap(tmp_path):
    bag = Bag()
    order = random.Random(5).sample(range(400), 400)
    store = bag.store
    with Writer(tmp_path / "a.bag") as writer:
        writer.chunk_threshold = 500
        connection = writer.add_connection("/b", INT16, typestore=store)
        for k in order:
            data = store.serialize_ros1(bag.new(INT16, data=k), INT16)
            writer.write(connection, BEGUN_NS + k, data)
    found, damage = read(tmp_path / "a.bag")
    assert [value for *_, value in found] == sorted(order)
    assert damage is None


@pytest.mark.parametrize("packed", PACKED)
def test_a_bag_without_an_index_is_read_whole(tmp_path, packed):
    path = numbers_bag(tmp_path / "a.bag", packed)
    path.write_bytes(unindexed(path.read_bytes()))
    found, damage = read(path)
    assert found == EXPECTED
    assert damage == (
        f"no index at the end: it is cut off, or was not closed; {2 * COUNT} messages were read"
    )


def unindexed(data: bytes) -> bytes:
    """The chunks alone, as a recorder leaves them that was killed."""
    head = record_at(data, len(MAGIC), len(data))
    at = data.index(b"index_pos=") + len(b"index_pos=")
    kept = [
        data[record.start : record.end]
        for record in records(data, head.end, len(data))
        if record.op == Op.CHUNK
    ]
    return data[:at] + bytes(8) + data[at + 8 : head.end] + b"".join(kept)


@pytest.mark.parametrize("packed", PACKED)
def test_a_chunk_that_was_not_closed(tmp_path, packed):
    """Its header says that it is empty; what was written of it stands behind."""
    path = numbers_bag(tmp_path / "a.bag", packed)
    data = unindexed(path.read_bytes())
    last = [r for r in records(data, len(MAGIC), len(data)) if r.op == Op.CHUNK][-1]
    size = struct.pack("<I", last.number(b"size"))
    head = data[last.start : last.offset - 4].replace(b"size=" + size, b"size=" + bytes(4))
    path.write_bytes(data[: last.start] + head + bytes(4) + data[last.offset :])
    found, damage = read(path)
    assert found == EXPECTED
    assert "no index at the end" in damage


@pytest.mark.parametrize("packed", PACKED)
def test_cut_anywhere(tmp_path, packed):
    """What stands before the cut is read, and nothing else."""
    path = numbers_bag(tmp_path / "a.bag", packed)
    data = path.read_bytes()
    first = next(r for r in records(data, len(MAGIC), len(data)) if r.op == Op.CHUNK)
    for cut in np.linspace(first.end, len(data) - 1, 9).astype(int):
        path.write_bytes(data[:cut])
        found, damage = read(path)
        assert found == EXPECTED[: len(found)]
        assert len(found) >= messages_before(data, cut)
        assert damage


def messages_before(data: bytes, cut: int) -> int:
    """How many messages are in chunks that end before a byte, by their indexes."""
    number, chunk_end = 0, 0
    for record in records(data, len(MAGIC), len(data)):
        if record.op == Op.CHUNK:
            chunk_end = record.end
        elif record.op == Op.INDEX and chunk_end <= cut:
            number += record.number(b"count")
    return number


@pytest.mark.parametrize("packed", PACKED)
def test_no_damage_raises_anything_else(tmp_path, packed):
    """Many random hits and cuts: messages or a BagError; what is lost is said."""
    whole = numbers_bag(tmp_path / "a.bag", packed).read_bytes()
    path = tmp_path / "b.bag"
    rng = random.Random(7)
    for _ in range(20):
        data = bytearray(whole)
        for _ in range(rng.randrange(1, 4)):
            at, size = rng.randrange(len(MAGIC), len(data)), rng.choice([1, 8, 200])
            data[at : at + size] = rng.randbytes(size)
        if rng.random() < 0.3:
            data = data[: rng.randrange(len(MAGIC), len(data))]
        path.write_bytes(data)
        try:
            bag = Ros1Bag(path)
        except BagError:
            continue
        found = list(bag.messages())
        for message in found:
            with suppress(MessageError):
                bag.decoded(message)
        assert bag.damage or len(found) == len(EXPECTED)


def test_one_bad_byte_costs_at_most_a_chunk(tmp_path):
    path = numbers_bag(tmp_path / "a.bag", "bz2")
    data = bytearray(path.read_bytes())
    chunks = [r for r in records(bytes(data), len(MAGIC), len(data)) if r.op == Op.CHUNK]
    hit = chunks[len(chunks) // 2]
    data[(hit.offset + hit.end) // 2] ^= 0x10
    path.write_bytes(data)
    found, damage = read(path)
    assert set(found) < set(EXPECTED)
    assert len(found) >= len(EXPECTED) * (len(chunks) - 2) // len(chunks)
    assert f"the chunk at byte {hit.offset} is cut off or damaged" in damage


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"#ROSBAG V1.2\n", "not a ROS 1 bag of version 2.0"),
        (MAGIC, "no message can be read; no index at the end"),
        (MAGIC + b"\x00" * 5000, "no message can be read; the bytes from 13 to 5013"),
    ],
)
def test_what_is_no_bag(tmp_path, data, message):
    path = tmp_path / "x.bag"
    path.write_bytes(data)
    with pytest.raises(BagError, match=rf"x\.bag: {message}"):
        Ros1Bag(path)


def test_a_bag_without_messages(tmp_path):
    with pytest.raises(BagError, match=r"empty\.bag: no message can be read; it has none"):
        Ros1Bag(Bag().write(tmp_path / "empty.bag"))


def test_an_encrypted_bag(tmp_path):
    path = numbers_bag(tmp_path / "a.bag")
    data = path.read_bytes()
    field = b"encryptor=x/Y"
    head = record_at(data, len(MAGIC), len(data))
    fields = data[head.start + 4 : head.offset - 4] + struct.pack("<I", len(field)) + field
    header = struct.pack("<I", len(fields)) + fields + struct.pack("<I", 0)
    path.write_bytes(MAGIC + header + data[head.end :])
    with pytest.raises(BagError, match=r"a\.bag: the bag is encrypted"):
        Ros1Bag(path)


def test_a_message_that_its_type_does_not_fit(tmp_path):
    bag = Bag()
    with Writer(tmp_path / "a.bag") as writer:
        connection = writer.add_connection(
            "/fix", "sensor_msgs/msg/NavSatFix", typestore=bag.store
        )
        writer.write(connection, BEGUN_NS, b"\x01\x02\x03")
        undefined = writer.add_connection("/x", "x/msg/Y", msgdef="(((", md5sum="0" * 32)
        writer.write(undefined, BEGUN_NS + 1, b"")
    reader = Ros1Bag(tmp_path / "a.bag")
    short, unknown = reader.messages()
    with pytest.raises(MessageError, match=r"/fix: 3 bytes are no sensor_msgs/msg/NavSatFix"):
        reader.decoded(short)
    with pytest.raises(
        MessageError, match=r"/f: 3 bytes are no sensor_msgs/msg/NavSatFix of ROS 1"
    ):
        Cdr().from_ros1(short.data, short.typename, "/f")
    with pytest.raises(MessageError, match=r"/x: the bag does not define x/msg/Y"):
        reader.decoded(unknown)
