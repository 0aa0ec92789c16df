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
"""Bags that are whole: written, read, ordered, refused; and bags that grow."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from message_samples import EVERY_MESSAGE, IMU as SAMPLE
from rosbags.typesys import Stores, get_typestore

from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.io.messages.cdr import header_stamp_ns

IMU = "sensor_msgs/msg/Imu"
cdr = Cdr()
builder = Messages()


def imu(stamp_ns):
    return builder.imu(ImuSample(stamp_ns, np.zeros(3), np.zeros(3)))


def write(path, log_times, topic="/imu/data"):
    with BagWriter(path) as bag:
        for log_time in log_times:
            bag.write(topic, IMU, imu(log_time), log_time)


def foreign(path, *, profile="ros2", encoding="cdr", schema="ros2msg", times=(1,), **options):
    """A bag by another writer: topic /a of an encoding and a schema, and a sound one /b."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile, "another")
        text = cdr.definition(IMU).encode()
        kinds = [(encoding, schema, "/a"), ("cdr", "ros2msg", "/b")]
        channels = [
            writer.register_channel(topic, kind, writer.register_schema(IMU, form, text))
            for kind, form, topic in kinds
        ]
        for log_time in times:
            for channel in channels:
                writer.add_message(channel, log_time, cdr.serialize(imu(log_time), IMU), log_time)
        writer.finish()
    return path


def test_every_message_comes_back(tmp_path):
    path = tmp_path / "all.mcap"
    with BagWriter(path) as bag:
        for number, (name, (typename, make)) in enumerate(EVERY_MESSAGE.items()):
            bag.write("/" + name.replace(" ", "_"), typename, make(builder), number)
    reader = BagReader(path)
    read = list(reader.messages())
    assert [m.topic for m in read] == ["/" + n.replace(" ", "_") for n in EVERY_MESSAGE]
    for message, (typename, make) in zip(read, EVERY_MESSAGE.values(), strict=True):
        assert message.typename == typename == reader.topics()[message.topic]
        assert message.data == cdr.serialize(make(builder), typename)
        assert message.data == cdr.serialize(cdr.deserialize(message.data, typename), typename)
    assert reader.damage is None


