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
"""Our CDR against rosbags', for every message type of Jazzy, in both orders of bytes."""

from __future__ import annotations

import random
import struct

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Nodetype

from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.io.messages.cdr import Cdr

CDR = Cdr()
STORE = get_typestore(Stores.ROS2_JAZZY)
NUMBERS = {"byte": "u1", "char": "u1", "bool": "?"}


class Maker:
    """Makes messages of rosbags' classes with random values."""

    def __init__(self, seed):
        self.rng = random.Random(seed)

    def message(self, typename):
        fields = STORE.fielddefs[typename][1]
        return STORE.types[typename](**{name: self.value(kind) for name, kind in fields})

    def value(self, kind):
        node, inside = kind
        if node == Nodetype.BASE:
            return self.number(inside[0])
        if node == Nodetype.NAME:
            return self.message(inside)
        of, bound = inside
        count = bound if node == Nodetype.ARRAY else self.rng.randint(0, min(bound or 4, 4))
        values = [self.value(of) for _ in range(count)]
        if of[0] == Nodetype.NAME or of[1][0] == "string":
            return values
        return np.array(values, NUMBERS.get(of[1][0], of[1][0]))

    def number(self, name):
        if name == "string":
            return "".join(self.rng.choices("aé漢 ", k=self.rng.randint(0, 5)))
        if name.startswith("float"):
            return float(np.float32(self.rng.uniform(-1e3, 1e3)))
        return self.rng.random() < 0.5 if name == "bool" else self.rng.randint(0, 127)


def same(a, b):
    """Return whether two messages, of either kind of class, have equal values."""
    if isinstance(a, np.ndarray):
        return a.dtype.newbyteorder("=") == b.dtype.newbyteorder("=") and np.array_equal(a, b)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    if hasattr(a, "__msgtype__"):
        names = a.__dataclass_fields__
        return all(same(getattr(a, name), getattr(b, name)) for name in names)
    return type(a) is type(b) and a == b


@pytest.mark.parametrize("typename", sorted(STORE.fielddefs))
def test_every_type_is_read_and_written_as_by_rosbags(typename):
    maker = Maker(1)
    for _ in range(5):
        message = maker.message(typename)
        little = bytes(STORE.serialize_cdr(message, typename))
        big = bytes(STORE.serialize_cdr(message, typename, little_endian=False))
        for data in (little, big):
            decoded = CDR.deserialize(data, typename)
            assert same(message, decoded)
            assert CDR.serialize(decoded, typename) == little
    assert CDR.definition(typename) == STORE.generate_msgdef(typename, ros_version=2)[0]
    ours, theirs = CDR.types(typename), STORE.types[typename]
    for name, _, value in STORE.fielddefs[typename][0]:
        assert getattr(ours, name) == getattr(theirs, name) == value


@pytest.mark.parametrize("typename", ["sensor_msgs/msg/Imu", "visualization_msgs/msg/MarkerArray"])
def test_no_cut_message_is_read(typename):
    maker = Maker(2)
    data = CDR.serialize(maker.message(typename), typename)
    for length in range(len(data)):
        with pytest.raises(MessageError, match=f"^/a: {length} bytes are no {typename}"):
            CDR.deserialize(data[:length], typename, "/a")


def test_a_list_that_claims_more_than_there_is_is_refused_at_once():
    data = b"\0\1\0\0" + struct.pack("<I", 0xFFFFFFFF)
    with pytest.raises(MessageError):
        CDR.deserialize(data, "visualization_msgs/msg/MarkerArray")
    with pytest.raises(MessageError):
        CDR.deserialize(data + bytes(64), "std_msgs/msg/Float64MultiArray")


def test_what_cannot_be_written_is_an_error():
    imu = Maker(3).message("sensor_msgs/msg/Imu")
    imu.orientation_covariance = np.zeros(8)
    with pytest.raises(ValueError, match="9 are needed"):
        CDR.serialize(imu, "sensor_msgs/msg/Imu")


def test_an_unknown_type_is_named():
    assert "other_msgs/msg/Thing" not in CDR
    with pytest.raises(BagError, match="message type other_msgs/msg/Thing is not known"):
        CDR.types("other_msgs/msg/Thing")
