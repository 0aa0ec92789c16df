"""A bag by rosbags, as ROS 2 records one: latched topics, a type that nobody knows, QoS."""

from __future__ import annotations

import struct
from importlib.metadata import version as version_of

import pytest
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

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


def said():
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
        for log_ns, topic, data in said():
            writer.write(connections[topic], log_ns, data)
    return folder
