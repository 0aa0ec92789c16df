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
"""Parts of a flight: every message in them as it was, and before them what a late reader needs."""

from __future__ import annotations

import struct
from datetime import datetime, timezone
from importlib.metadata import version as version_of

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from recorded_bags import MESSAGES, record
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_typestore

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.replay.cut import cut

START_NS = 1_634_731_235_000_000_000  # 2021-10-20, 12:00:35 UTC
STORE = get_typestore(Stores.ROS2_JAZZY)
THING, THING_TEXT = "other_msgs/msg/Thing", "uint32 number\n"
STRING, INFO = "std_msgs/msg/String", "sensor_msgs/msg/CameraInfo"
TF, FIX = "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/NavSatFix"
VOLATILE, LATCHED = QosDurability.VOLATILE, QosDurability.TRANSIENT_LOCAL
#: topic -> type, durability, seconds after the start of its messages.
TOPICS = {
    "/imu/data": ("sensor_msgs/msg/Imu", VOLATILE, [0.01 * k for k in range(300)]),
    "/thing": (THING, VOLATILE, [0.1 * k for k in range(30)]),
    "/chatter": (STRING, VOLATILE, [0.0]),
    "/robot_description": (STRING, LATCHED, [0.0]),
    "/tf_static": (TF, LATCHED, [0.0, 0.5, 1.0]),
    "/tirgeo/origin": (FIX, LATCHED, [0.2, 0.9, 2.5]),
    "/thermal/camera_info": (INFO, VOLATILE, [0.05]),
    "/other/camera_info": (INFO, VOLATILE, [0.5 * k for k in range(6)]),
}
#: Of the three messages on /tf_static; the third is the first one's publisher again.
_FRAMES = ("antenna", "gimbal", "antenna")


def qos(durability):
    never = QosTime(9223372036, 854775807)
    kinds = QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, durability
    return Qos(*kinds, never, never, QosLiveliness.AUTOMATIC, never, False)


def payload(typename, number):
    """The bytes of a message; no two of a topic are alike."""
    if typename == THING:
        return b"\0\1\0\0" + struct.pack("<I", number)
    kind = STORE.types[typename]
    if typename == STRING:
        return bytes(STORE.serialize_cdr(kind(data=f"text {number}"), typename))
    if typename == TF:
        return bytes(STORE.serialize_cdr(kind(transforms=[_transform(number)]), typename))
    # Any bytes do for types that are not looked into.
    return b"\0\1\0\0" + struct.pack("<IIII", number, 1, 2, 3)


def _transform(number):
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](sec=number, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="base_link")
    return types["geometry_msgs/msg/TransformStamped"](
        header=header,
        child_frame_id=_FRAMES[number],
        transform=types["geometry_msgs/msg/Transform"](
            translation=types["geometry_msgs/msg/Vector3"](x=0.1, y=0.0, z=0.0),
            rotation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        ),
    )


def text():
    """Each message: log time, topic, bytes; in order of time."""
    every = [
        (START_NS + round(at_s * 1e9), topic, payload(typename, number))
        for topic, (typename, _, times_s) in TOPICS.items()
        for number, at_s in enumerate(times_s)
    ]
    return sorted(every, key=lambda one: one[0])


def recorded(folder, *, version=9, storage=StoragePlugin.MCAP, mode=CompressionMode.NONE):
    """Write the bag; return its folder."""
    if storage is StoragePlugin.MCAP and version_of("rosbags").startswith("0.10."):
        pytest.skip("rosbags before 0.11 writes no QoS into MCAP")
    writer = Writer(folder, version=version, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(
                topic,
                typename,
                msgdef=THING_TEXT if typename == THING else STORE.generate_msgdef(typename)[0],
                rihs01="RIHS01_" + 64 * "0" if typename == THING else STORE.hash_rihs01(typename),
                offered_qos_profiles=[qos(durability)],
            )
            for topic, (typename, durability, _) in TOPICS.items()
        }
        for log_ns, topic, data in text():
            writer.write(connections[topic], log_ns, data)
    return folder


FROM_S, TO_S = 1.5, 2.2
FORMS = {
    "mcap": {},
    "mcap of Humble": {"version": 8},
    "sqlite": {"storage": StoragePlugin.SQLITE3},
    "messages packed": {"mode": CompressionMode.MESSAGE},
    "file packed": {"mode": CompressionMode.FILE},
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("latched") / "bag")


