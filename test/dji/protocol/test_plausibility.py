"""A wrong table of the right length is noticed; what an aircraft sends is not doubted."""

from __future__ import annotations

import json
import math

import pytest

from tirgeo_ros.dji.link.framing import FrameReader
from tirgeo_ros.dji.protocol.broadcast_parts import (
    Battery,
    GimbalAngles,
    GpsFused,
    GpsPosition,
    HardSync,
    RtkPosition,
    Velocity,
)
from tirgeo_ros.dji.protocol.plausibility import doubtful
from tirgeo_ros.dji.protocol.subscription import (
    Package,
    PackageTable,
    Push,
    decode_push,
    encode_push,
)

LEVEL = (1.0, 0.0, 0.0, 0.0)
DOWN = (0.0, 0.0, -1.0)
STILL = (0.0, 0.0, 0.0)


def doubts(**values):
    package = Package.of(0, 5, with_timestamp=False, names=values)
    return doubtful(Push(package, None, None, values))


def hard_sync(q_wxyz=LEVEL, accel_g=DOWN, gyro_radps=STILL):
    return HardSync(1, 2, 3, 4, 0, q_wxyz, accel_g, gyro_radps)


POSSIBLE = {
    "QUATERNION": [(0.0, 0.0, 0.0, -1.0), (1.009, 0.0, 0.0, 0.0)],
    "VELOCITY": [Velocity((30.0, -30.0, 10.0))],
    "GPS_DATE": [0, 20241231],
    "GPS_TIME": [0, 235960],
    "GPS_POSITION": [
        GpsPosition(1796543210, -899999999, -400000),
        GpsPosition(-899999999, 1796543210, 0),
    ],
    "GPS_FUSED": [GpsFused(math.pi, -math.pi / 2, 594.0, 14)],
    "RTK_POSITION": [RtkPosition(180.0, -90.0, 8848.0)],
    "RTK_YAW": [360],
    "GIMBAL_ANGLES": [GimbalAngles(-90.0, 180.0, 359.9)],
    "BATTERY_INFO": [Battery(4500, 25000, -30000, 100)],
    "HARD_SYNC": [hard_sync(accel_g=(0.0, 0.0, 0.0))],
    "GPS_CONTROL_LEVEL": [5],
    "RTK_POSITION_INFO": [255],
}
IMPOSSIBLE = {
    "QUATERNION": [(0.0, 0.0, 0.0, 0.0), (1.011, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0)],
    "ACCELERATION_RAW": [(0.0, 0.0, 1e6)],
    "ANGULAR_RATE_RAW": [(0.0, math.inf, 0.0)],
    "VELOCITY": [Velocity((math.nan, 0.0, 0.0))],
    "GPS_DATE": [20241331, 4294967295],
    "GPS_TIME": [250000, 126100],
    "GPS_POSITION": [GpsPosition(910000000, 910000000, 0)],
    "GPS_FUSED": [GpsFused(0.0, 1.6, 0.0, 14)],
    "RTK_POSITION": [RtkPosition(181.0, 0.0, 0.0), RtkPosition(math.nan, 0.0, 0.0)],
    "RTK_VELOCITY": [(0.0, 0.0, 2e4)],
    "RTK_YAW": [-32768],
    "GIMBAL_ANGLES": [GimbalAngles(0.0, 1e4, 0.0)],
    "BATTERY_INFO": [Battery(4500, 25000, -30000, 101)],
    "HARD_SYNC": [
        hard_sync(q_wxyz=(0.5, 0.0, 0.0, 0.0)),
        hard_sync(accel_g=(0.0, 0.0, math.nan)),
        hard_sync(gyro_radps=(1e3, 0.0, 0.0)),
    ],
    "GPS_SIGNAL_LEVEL": [6],
}


@pytest.mark.parametrize("name", POSSIBLE)
def test_what_an_aircraft_may_send_is_not_doubted(name):
    assert [doubts(**{name: value}) for value in POSSIBLE[name]] == [[]] * len(POSSIBLE[name])


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_what_no_aircraft_can_mean_is(name):
    assert all(doubts(**{name: value}) == [name] for value in IMPOSSIBLE[name])


def test_a_wrong_order_of_the_right_length_is_noticed():
    asked = Package.of(2, 50, with_timestamp=False, names=("GPS_FUSED", "QUATERNION", "VELOCITY"))
    believed = Package.of(
        2, 50, with_timestamp=False, names=[*reversed([t.name for t in asked.topics])]
    )
    values = {
        "GPS_FUSED": GpsFused(0.076, 0.9078, 28.5, 14),
        "QUATERNION": (0.6, 0.0, 0.0, 0.8),
        "VELOCITY": Velocity((7.0, -1.0, 0.5), 1),
    }
    value = encode_push(Push(asked, None, None, values))
    assert doubtful(decode_push(value, PackageTable([asked]))) == []
    push = decode_push(value, PackageTable([believed]))
    assert "QUATERNION" in doubtful(push)


def test_the_example_pushes_are_not_doubted(shared):
    data = (shared / "dji" / "frames.bin").read_bytes()
    lines = map(json.loads, (shared / "dji" / "frames.jsonl").read_text().splitlines())
    number = sum(line["kind"] == "subscription" for line in lines)
    reader = FrameReader()
    frames = [f for f in reader.feed(data) + reader.rescan() if f.cmd_id == 5]
    assert [doubtful(decode_push(f.value, PackageTable())) for f in frames] == [[]] * number
