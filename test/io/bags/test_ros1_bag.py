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
"""ROS 1 bags: whole, or cut off and read up to the cut; damaged and oversized ones are refused."""

from __future__ import annotations

import random
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from ros1_bags import BEGUN_NS, Bag
from rosbags.rosbag1 import Reader, Writer

from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.io.bags.packed import MOST_BYTES
from tirgeo_ros.io.bags.ros1_bag import MAGIC, Ros1Bag

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


def read(path: Path) -> list[tuple[int, str, int]]:
    bag = Ros1Bag(path)
    return [(m.log_time_ns, m.topic, bag.decoded(m).data) for m in bag.messages()]


EXPECTED = sorted(
    [(BEGUN_NS + k * STEP_NS, "/a", k % 256) for k in range(COUNT)]
    + [(BEGUN_NS + k * STEP_NS + STEP_NS // 2, "/b", k) for k in range(COUNT)]
)


@pytest.mark.parametrize("packed", PACKED)
def test_a_whole_bag(tmp_path, packed):
    path = numbers_bag(tmp_path / "a.bag", packed)
    assert read(path) == EXPECTED
    bag = Ros1Bag(path)
    assert bag.topics() == {"/a": UINT8, "/b": INT16}
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
    assert [value for *_, value in read(tmp_path / "a.bag")] == sorted(order)


def test_a_record_time_that_no_stamp_of_ros_2_holds(tmp_path):
    bag = Bag()
    for k, at_ns in enumerate((BEGUN_NS, (1 << 31) * 10**9, BEGUN_NS + 1)):
        bag.add(at_ns, "/a", bag.new(UINT8, data=k))
    path = bag.write(tmp_path / "a.bag")
    result = Ros1Bag(path)
    assert [result.decoded(m).data for m in result.messages()] == [0, 2]
    assert result.damage == "1 messages with a log time after 2038 left out"


@pytest.mark.parametrize("packed", PACKED)
def test_a_bag_that_was_cut_is_read_up_to_the_cut(tmp_path, packed):
    path = numbers_bag(tmp_path / "a.bag", packed)
    data, counts = path.read_bytes(), []
    for cut in np.linspace(len(MAGIC), len(data) - 1, 9).astype(int):
        path.write_bytes(data[:cut])
        result = []
        with suppress(BagError):
            result = read(path)
        assert result == EXPECTED[: len(result)]
        counts.append(len(result))
        assert not result or f"{len(result)} messages were found" in str(Ros1Bag(path).damage)
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (0, len(EXPECTED))  # the last cut is in the index
    # The whole chunks before the cut, which are all alike but for the last.
    assert counts[4] > len(EXPECTED) * 0.25


def test_a_chunk_that_was_being_written(tmp_path):
    """A recorder fills in the sizes of a chunk, and the bag's index, when it is done."""
    path = numbers_bag(tmp_path / "a.bag")
    data = bytearray(path.read_bytes())
    with Reader(path) as reader:
        last = max(chunk.datapos for chunk in reader.chunks.values())
        end = last + max(reader.chunks.values(), key=lambda chunk: chunk.datapos).datasize
        whole = sum(entry.chunk_pos < last - 200 for i in reader.indexes.values() for entry in i)
    data[last - 4 : last] = bytes(4)
    place = data.index(b"index_pos=") + len("index_pos=")
    data[place : place + 8] = bytes(8)
    path.write_bytes(data[: end - 10])  # in the middle of the last record
    bag = Ros1Bag(path)
    assert read(path) == EXPECTED[:-1]
    assert whole < len(EXPECTED) - 1
    assert bag.span_ns == (EXPECTED[0][0], EXPECTED[-2][0])
    assert bag.damage is not None
    assert f"{len(EXPECTED) - 1} messages were found" in bag.damage


@pytest.mark.parametrize("packed", PACKED)
def test_no_damage_raises_anything_else(tmp_path, packed):
    """Many random hits and cuts: messages or a BagError."""
    whole = numbers_bag(tmp_path / "a.bag", packed).read_bytes()
    path = tmp_path / "b.bag"
    rng = random.Random(7)
    for _ in range(40):
        data = bytearray(whole)
        for _ in range(rng.randrange(1, 4)):
            at, size = rng.randrange(len(MAGIC), len(data)), rng.choice([1, 8, 200])
            data[at : at + size] = rng.randbytes(size)
        path.write_bytes(data)
        with suppress(BagError):
            bag = Ros1Bag(path)
            for message in bag.messages():
                with suppress(MessageError):
                    bag.decoded(message)


def test_a_chunk_that_unpacks_to_more_than_the_bound(tmp_path):
    bag = Bag()
    kind = "std_msgs/msg/String"
    bag.add(BEGUN_NS, "/a", bag.new(kind, data="0" * (MOST_BYTES + 1)))
    path = bag.write(tmp_path / "a.bag", compression=PACKED["bz2"])
    assert path.stat().st_size < 100_000
    with pytest.raises(BagError, match=r"a\.bag: .* a chunk holds more than 64 MiB: not read"):
        list(Ros1Bag(path).messages())


@pytest.mark.parametrize("data", [b"", b"#ROSBAG V1.2\n"])
def test_what_is_no_bag(tmp_path, data):
    path = tmp_path / "x.bag"
    path.write_bytes(data)
    with pytest.raises(BagError, match=r"x\.bag: not a ROS 1 bag of version 2.0"):
        Ros1Bag(path)
    with pytest.raises(BagError, match=r"empty\.bag: the bag has no message"):
        Ros1Bag(Bag().write(tmp_path / "empty.bag"))


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
        MessageError, match=r"/fix: 3 bytes are no sensor_msgs/msg/NavSatFix of ROS 1"
    ):
        reader.cdr(short)
    with pytest.raises(MessageError, match=r"/x: the bag does not define x/msg/Y"):
        reader.decoded(unknown)