def test_a_topic_that_stayed_silent_is_none(tmp_path):
    """As rosbag2 leaves it where a node advertises what its receiver never sends."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "another")
        schema = writer.register_schema(IMU, "ros2msg", cdr.definition(IMU).encode())
        sent, _ = (writer.register_channel(topic, "cdr", schema) for topic in ("/a", "/b"))
        writer.add_message(sent, 1, cdr.serialize(imu(1), IMU), 1)
        writer.finish()
    assert list(BagReader(path).topics()) == ["/a"]


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.NONE},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.ZSTD},
        {"chunk_size": 2000},
        {"use_chunking": False},
        {"repeat_channels": False, "repeat_schemas": False},
        {"use_statistics": False},
        {"enable_crcs": False},
        {"profile": ""},
    ],
)
def test_bags_of_other_writers_come_by_log_time(tmp_path, options):
    """Across chunks; messages of one time keep the order of the file."""
    times = np.random.default_rng(3).permutation(200).tolist()
    reader = BagReader(foreign(tmp_path / "a.mcap", times=times, **options))
    read = [(m.log_time_ns, m.topic) for m in reader.messages()]
    assert read == [(t, topic) for t in range(200) for topic in ("/a", "/b")]
    some = reader.messages(["/b", "/absent"], start_ns=197)
    assert [(m.topic, m.log_time_ns) for m in some] == [("/b", 197), ("/b", 198), ("/b", 199)]
    assert reader.topics() == {"/a": IMU, "/b": IMU}
    assert (reader.damage, reader.span_ns) == (None, (0, 199))


# what the file looks like to others


def test_the_container_is_what_others_expect(tmp_path):
    path = tmp_path / "a.mcap"
    write(path, range(5000))
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary.statistics.message_count == 5000
        assert summary.statistics.channel_message_counts == {1: 5000}
        assert len(summary.chunk_indexes) > 1
        assert all(index.compression == "zstd" for index in summary.chunk_indexes)
        (channel,) = summary.channels.values()
        (schema,) = summary.schemas.values()
        assert (channel.topic, channel.message_encoding) == ("/imu/data", "cdr")
        assert (schema.name, schema.encoding) == (IMU, "ros2msg")
        assert [m.log_time for _, _, m in reader.iter_messages()] == list(range(5000))


def test_ros2_bag_play_finds_the_qos_of_each_topic(tmp_path):
    """In the words of metadata version 9, which a record at the beginning names."""
    path = tmp_path / "a.mcap"
    topics = {"/uav1/tirgeo/origin": "transient_local", "/uav1/imu/data": "volatile"}
    with BagWriter(path) as bag:
        for topic in topics:
            bag.write(topic, IMU, imu(1), 1)
    with path.open("rb") as file:
        reader = make_reader(file)
        (record,) = reader.iter_metadata()
        channels = reader.get_summary().channels.values()
    assert record.name == "rosbag2"
    assert yaml.safe_load(record.metadata["serialized_metadata"])["version"] == 9
    infinite = {"sec": 9223372036, "nsec": 854775807}
    for channel in channels:
        (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        assert profile == {
            "history": "keep_last",
            "depth": 1 if "origin" in channel.topic else 800,
            "reliability": "reliable",
            "durability": topics.pop(channel.topic),
            "deadline": infinite,
            "lifespan": infinite,
            "liveliness": "automatic",
            "liveliness_lease_duration": infinite,
            "avoid_ros_namespace_conventions": False,
        }
    assert not topics


# nothing half-written


@pytest.mark.parametrize("before", [[], [b"before"]])
def test_an_error_keeps_what_was_there(tmp_path, before):
    path = tmp_path / "a.mcap"
    for content in before:
        path.write_bytes(content)
    with pytest.raises(BagError, match="message type no/such/Type is not known"):  # noqa: SIM117  two contexts
        with BagWriter(path) as bag:
            bag.write("/imu/data", "no/such/Type", imu(1), 1)
    assert [each.read_bytes() for each in tmp_path.iterdir()] == before

    def interrupted():
        with BagWriter(path) as bag:
            bag.write("/imu/data", IMU, imu(1), 1)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [each.read_bytes() for each in tmp_path.iterdir()] == before


def test_what_is_no_file_is_not_replaced(tmp_path):
    """A device would be, by one who may write in its folder; a pipe stands for it."""
    path = tmp_path / "a.mcap"
    os.mkfifo(path)
    with pytest.raises(BagError, match=rf"{path}: not a file; give the output"), BagWriter(path):
        pass
    assert path.is_fifo()
    assert list(tmp_path.iterdir()) == [path]


# refused


@pytest.mark.parametrize("data", [b"#ROSBAG V2.0\n" + bytes(100), b"\x89", b"text"])
def test_of_another_kind(tmp_path, data):
    (tmp_path / "a.mcap").write_bytes(data)
    with pytest.raises(BagError, match=r"not a ROS 2 bag; give an MCAP file, a \.db3 file or"):
        BagReader(tmp_path / "a.mcap")


def test_another_profile_and_a_device_are_refused(tmp_path):
    with pytest.raises(BagError, match="profile 'ros1' is not 'ros2'"):
        BagReader(foreign(tmp_path / "a.mcap", profile="ros1"))
    with pytest.raises(BagError, match="/dev/null: not a file: a pipe or a device cannot be read"):
        BagReader("/dev/null")


@pytest.mark.parametrize(
    ("encoding", "schema"), [("json", "ros2msg"), ("cdr", "ros2idl"), ("ros1", "ros1msg")]
)
def test_foreign_encoding_matters_where_it_is_asked_for(tmp_path, encoding, schema):
    reader = BagReader(foreign(tmp_path / "a.mcap", encoding=encoding, schema=schema))
    assert reader.topics() == {"/a": IMU, "/b": IMU}
    assert [m.topic for m in reader.messages(["/b"])] == ["/b"]
    with pytest.raises(BagError, match=rf"topic /a is encoded as {encoding} with a .* {schema}"):
        reader.messages(["/a"])


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\0\1\0",
        b"\0\7\0\0" + bytes(400),
        cdr.serialize(imu(1), IMU)[:-40],
        cdr.serialize(imu(1), IMU) + bytes(100),
        b"\0\1\0\0" + b"\xff" * 400,
        cdr.serialize(builder.image(0, np.zeros((4, 4), np.uint8)), "sensor_msgs/msg/Image"),
    ],
)
def test_bytes_that_are_no_message(data):
    with pytest.raises(MessageError, match=r"/imu/data: .* sensor_msgs/msg/Imu"):
        cdr.deserialize(data, IMU, "/imu/data")


@pytest.mark.parametrize("little_endian", [True, False])
def test_the_stamp_of_a_header(little_endian):
    message = imu(1_634_731_235_605_555_556)
    store = get_typestore(Stores.ROS2_JAZZY)
    data = bytes(store.serialize_cdr(message, IMU, little_endian=little_endian))
    assert header_stamp_ns(data) == 1_634_731_235_605_555_556


@pytest.mark.parametrize("length", [0, 1, 4, 11])
def test_bytes_that_end_before_it_hold_none(length):
    with pytest.raises(MessageError, match=f"^{length} bytes are too few for a header"):
        header_stamp_ns(bytes(length))


COUNT = 3000


def grow(writer, count=COUNT):
    message = builder.imu(SAMPLE)
    for number in range(count):
        writer.write("/imu/data", IMU, message, 10**18 + number * 10**7)


def test_a_kill_takes_the_newest_chunk_alone(tmp_path):
    path = tmp_path / "flight.mcap"
    child = os.fork()
    if not child:
        with BagWriter(path, growing=True) as writer:
            grow(writer)
            writer.flush()
            os.kill(os.getpid(), signal.SIGKILL)
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL
    reader = BagReader(path)
    assert "the file ends early" in reader.damage
    read = sum(1 for _ in reader.messages())
    assert COUNT - read < 400  # of 344 bytes, in a chunk of 128 kB
    assert [each.name for each in tmp_path.iterdir()] == ["flight.mcap"]


def test_an_error_leaves_what_was_written_and_its_end(tmp_path):
    path = tmp_path / "flight.mcap"

    def spoilt():
        with BagWriter(path, growing=True) as writer:
            grow(writer, 100)
            writer.write("/imu/data", "sensor_msgs/msg/Image", b"", 10**18)

    with pytest.raises(BagError, match="no sensor_msgs/msg/Image can be"):
        spoilt()
    assert BagReader(path).damage is None
    assert sum(1 for _ in BagReader(path).messages()) == 100
