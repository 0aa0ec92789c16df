"""The printed fields against the example frames, and where those frames say nothing."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.dji.protocol.broadcast import Broadcast, Layout, decode_broadcast, encode_broadcast
from tirgeo_ros.dji.protocol.broadcast_parts import (
    Battery,
    Gps,
    Position,
    Status,
    Time,
    Velocity,
)
from tirgeo_ros.dji.protocol.printed_fields import broadcast_fields, push_fields
from tirgeo_ros.dji.protocol.subscription import Package, PackageTable, decode_push


def test_a_32_bit_number_is_printed_as_told_apart_from_its_neighbours():
    numbers = np.array([0.1, 1 / 3, 7.3499999, -1e-30, 3.4028235e38, 1.0000001], dtype=np.float32)
    for number in numbers:
        table = PackageTable([Package.of(0, 50, with_timestamp=False, names=("HEIGHT_FUSION",))])
        push = decode_push(b"\x00" + number.tobytes(), table)
        printed = push_fields(push)["HEIGHT_FUSION"]
        assert np.float32(printed) == number
        assert len(f"{printed!r}".lstrip("-0.").partition("e")[0].replace(".", "")) <= 9


def test_the_old_layouts_leave_out_what_they_lack():
    broadcast = Broadcast(
        Layout.LEGACY,
        time=Time(98760, 741636, None, None, 1),
        velocity=Velocity((1.5, -2.5, 3.5), 0b10101),
        position=Position(0.5, 0.25, 28.5, 25.0, 4),
        gps=Gps(20240611, 74439, 43574718, 520116395, 29339, (732.0, 2.0, -51.0)),
        status=Status(2),
        battery=Battery(None, None, None, 36),
    )
    found = broadcast_fields(decode_broadcast(encode_broadcast(broadcast)))
    assert found["time"] == {
        "time_ms": 98760,
        "time_ns": 741636,
        "time_s": 98.76,
        "sync_flag": 1,
    }
    assert found["velocity"] == {"xyz_mps": [1.5, -2.5, 3.5], "health": 1, "sensor_id": 10}
    assert "detail" not in found["gps"]
    assert found["status"] == {"flight": 2}
    assert found["battery"] == {"percentage": 36}
    assert "relative_position" not in found
