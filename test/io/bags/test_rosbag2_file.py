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
"""Bags by rosbag2_py, where the package mcap is absent.

rosbag2_py comes with a ROS from Ubuntu's packages and is not to be had here: its place takes the
stand-in of test/support/stand_ins, which has the real one's interface and reads and writes by
``mcap``. So these tests hold what we ask of rosbag2, not what rosbag2 does.
"""

from __future__ import annotations

import importlib
import sys
from itertools import islice

import pytest
import stand_ins.rosbag2_py
import yaml
from mcap.reader import make_reader

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags import bag
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.bags.mcap_file import McapFile

OURS = "tirgeo_ros.io.bags"
IMU = "sensor_msgs/msg/Imu"
DATA = b"\0\1\0\0" + bytes(8)


@pytest.fixture
def without_mcap(monkeypatch):
    for name in ("mcap", "zstandard", "rosbag2_py"):
        monkeypatch.setitem(sys.modules, name, None)


@pytest.fixture
def rosbag2(monkeypatch, without_mcap):
    """Have rosbag2_py, and no mcap."""
    monkeypatch.setitem(sys.modules, "rosbag2_py", stand_ins.rosbag2_py)
    monkeypatch.delitem(sys.modules, f"{OURS}.rosbag2_file", raising=False)
    return importlib.import_module(f"{OURS}.rosbag2_file")


def kinds(reader):
    return {type(file) for file in reader._files}


def test_it_reads_what_mcap_reads(sample, request):
    path = sample / "flight.mcap"
    ours = BagReader(path)
    assert kinds(ours) == {McapFile}
    topics = sorted(ours.topics())[:4]
    expected = list(islice(ours.messages(topics, ours.span_ns[0] + 10**9), 3000))
    rosbag2 = request.getfixturevalue("rosbag2")
    theirs = BagReader(path)
    assert kinds(theirs) == {rosbag2.Rosbag2File}
    assert (theirs.topics(), theirs.span_ns) == (ours.topics(), ours.span_ns)
    assert list(islice(theirs.messages(topics, ours.span_ns[0] + 10**9), 3000)) == expected
    assert list(theirs.messages(())) == []
    assert theirs.damage is None


def test_a_recording_is_one_file_in_the_end(tmp_path, rosbag2):
    path = tmp_path / "out.mcap"
    path.write_text("of an earlier recording")
    with BagWriter(path, growing=True) as writer:
        for number in range(5):
            writer.write("/imu/data", IMU, DATA + bytes([number]), number + 7)
            writer.write("/tirgeo/origin", "sensor_msgs/msg/NavSatFix", DATA, number + 7)
        writer.flush()
        assert path.is_dir()
        assert not (path / "metadata.yaml").exists()
    assert path.is_file()
    assert list(tmp_path.iterdir()) == [path]
    reader = BagReader(path)
    assert reader.topics() == {"/imu/data": IMU, "/tirgeo/origin": "sensor_msgs/msg/NavSatFix"}
    found = [(item.log_time_ns, item.data) for item in reader.messages(["/imu/data"])]
    assert found == [(number + 7, DATA + bytes([number])) for number in range(5)]


def test_topics_keep_the_qos_that_is_offered(tmp_path, rosbag2):
    path = tmp_path / "out.mcap"
    with BagWriter(path) as writer:
        writer.write("/tirgeo/origin", "sensor_msgs/msg/NavSatFix", DATA, 1)
    with path.open("rb") as file:
        (channel,) = make_reader(file).get_summary().channels.values()
    (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
    assert profile["durability"] == "transient_local"


def test_an_error_leaves_nothing_behind(tmp_path, rosbag2):
    def written():
        with BagWriter(tmp_path / "out.mcap") as writer:
            writer.write("/imu/data", IMU, DATA, 1)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        written()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_named(tmp_path, rosbag2):
    (tmp_path / "file").touch()
    path = tmp_path / "file" / "out.mcap"
    with pytest.raises(BagError, match=f"{path}: cannot be written: "), BagWriter(path):
        pass


def test_a_late_message_and_a_fault_are_losses(tmp_path, rosbag2, monkeypatch):
    path = tmp_path / "out.mcap"
    with BagWriter(path) as writer:
        for time_ns in (1, 2, 1 << 62):
            writer.write("/imu/data", IMU, DATA, time_ns)
    reader = BagReader(path)
    assert [item.log_time_ns for item in reader.messages()] == [1, 2]
    assert "1 messages with a log time after 2038 left out" in reader.damage

    def fail(_):
        raise RuntimeError("zstd failed\nmore")

    monkeypatch.setattr(stand_ins.rosbag2_py.SequentialReader, "read_next", fail)
    assert list(reader.messages()) == []
    assert reader.damage.startswith("rosbag2 cannot read on (zstd failed); ")


def test_what_rosbag2_cannot_open_says_what_can(tmp_path, rosbag2):
    path = tmp_path / "cut.mcap"
    with BagWriter(path) as writer:
        writer.write("/imu/data", IMU, DATA, 1)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(BagError, match=r"rosbag2 cannot read it: .*pip install mcap"):
        BagReader(path)


def test_without_either_the_package_is_named(tmp_path, without_mcap):
    path = tmp_path / "some.mcap"
    path.write_bytes(bag.MCAP_MAGIC)
    with pytest.raises(BagError, match=f"a bag such as {path} needs mcap: pip install mcap"):
        BagReader(path)


def test_a_compressed_file_needs_a_package(tmp_path, without_mcap):
    path = tmp_path / "some.mcap.zstd"
    path.write_bytes(bag.ZSTD_MAGIC)
    with pytest.raises(BagError, match=f"reading {path} needs zstandard: .*pip install zstandard"):
        BagReader(path)
    assert list(tmp_path.iterdir()) == [path]
