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
"""Broadcasts, packages and pushes, byte by byte as documented."""

from __future__ import annotations

import re
import struct

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import (
    Battery,
    GimbalAngles,
    GpsFused,
    Layout,
    Position,
    Status,
    Time,
    Velocity,
    broadcast_length,
    decode_broadcast,
    encode_broadcast,
)
from tirgeo_ros.dji.protocol.subscription import (
    TOPICS,
    USUAL_PACKAGES,
    Package,
    PackageTable,
    decode_push,
    encode_push,
    package_table,
)
from tirgeo_ros.tools.convert.dump import push_fields

#: Bytes of each part by bit, in the modern layout.
MODERN_BYTES = (15, 16, 12, 13, 12, 50, 68, 44, 6, 12, 13, 4, 13, 2, 1)

MODERN = {
    0: "IIIHB",
    1: "ffff",
    2: "fff",
    3: "fffB",
    4: "fff",
    5: "ddffB" + "ffffffB",
    6: "IIiiifff" + "ffffffIIHH",
    7: "IIddffffhBB",
    8: "hhh",
    9: "hhhhhh",
    10: "fffB",
    11: "BBBB",
    12: "IiiB",
    13: "BB",
    14: "B",
}
LEGACY = {bit: form for bit, form in MODERN.items() if bit != 14} | {
    0: "IIB",
    5: "ddffB",
    6: "IIiiifff",
    11: "B",
    12: "B",
}
FORMS = {Layout.MODERN: MODERN, Layout.LEGACY: LEGACY}


def form_of(layout, mask):
    return "<H" + "".join(form for bit, form in FORMS[layout].items() if mask >> bit & 1)


_BITS = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32}


def number(code):
    """Return any number that a code of ``struct`` can hold, except NaN."""
    if code in "fd":
        return st.floats(width=32 if code == "f" else 64, allow_nan=False)
    if code.isupper():
        return st.integers(0, 2 ** _BITS[code] - 1)
    return st.integers(-(2 ** (_BITS[code] - 1)), 2 ** (_BITS[code] - 1) - 1)


@st.composite
def values(draw, layout):
    """Return the value of a broadcast in a layout, with any parts."""
    mask = draw(st.integers(0, 2 ** len(FORMS[layout]) - 1))
    form = form_of(layout, mask)
    return struct.pack(form, mask, *[draw(number(code)) for code in form[2:]])


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
    """Return the length for every mask, by the test's table; -1 if the layout lacks a bit."""
    masks = np.arange(1 << 15)
    lengths = np.full(masks.shape, 2)
    for bit, form in FORMS[layout].items():
        lengths += struct.calcsize(f"<{form}") * (masks >> bit & 1)
    known = sum(1 << bit for bit in FORMS[layout])
    return np.where(masks & ~known, -1, lengths)


def test_no_length_fits_two_layouts_that_mean_different_things():
    item, other = Layout
    masks = np.arange(1 << 15)
    same = (lengths_of(item) == lengths_of(other)) & (lengths_of(item) > 0)
    differing = sum(1 << bit for bit in range(15) if FORMS[item].get(bit) != FORMS[other].get(bit))
    assert same.any()
    assert not (masks[same] & differing).any()


@given(st.integers(0, 0xFFFF), st.integers(0, 300))
def test_a_length_of_no_layout_is_refused(mask, length):
    fits = any(broadcast_length(layout, mask) == length for layout in Layout)
    result = decode_broadcast(struct.pack("<H", mask).ljust(length, b"\0")[:length])
    assert (result is not None) == fits


@pytest.mark.parametrize("layout", Layout)
@given(data=st.data())
def test_a_decoded_broadcast_encodes_to_the_same_bytes(layout, data):
    value = data.draw(values(layout))
    result = decode_broadcast(value)
    assert encode_broadcast(result) == value
    assert decode_broadcast(encode_broadcast(result)) == result


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
    result = decode_broadcast(struct.pack(form_of(Layout.LEGACY, mask), mask, *numbers))
    assert result.layout is Layout.LEGACY
    assert result.time == Time(98760, 741636, None, None, 1)
    assert result.velocity == Velocity((1.5, -2.5, 3.5), 0b10101)
    assert result.position == Position(0.9, 0.1, 28.5, 25.0, 4)
    assert result.relative_position is None
    assert result.gps.vel_ned_cmps == (732.0, 2.0, -51.0)
    assert result.gps.detail is None
    assert (result.rtk.yaw_deg, result.rtk.pos_flag, result.rtk.yaw_flag) == (-90, 50, 34)
    assert result.mag == (-828, 1248, -1047)
    assert result.status == Status(2)
    assert result.battery == Battery(None, None, None, 36)
    assert result.mask == mask


