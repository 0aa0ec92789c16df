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
"""Tables of bags hold what another reader of bags finds in them, and bags what the tables hold."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from process_bags import rewritten
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import tirgeo_ros
from tirgeo_ros import BagError, TableError, TirgeoError
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.library.tables import SENSORS


@pytest.fixture(scope="module")
def judged(short):
    """Messages of each topic, (log time, message), by rosbags."""
    result = {}
    with AnyReader([short], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for link, log_ns, data in reader.messages():
            message = reader.deserialize(data, link.msgtype)
            result.setdefault(link.topic.lstrip("/"), []).append((log_ns, message))
    return result


def test_every_message_of_every_known_topic_is_there(tables, judged):
    assert set(tables) == set(judged) & set(SENSORS)
    for topic, table in tables.items():
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in judged[topic]]
        assert table["stamp_ns"].tolist() == stamps
        assert table["arrival_ns"].tolist() == [log_ns for log_ns, _ in judged[topic]]
    order = np.concatenate([table["arrival_order"] for table in tables.values()])
    assert sorted(order) == list(range(len(order)))


def test_the_columns_are_the_fields_in_the_core_s_axes(tables, judged):
    """ROS has east-north-up and forward-left-up, degrees in a fix; a column names its own axis."""
    (_, imu), (_, fix), (_, vel) = (judged[t][3] for t in ("imu/data", "rtk/fix", "rtk/vel"))
    row = {
        topic: {name: item[3] for name, item in table.items()} for topic, table in tables.items()
    }
    assert row["imu/data"]["force_right_m_s2"] == -imu.linear_acceleration.y
    assert row["imu/data"]["rate_forward_rad_s"] == imu.angular_velocity.x
    assert row["imu/data"]["force_down_m_s2"] == -imu.linear_acceleration.z < -9
    assert row["rtk/fix"]["latitude_rad"] == np.radians(fix.latitude)
    assert row["rtk/fix"]["height_m"] == fix.altitude
    assert row["rtk/fix"]["status"] == fix.status.status == 2
    assert row["rtk/fix"]["variance_east_m2"] == fix.position_covariance[0]
    assert row["rtk/vel"]["velocity_north_m_s"] == vel.twist.twist.linear.y
    assert row["rtk/vel"]["velocity_down_m_s"] == -vel.twist.twist.linear.z
    joints = judged["gimbal/joint_states"][3][1]
    angles = dict(zip(joints.name, joints.position, strict=True))
    assert row["gimbal/joint_states"]["pitch_rad"] == -angles["gimbal_pitch_joint"]


def test_a_written_bag_holds_the_tables_again(tables, tmp_path):
    """Degrees and quaternions in between cost a digit of the last place; stamps nothing."""
    tirgeo_ros.write_bag(tmp_path / "again.mcap", tables)
    again = tirgeo_ros.read_bag(tmp_path / "again.mcap")
    assert list(again) == list(tables)
    for topic, table in tables.items():
        for name, item in table.items():
            if item.dtype == np.int64:
                assert np.array_equal(again[topic][name], item), (topic, name)
            else:
                assert np.allclose(again[topic][name], item, rtol=1e-14, atol=1e-15), (topic, name)


def test_another_reader_takes_what_was_written(tables, judged, tmp_path):
    tirgeo_ros.write_bag(tmp_path / "bag.mcap", tables, namespace="uav1")
    store = get_typestore(Stores.ROS2_JAZZY)
    count = 0
    with AnyReader([tmp_path / "bag.mcap"], default_typestore=store) as reader:
        types = {link.topic: link.msgtype for link in reader.connections}
        assert types == {f"/uav1/{topic}": TOPIC_TYPES[topic] for topic in tables}
        for link, log_ns, data in reader.messages():
            if link.topic == "/uav1/rtk/fix":
                fix, (expected_ns, expected) = (
                    reader.deserialize(data, link.msgtype),
                    judged["rtk/fix"][count],
                )
                assert log_ns == expected_ns
                assert fix.latitude == pytest.approx(expected.latitude, rel=1e-15)
                assert fix.position_covariance == pytest.approx(expected.position_covariance)
                count += 1
    assert count == len(judged["rtk/fix"])
    assert "imu/data" in tirgeo_ros.read_bag(
        tmp_path / "bag.mcap", ["imu/data"], namespace="/uav1"
    )


def test_pictures_and_camera(short, judged):
    pictures = list(tirgeo_ros.read_pictures(short))
    messages = judged["thermal/image_raw/compressed"]
    assert len(pictures) == len(messages) > 10
    camera = tirgeo_ros.read_camera(short)
    info = judged["thermal/camera_info"][0][1]
    assert (camera.width, camera.height, camera.fx) == (info.width, info.height, info.k[0])
    assert pictures[0].pixels.shape[:2] == (camera.height, camera.width)


def test_truth_is_a_table_too(sample, flight):
    truth = tirgeo_ros.read_bag(sample / "truth.mcap", ["tirgeo/odometry"])["tirgeo/odometry"]
    north_m = np.interp(flight.stamp_ns, truth["stamp_ns"], truth["north_m"])
    error = north_m - flight.position_n[:, 0]
    assert np.abs(error[100:] / flight.sigma[100:, 0]).max() < 5


@pytest.mark.parametrize(
    ("topics", "line"),
    [
        (["/imu/data"], r"/imu/data has no table \(did you mean imu/data\?\)"),
        (["baro/pressure"], r"no topic /baro/pressure; it has: /gimbal/attitude, "),
        (["thermal/camera_info"], r"pictures are not a table: use read_pictures and read_camera"),
    ],
)
def test_a_topic_that_cannot_be_read_is_named(short, topics, line):
    with pytest.raises(BagError, match=line):
        tirgeo_ros.read_bag(short, topics)
    with pytest.raises(BagError, match=r"no sensor and no pose in namespace uav1; it has: /gimb"):
        tirgeo_ros.read_bag(short, namespace="uav1")


def test_a_topic_of_another_type_is_named(short, tmp_path):
    swapped = rewritten(
        short,
        tmp_path / "swapped.mcap",
        lambda item: (item.topic.replace("rtk/fix", "x").replace("rtk/vel", "rtk/fix"), item.data),
        without=("/rtk/heading",),
    )
    with pytest.raises(BagError, match=r"/rtk/fix is of type geometry_msgs/msg/Twist.*not sensor"):
        tirgeo_ros.read_bag(swapped, ["rtk/fix"])
    assert "rtk/fix" not in tirgeo_ros.read_bag(swapped)


def test_what_cannot_be_read_is_warned_of(short, tmp_path):
    """A message cut in its middle is left out; the rest is read."""

    def cut(item):
        return item.topic, item.data[:40] if item.topic == "/rtk/fix" else item.data

    damaged = rewritten(short, tmp_path / "cut.mcap", cut)
    with pytest.warns(
        UserWarning, match=r"cut.mcap: 30 messages of /rtk/fix left out: .*40 bytes"
    ):
        tables = tirgeo_ros.read_bag(damaged)
    assert tables["rtk/fix"]["stamp_ns"].shape == (0,)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(tirgeo_ros.read_bag(damaged, ["imu/data"])["imu/data"]["stamp_ns"]) == 600


@pytest.mark.parametrize("column", ["stamp_ns", "arrival_ns"])
@pytest.mark.parametrize("wrong_ns", [-1, (1 << 31) * 10**9])
def test_a_time_that_a_bag_cannot_hold_is_named(tables, tmp_path, column, wrong_ns):
    imu = {name: item[:3].copy() for name, item in tables["imu/data"].items()}
    imu[column][1] = wrong_ns
    with pytest.raises(TableError, match=rf"imu/data: .*{column} {wrong_ns}.* from 1970 to 2038"):
        tirgeo_ros.write_bag(tmp_path / "bag.mcap", {"imu/data": imu})


@pytest.mark.parametrize("wrong", [None, 3, b"a", ["a"], "a\0b"])
def test_what_names_no_file_or_topic_is_one_line(tables, short, tmp_path, wrong):
    calls = {
        "read_bag": lambda: tirgeo_ros.read_bag(wrong),
        "read_camera": lambda: tirgeo_ros.read_camera(wrong),
        "read_pictures": lambda: next(tirgeo_ros.read_pictures(wrong)),
        "load_camera": lambda: tirgeo_ros.load_camera(wrong),
        "load_terrain": lambda: tirgeo_ros.load_terrain(wrong),
        "load_survey": lambda: tirgeo_ros.load_survey(wrong),
        "load_observations": lambda: tirgeo_ros.load_observations(wrong),
        "write_bag": lambda: tirgeo_ros.write_bag(wrong, tables),
        "process in": lambda: tirgeo_ros.process(wrong, tmp_path / "a.mcap"),
        "process out": lambda: tirgeo_ros.process(short, [wrong]),
        "save_located": lambda: tirgeo_ros.save_located(wrong, []),
        "tables": lambda: tirgeo_ros.write_bag(tmp_path / "a.mcap", wrong),
        "answers": lambda: tirgeo_ros.save_located(tmp_path / "a.csv", wrong),
        "topics": lambda: tirgeo_ros.read_bag(short, [wrong]),
        "one topic": lambda: tirgeo_ros.read_bag(short, wrong or 0.5),
    }
    for name, call in calls.items():
        with pytest.raises(TirgeoError) as raised:
            call()
        assert "\n" not in str(raised.value), name


def test_nothing_is_no_bag(tables, tmp_path):
    empty = {name: item[:0] for name, item in tables["imu/data"].items()}
    for nothing in ({}, {"imu/data": empty}):
        with pytest.raises(TableError, match=r"bag.mcap: no table has a row"):
            tirgeo_ros.write_bag(tmp_path / "bag.mcap", nothing)
    assert list(tmp_path.iterdir()) == []
