"""A bag that grows under its own name can be read whatever ends its writer."""

from __future__ import annotations

import os
import signal

import message_samples as given
import pytest

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.messages import Messages

IMU = Messages(Cdr().types).imu(given.IMU)
COUNT = 3000


def write(writer, count=COUNT):
    for number in range(count):
        writer.write("/imu/data", "sensor_msgs/msg/Imu", IMU, 10**18 + number * 10**7)


def test_a_kill_takes_the_newest_chunk_alone(tmp_path):
    path = tmp_path / "flight.mcap"
    child = os.fork()
    if not child:
        with BagWriter(path, growing=True) as writer:
            write(writer)
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
            write(writer, 100)
            writer.write("/imu/data", "sensor_msgs/msg/Image", b"", 10**18)

    with pytest.raises(BagError, match="cannot be"):
        spoilt()
    assert BagReader(path).damage is None
    assert sum(1 for _ in BagReader(path).messages()) == 100


def test_a_whole_bag_is_the_same_but_for_its_chunks(tmp_path):
    for growing in (True, False):
        with BagWriter(tmp_path / f"{growing}.mcap", growing=growing) as writer:
            write(writer)
    both = [list(BagReader(tmp_path / f"{growing}.mcap").messages()) for growing in (True, False)]
    assert both[0] == both[1]
