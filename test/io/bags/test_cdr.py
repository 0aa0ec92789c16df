"""What is read of a message without decoding it."""

from __future__ import annotations

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.io.bags.cdr import Cdr, header_stamp_ns
from tirgeo_ros.io.messages import Messages

IMU = "sensor_msgs/msg/Imu"
STAMP_NS = 1_634_731_235_605_555_556


@pytest.mark.parametrize("little_endian", [True, False])
def test_the_stamp_of_a_header(little_endian):
    message = Messages(Cdr().types).imu(ImuSample(STAMP_NS, np.zeros(3), np.zeros(3)))
    store = get_typestore(Stores.ROS2_JAZZY)
    data = bytes(store.serialize_cdr(message, IMU, little_endian=little_endian))
    assert header_stamp_ns(data) == STAMP_NS


@pytest.mark.parametrize("length", [0, 1, 4, 11])
def test_bytes_that_end_before_it_hold_none(length):
    with pytest.raises(MessageError, match=f"^{length} bytes hold no header"):
        header_stamp_ns(bytes(length))
