"""The printed fields against the example frames, and where those frames say nothing."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tirgeo_ros.dji.link.framing import FrameReader
from tirgeo_ros.dji.protocol.broadcast import Broadcast, Layout, decode_broadcast, encode_broadcast
from tirgeo_ros.dji.protocol.broadcast_parts import (
    Battery,
    Gps,
    Position,
    RelativePosition,
    Status,
    Time,
    Velocity,
)
from tirgeo_ros.dji.protocol.printed_fields import broadcast_fields, push_fields
from tirgeo_ros.dji.protocol.subscription import Package, PackageTable, Push, decode_push


def leaves(tree, path=()):
    """Every number and text of a JSON value with the way to it."""
    if isinstance(tree, dict):
        for key, item in tree.items():
            yield from leaves(item, (*path, key))
    elif isinstance(tree, list):
        for index, item in enumerate(tree):
            yield from leaves(item, (*path, index))
    else:
        yield path, tree


def fields_of(frame):
    if frame.cmd_id == 0:
        return broadcast_fields(decode_broadcast(frame.value))
    return push_fields(decode_push(frame.value, PackageTable()))


def test_every_field_of_the_example_frames_is_equal(shared):
    lines = (shared / "dji" / "frames.jsonl").read_text().splitlines()
    data = (shared / "dji" / "frames.bin").read_bytes()
    reader = FrameReader()
    frames = reader.feed(data) + reader.rescan()
    assert len(frames) == len(lines)
    compared = 0
    for frame, line in zip(frames, map(json.loads, lines), strict=True):
        found, wanted = fields_of(frame), line["fields"]
        ours, theirs = dict(leaves(found)), dict(leaves(wanted))
        assert list(ours) == list(theirs)  # names, nesting and order
        for path, value in theirs.items():
            assert ours[path] == value, path  # as printed: nine digits, or all of 64 bits
            if isinstance(value, float):
                assert np.float32(ours[path]) == np.float32(value), path
            compared += 1
    assert compared > 30 * len(frames)


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


@pytest.mark.parametrize(
    ("name", "value", "fields"),
    [
        ("COMPASS", (1, -2, 3), [1, -2, 3]),
        ("HOME_POINT_INFO", (0.9077741951010228, 0.1), [0.9077741951010228, 0.1]),
        ("RC_WITH_FLAG_DATA", (0.5, -0.5, 0.0, 0.25, 7), [0.5, -0.5, 0.0, 0.25, 7]),
        (
            "AVOID_DATA",
            RelativePosition(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 63),
            {
                "down_m": 1.0,
                "front_m": 2.0,
                "right_m": 3.0,
                "back_m": 4.0,
                "left_m": 5.0,
                "up_m": 6.0,
                "health_bits": 63,
            },
        ),
    ],
)
def test_a_topic_has_its_fields(name, value, fields):
    package = Package.of(0, 5, with_timestamp=True, names=(name,))
    found = push_fields(Push(package, 123856, 378900, {name: value}))
    stamp = {"time_ms": 123856, "time_ns": 378900, "time_s": 123.856}
    assert found == {"timestamp": stamp, name: fields}