def test_the_usual_packages_have_the_lengths_of_their_pushes():
    # Frames of 144, 101, 67, 82 and 55 bytes; 18 are header, check sum, set and id.
    assert [package.length for package in USUAL_PACKAGES] == [126, 83, 49, 64, 37]
    assert [package.rate_hz for package in PackageTable().values()] == [5, 50, 100, 400, 200]


def push_of(*names, with_timestamp=True):
    return PackageTable([Package.of(3, 50, with_timestamp, names)])


def test_a_push_is_read_in_the_order_of_its_package():
    table = push_of("GPS_FUSED", "RTK_YAW", "VELOCITY", "GIMBAL_ANGLES")
    numbers = (0.1, 0.9, 28.5, 14, -90, 1.5, -2.5, 3.5, 1, -30.0, 2.0, 90.0)
    value = struct.pack("<BIIddfHhfffBfff", 3, 123856, 378900, *numbers)
    push = decode_push(value, table)
    assert (push.package.id, push.time_ms, push.time_ns) == (3, 123856, 378900)
    assert push.values == {
        "GPS_FUSED": GpsFused(lon_rad=0.1, lat_rad=0.9, altitude_m=28.5, satellites=14),
        "RTK_YAW": -90,
        "VELOCITY": Velocity((1.5, -2.5, 3.5), 1),
        "GIMBAL_ANGLES": GimbalAngles(pitch_deg=-30.0, roll_deg=2.0, yaw_deg=90.0),
    }
    assert list(push.values) == ["GPS_FUSED", "RTK_YAW", "VELOCITY", "GIMBAL_ANGLES"]


def test_a_push_that_does_not_fit_is_refused():
    table = push_of("RTK_YAW", with_timestamp=False)
    for wrong in (b"", b"\x03", b"\x03\xa6", b"\x03\xa6\xff\x00", b"\x02\xa6\xff"):
        assert decode_push(wrong, table) is None


@st.composite
def pushes(draw):
    topics = tuple(draw(st.lists(st.sampled_from(TOPICS), unique=True, max_size=12)))
    package = Package(draw(st.integers(0, 4)), 50, draw(st.booleans()), topics)
    form = "<B" + "II" * package.with_timestamp + "".join(topic.form for topic in topics)
    codes = "".join(int(n or 1) * code for n, code in re.findall(r"(\d*)(\D)", form[2:]))
    return package, struct.pack(form, package.id, *[draw(number(code)) for code in codes])


@given(pushes())
def test_a_push_that_is_decoded_encodes_to_the_same_bytes(case):
    package, value = case
    push = decode_push(value, PackageTable([package]))
    assert list(push.values) == [topic.name for topic in package.topics]
    assert encode_push(push) == value


def test_a_32_bit_number_is_printed_with_the_digits_that_it_needs():
    numbers = np.array([0.1, 1 / 3, 7.3499999, -1e-30, 3.4028235e38, 1.0000001], dtype=np.float32)
    for value in numbers:
        table = PackageTable([Package.of(0, 50, with_timestamp=False, names=("HEIGHT_FUSION",))])
        push = decode_push(b"\x00" + value.tobytes(), table)
        printed = push_fields(push)["HEIGHT_FUSION"]
        assert np.float32(printed) == value
        assert len(f"{printed!r}".lstrip("-0.").partition("e")[0].replace(".", "")) <= 9


FILE = "packages.yaml"


def entry(**changes):
    return {"rate_hz": 5, "with_timestamp": True, "topics": ["RTK_POSITION", "RTK_YAW"]} | changes


def without(key):
    return {name: value for name, value in entry().items() if name != key}


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        ({"packages": None}, "must have the key packages"),
        ({"packages": {5: entry()}}, r"packages\.5: the id must be 0 to 4"),
        (
            {"packages": {1: without("topics")}},
            r"packages\.1: must have the keys rate_hz, with_timestamp, topics",
        ),
        ({"packages": {1: entry(rate=5)}}, r"packages\.1: must have the keys .*, and no others"),
        ({"packages": {1: entry(rate_hz=401)}}, r"packages\.1\.rate_hz: 401: must be an integer"),
        ({"packages": {1: entry(with_timestamp=1)}}, r"packages\.1\.with_timestamp: 1: must "),
        ({"packages": {1: entry(topics=[])}}, r"packages\.1\.topics: must be a list"),
        (
            {"packages": {1: entry(topics=["RTK_JAW"])}},
            r"packages\.1\.topics: unknown topic RTK_J",
        ),
        ({"packages": {1: entry(topics=["ESC_DATA"] * 4)}}, r"packages\.1: .* more than the 250 "),
    ],
)
def test_an_invalid_table_is_refused_with_file_and_key(tree, message):
    with pytest.raises(DjiError, match=rf"^{FILE}: {message}"):
        package_table(tree, FILE)