def contents(path):
    """What MCAP's own reader finds: (log time, topic, bytes), and channel and schema by topic."""
    with path.open("rb") as file:
        outcome = [*make_reader(file, validate_crcs=True).iter_messages()]
    messages = [(one.log_time, channel.topic, one.data) for _, channel, one in outcome]
    return messages, {channel.topic: (channel, schema) for schema, channel, _ in outcome}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_a_part_of_every_form(tmp_path, form):
    bag, out = recorded(tmp_path / "bag", **form), tmp_path / "part.mcap"
    result = cut(bag, out, begin=FROM_S, end=TO_S)
    messages, channels = contents(out)
    start_ns, end_ns = (START_NS + round(at_s * 1e9) for at_s in (FROM_S, TO_S))
    inside = [one for one in text() if start_ns <= one[0] <= end_ns]
    carried = [
        ("/robot_description", 0),
        ("/thermal/camera_info", 0),
        ("/tf_static", 1),  # the first one's frame came again
        ("/tirgeo/origin", 1),
        ("/tf_static", 2),
    ]
    before = [(start_ns, topic, payload(TOPICS[topic][0], n)) for topic, n in carried]
    assert messages == [*before, *inside]
    assert {topic: schema.name for topic, (_, schema) in channels.items()} == {
        topic: TOPICS[topic][0] for topic in channels
    }
    for topic, (channel, _) in channels.items():
        (outcome,) = parse_qos(channel.metadata["offered_qos_profiles"])
        assert (outcome.durability is LATCHED) is (TOPICS[topic][1] is LATCHED)
        assert "history: keep_last" in channel.metadata["offered_qos_profiles"]
    schema = channels["/thing"][1]
    assert (schema.name, schema.encoding, schema.data) == (THING, "ros2msg", THING_TEXT.encode())
    assert result["error"] is None
    assert result["carried"] == {
        "/robot_description": 1,
        "/tf_static": 2,
        "/thermal/camera_info": 1,
        "/tirgeo/origin": 1,
    }


def test_a_split_bag_and_one_that_is_damaged(tmp_path):
    """The log times of these messages are 0 to 299 ns."""
    whole = record(tmp_path / "bag", [MESSAGES[:100], MESSAGES[100:200], MESSAGES[200:]])
    cut(whole, tmp_path / "part.mcap", begin=50e-9, end=250e-9)
    assert [*BagReader(tmp_path / "part.mcap").messages()] == MESSAGES[50:251]
    last = whole / "bag_2.mcap"
    last.write_bytes(last.read_bytes()[:-9000])
    result = cut(whole, tmp_path / "part.mcap", begin=50e-9)
    assert "bag_2.mcap" in result["error"]
    assert [*BagReader(tmp_path / "part.mcap").messages()][:100] == MESSAGES[50:150]


def test_messages_of_other_encodings_are_kept_too(tmp_path):
    source, out = tmp_path / "a.mcap", tmp_path / "part.mcap"
    with source.open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2", "another")
        idl = writer.register_schema("a_msgs/msg/B", "ros2idl", b"module a_msgs {};")
        kinds = {"/json": ("json", 0), "/idl": ("cdr", idl)}
        for number, (topic, kind) in enumerate(kinds.items()):
            writer.add_message(writer.register_channel(topic, *kind), 5 + number, b"{}", 5)
        writer.finish()
    cut(source, out)
    messages, channels = contents(out)
    assert messages == [(5, "/json", b"{}"), (6, "/idl", b"{}")]
    channel, _ = channels["/json"]
    assert (channel.message_encoding, channel.schema_id) == ("json", 0)
    assert channels["/idl"][1].data == b"module a_msgs {};"


def test_a_part_from_the_start_needs_nothing_carried(bag, tmp_path):
    result = cut(bag, tmp_path / "part.mcap", end=TO_S)
    assert result["carried"] == {}
    assert contents(tmp_path / "part.mcap")[0] == [
        one for one in text() if one[0] <= START_NS + round(TO_S * 1e9)
    ]


def test_impossible_cuts_are_refused(bag, tmp_path):
    for times in ({"begin": 5.0}, {"end": datetime(2020, 1, 1, tzinfo=timezone.utc)}):
        with pytest.raises(BagError, match="no message between these times: the flight is"):
            cut(bag, tmp_path / "part.mcap", **times)
    assert [*tmp_path.iterdir()] == []


def test_the_command(bag, tmp_path, capsys):
    argv = ["--from", "2021-10-20T12:00:36.5", "--to", "2.2"]
    assert main(["cut", str(bag), "-o", str(tmp_path / "part.mcap"), *argv]) == 0
    text = capsys.readouterr().out
    assert "from utc  2021-10-20T12:00:36.500Z\n" in text
    assert "messages  /imu/data: 71; /other/camera_info: 2; /thing: 8\n" in text
    cut(bag, tmp_path / "seconds.mcap", begin=FROM_S, end=TO_S)
    assert (tmp_path / "seconds.mcap").read_bytes() == (tmp_path / "part.mcap").read_bytes()
