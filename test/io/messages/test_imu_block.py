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
"""Blocks of Imu messages are read as the messages are one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from rosbags.typesys import Stores, get_typestore

from tirgeo_ros.io.bags.bag import Cdr
from tirgeo_ros.io.messages import stamp_ns
from tirgeo_ros.tools.calibrate.imu import imu_block

TYPE = "sensor_msgs/msg/Imu"
CDR = Cdr()


def message(frame="imu", stamp=(7, 5), rate=(1.0, 2.0, 3.0), force=(4.0, 5.0, 9.8), absent=()):
    vector = CDR.types("geometry_msgs/msg/Vector3")
    covariances = [np.full(9, 0.5) for _ in range(3)]
    for k in absent:
        covariances[k][0] = -1.0
    header = CDR.types("std_msgs/msg/Header")(
        CDR.types("builtin_interfaces/msg/Time")(*stamp), frame
    )
    turn = CDR.types("geometry_msgs/msg/Quaternion")(0.1, 0.2, 0.3, 0.9)
    a, b, c = covariances
    return CDR.types(TYPE)(header, turn, a, vector(*rate), b, vector(*force), c)


def cdr(msg, *, big=False):
    store = get_typestore(Stores.ROS2_JAZZY)
    return (
        CDR.serialize(msg)
        if not big
        else bytes(store.serialize_cdr(of_rosbags(msg, store), TYPE, little_endian=False))
    )


def of_rosbags(part, store):
    """Return a message as one of rosbags' classes."""
    if not hasattr(part, "__msgtype__"):
        return part
    parts = (getattr(part, name) for name in part.__dataclass_fields__)
    return store.types[part.__msgtype__](*[of_rosbags(each, store) for each in parts])


numbers = st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 3)


@settings(max_examples=60, deadline=None)
@given(
    given_messages=st.lists(
        st.tuples(
            st.text("abé_/", max_size=12),
            st.tuples(st.integers(0, 2**31 - 1), st.integers(0, 999_999_999)),
            numbers,
            numbers,
            st.booleans(),
        ),
        max_size=8,
    )
)
def test_a_block_is_its_messages(given_messages):
    data = [cdr(message(f, s, r, a), big=big) for f, s, r, a, big in given_messages]
    block = imu_block(data)
    read = [CDR.deserialize(item, TYPE) for item in data]
    assert block.unreadable == 0
    assert block.stamps_ns.tolist() == [stamp_ns(item) for item in read]
    assert block.values.shape == (len(data), 6)
    for row, item in zip(block.values, read, strict=True):
        r, f = item.angular_velocity, item.linear_acceleration
        np.testing.assert_array_equal(row, [r.x, r.y, r.z, f.x, f.y, f.z])


def test_what_is_no_imu_is_counted_and_passed_by():
    good = cdr(message(stamp=(1, 0)))
    huge = bytearray(good)
    huge[12:16] = b"\xff\xff\xff\xff"  # a frame_id of 4 GB
    broken = [b"", good[:3], good[:15], good[:-1], b"\0\3" + good[2:], bytes(huge)]
    block = imu_block([*broken, good, good + bytes(7)])  # bytes behind a message do no harm
    assert block.unreadable == len(broken)
    assert block.stamps_ns.tolist() == [1_000_000_000] * 2
    assert block.values.tolist() == [[1.0, 2.0, 3.0, 4.0, 5.0, 9.8]] * 2


@pytest.mark.parametrize(("absent", "columns"), [(1, slice(0, 3)), (2, slice(3, 6))])
def test_a_value_marked_absent_is_nan(absent, columns):
    block = imu_block([cdr(message(absent=(absent,)))])
    assert np.isnan(block.values[0, columns]).all()
    assert np.isfinite(np.delete(block.values[0], np.r_[columns])).all()
