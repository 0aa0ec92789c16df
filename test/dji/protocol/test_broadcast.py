"""Broadcasts in their two layouts, against the documented tables and against themselves."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from dji_layouts import FORMS, MODERN_BYTES, form_of, values
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.dji.link.framing import FrameReader
from tirgeo_ros.dji.protocol.broadcast import (
    Layout,
    broadcast_length,
    decode_broadcast,
    encode_broadcast,
)
from tirgeo_ros.dji.protocol.broadcast_parts import (
    Battery,
    Position,
    Status,
    Time,
    Velocity,
)


def test_each_part_is_as_long_as_documented():
    assert tuple(struct.calcsize(f"<{form}") for form in FORMS[Layout.MODERN].values()) == (
        MODERN_BYTES
    )
    for bit, length in enumerate(MODERN_BYTES):
        assert broadcast_length(Layout.MODERN, 1 << bit) == 2 + length
    assert broadcast_length(Layout.MODERN, 0x3FFF) == 282
    assert broadcast_length(Layout.MODERN, 0x7FFF) == 283
    # Of the old layouts: 9 bytes of time, 25 of position, 32 of GPS, 1 of status and battery.
    lengths = [broadcast_length(Layout.LEGACY, 1 << bit) for bit in (0, 5, 6, 11, 12)]
    assert lengths == [2 + 9, 2 + 25, 2 + 32, 2 + 1, 2 + 1]


def lengths_of(layout):
    """Of every mask, by the tables of the tests; -1 where the layout lacks a bit."""
    masks = np.arange(1 << 15)
    lengths = np.full(masks.shape, 2)
    for bit, form in FORMS[layout].items():
        lengths += struct.calcsize(f"<{form}") * (masks >> bit & 1)
    known = sum(1 << bit for bit in FORMS[layout])
    return np.where(masks & ~known, -1, lengths)


def test_no_length_fits_two_layouts_that_mean_different_things():
    one, other = Layout
    masks = np.arange(1 << 15)
    same = (lengths_of(one) == lengths_of(other)) & (lengths_of(one) > 0)
    differing = sum(1 << bit for bit in range(15) if FORMS[one].get(bit) != FORMS[other].get(bit))
    assert same.any()
    assert not (masks[same] & differing).any()


@given(st.integers(0, 0xFFFF), st.integers(0, 300))
def test_a_length_of_no_layout_is_refused(mask, length):
    fits = any(broadcast_length(layout, mask) == length for layout in Layout)
    found = decode_broadcast(struct.pack("<H", mask).ljust(length, b"\0")[:length])
    assert (found is not None) == fits


@pytest.mark.parametrize("layout", Layout)
@given(data=st.data())
def test_what_is_decoded_encodes_to_the_same_bytes(layout, data):
    value = data.draw(values(layout))
    found = decode_broadcast(value)
    assert encode_broadcast(found) == value
    assert decode_broadcast(encode_broadcast(found)) == found


def test_the_old_layout_of_the_m600():
    mask = 0x1FFF & ~0x0600
    numbers = [
        *(98760, 741636, 1),  # time, ns, flag
        *(0.5, 0.5, 0.5, 0.5),
        *(0.0, 0.25, -1.0),
        *(1.5, -2.5, 3.5, 0b10101),  # health, sensor 10
        *(0.125, 0.25, 0.5),
        *(0.9, 0.1, 28.5, 25.0, 4),  # no obstacles behind it
        *(20240611, 74439, 43574718, 520116395, 29339, 732.0, 2.0, -51.0),
        *(20240611, 74439, 4.3, 52.0, 28.25, 735.0, 0.0, -50.0, -90, 50, 34),
        *(-828, 1248, -1047),
        2,
        36,
    ]
    found = decode_broadcast(struct.pack(form_of(Layout.LEGACY, mask), mask, *numbers))
    assert found.layout is Layout.LEGACY
    assert found.time == Time(98760, 741636, None, None, 1)
    assert found.velocity == Velocity((1.5, -2.5, 3.5), 0b10101)
    assert found.position == Position(0.9, 0.1, 28.5, 25.0, 4)
    assert found.relative_position is None
    assert found.gps.vel_ned_cmps == (732.0, 2.0, -51.0)
    assert found.gps.detail is None
    assert (found.rtk.yaw_deg, found.rtk.pos_flag, found.rtk.yaw_flag) == (-90, 50, 34)
    assert found.mag == (-828, 1248, -1047)
    assert found.status == Status(2)
    assert found.battery == Battery(None, None, None, 36)
    assert found.mask == mask


def test_the_example_frames_encode_to_the_same_bytes(shared):
    data = (shared / "dji" / "frames.bin").read_bytes()
    lines = map(json.loads, (shared / "dji" / "frames.jsonl").read_text().splitlines())
    masks = [line["mask"] for line in lines if line["kind"] == "broadcast"]
    reader = FrameReader()
    frames = [f for f in reader.feed(data) + reader.rescan() if f.cmd_id == 0]
    found = [decode_broadcast(frame.value) for frame in frames]
    assert [broadcast.mask for broadcast in found] == masks
    assert [encode_broadcast(b) for b in found] == [frame.value for frame in frames]
